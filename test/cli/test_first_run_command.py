# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`epson_driver first-run`: arguments, page, how it ends (test/first_run: its steps)."""

import os
import sys

import pytest

from epson_driver.cli import first_run
from epson_driver.first_run.book import FAILED, Entry, load
from epson_driver.first_run.steps import Found
from epson_driver.inputs import InputError
from epson_driver.processes.interrupt import INTERRUPTED


class Called:
    """The command in a folder of its own, whose steps are played."""

    def __init__(self, monkeypatch, folder):
        monkeypatch.chdir(folder)
        monkeypatch.setattr(first_run, 'go_through', self._go_through)
        self._monkeypatch = monkeypatch
        self.typed, self.answers, self.ended, self.entry, self.run = b'', 0, True, None, None
        self.error = None

    async def _go_through(self, run, book, path, say):
        self.run = run
        say('stroke: [THE ARM MOVES]')
        heard = [await run.ask('go on? ') for _ in range(self.answers)]
        run.findings.ok('state', 'it comes')
        run.findings.skipped('I/O', 'not asked for')
        if self.error is not None:
            raise self.error
        if self.entry is not None:
            book.entries['state'] = self.entry
        book.about |= {'heard': '/'.join(heard)}
        book.save(path)
        return self.ended

    def __call__(self, *words):
        reads, writes = os.pipe()
        os.write(writes, self.typed)
        os.close(writes)
        with os.fdopen(reads) as stdin:
            self._monkeypatch.setattr(sys, 'stdin', stdin)
            self._monkeypatch.setattr(sys, 'argv', ['first-run', *words])
            return first_run.main()


@pytest.fixture
def call(monkeypatch, tmp_path):
    return Called(monkeypatch, tmp_path)


def test_what_is_typed_is_heard_line_by_line_and_the_page_is_named_after_the_address(call, capsys):
    call.typed, call.answers = b'yes\n\xff no\n', 2
    assert call('127.0.0.1', '--state-port=5', '--io-port=0') == 0
    book = load(first_run.Path('first_run_127.0.0.1.html'))
    assert book.about['heard'] == 'yes/\ufffd no'
    assert (book.about['controller'], book.about['robot']) == ('simulated', 'c3_a601s')
    question = call.run.question
    assert (question.state_port, question.io_port, question.motion_port) == (5, 0, 11000)
    said = capsys.readouterr().out
    assert 'stroke: [THE ARM MOVES]' in said
    assert 'it comes' in said
    assert 'not asked for' not in said
    assert 'first_run_127.0.0.1.html' in said


def test_steps_that_failed_or_are_left_make_its_exit_code_1(call, capsys):
    call.ended = False
    assert call('127.0.0.1') == 1
    call.ended, call.entry = True, Entry(FAILED, 'now', Found(habits=['replies late']), why='no')
    assert call('127.0.0.1') == 1
    assert 'replies late' in capsys.readouterr().out


@pytest.mark.parametrize('how', ['end of input', 'Ctrl-C'])
def test_whoever_leaves_is_told_that_what_was_done_is_kept(call, capsys, how):
    call.answers = int(how == 'end of input')
    call.error = KeyboardInterrupt() if how == 'Ctrl-C' else None
    assert call('127.0.0.1', '--file=a.html') == INTERRUPTED
    assert 'ended; what was done is kept: a.html' in capsys.readouterr().out


def test_a_page_of_another_robot_is_not_gone_on_with(call, capsys):
    assert call('127.0.0.1', '--file=a.html') == 0
    with pytest.raises(SystemExit, match='2'):
        call('127.0.0.1', '--file=a.html', '--robot=gx8_c552s')
    assert 'is about the robot c3_a601s; give that one, or another --file' in (
        capsys.readouterr().err
    )
    call.error = InputError('no such robot')
    with pytest.raises(SystemExit, match='2'):
        call('127.0.0.1')
    assert 'no such robot' in capsys.readouterr().err


def test_what_is_typed_may_come_from_a_file(monkeypatch, tmp_path):
    file = tmp_path / 'typed'
    file.write_bytes(b'q\n')
    call = Called(monkeypatch, tmp_path)
    call.answers = 1
    monkeypatch.setattr(os, 'pipe', lambda: (os.open(file, os.O_RDONLY), os.open(file, os.O_RDWR)))
    call.typed = b'q\n'
    assert call('127.0.0.1') == 0
    assert load(first_run.Path('first_run_127.0.0.1.html')).about['heard'] == 'q'
