# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`epson_driver first_run`: arguments, page, exit codes. test/first_run tests the steps."""

import os
import sys

import pytest

from epson_driver.cli import first_run
from epson_driver.doctor.look import Look
from epson_driver.first_run.record import FAILED, Entry, load
from epson_driver.first_run.steps import StepResult
from epson_driver.inputs import InputError
from epson_driver.processes.interrupt import INTERRUPTED


class Command:
    """The command with scripted steps, in a separate folder."""

    def __init__(self, monkeypatch, folder):
        monkeypatch.chdir(folder)
        monkeypatch.setattr(first_run, 'go_through', self._run_steps)
        self._monkeypatch = monkeypatch
        self.typed, self.answers, self.ended, self.entry, self.run = b'', 0, True, None, None
        self.error = None

    async def _run_steps(self, run, book, path, say):
        self.run = run
        say('stroke: [THE ARM MOVES]')
        answers = [await run.ask('continue? ') for _ in range(self.answers)]
        run.findings.ok('state', 'it comes')
        run.findings.skipped('I/O', 'not asked for')
        if self.error is not None:
            raise self.error
        if self.entry is not None:
            book.entries['state'] = self.entry
        book.about |= {'answers': '/'.join(answers)}
        book.save(path)
        return self.ended

    def __call__(self, *words):
        reads, writes = os.pipe()
        os.write(writes, self.typed)
        os.close(writes)
        with os.fdopen(reads) as stdin:
            self._monkeypatch.setattr(sys, 'stdin', stdin)
            words = ['--controller=simulated', '--robot=c3_a601s', *words]
            self._monkeypatch.setattr(sys, 'argv', ['first_run', *words])
            return first_run.main()


@pytest.fixture
def call(monkeypatch, tmp_path):
    return Command(monkeypatch, tmp_path)


def test_real_time_motion_has_no_steps(call, capsys):
    with pytest.raises(SystemExit):
        call('127.0.0.1', '--controller=rtmc', '--robot=c8_c901s')
    assert 'see docs/controllers.md' in capsys.readouterr().err


def test_answers_are_read_by_line_and_page_is_named_by_address(call, capsys):
    call.typed, call.answers = b'yes\n\xff no\n', 2
    assert call('127.0.0.1', '--state-port=5', '--io-port=0') == 0
    book = load(first_run.Path('first_run_127.0.0.1.html'))
    assert book.about['answers'] == 'yes/\ufffd no'
    assert (book.about['controller'], book.about['robot']) == ('simulated', 'c3_a601s')
    question = call.run.question
    assert (question.state_port, question.io_port, question.motion_port) == (5, 0, 11000)
    output = capsys.readouterr().out
    assert 'stroke: [THE ARM MOVES]' in output
    assert 'it comes' in output
    assert 'not asked for' not in output
    assert 'first_run_127.0.0.1.html' in output


def test_failed_or_remaining_steps_exit_with_1(call, capsys):
    call.ended = False
    assert call('127.0.0.1') == 1
    call.ended, call.entry = (
        True,
        Entry(FAILED, 'now', StepResult(habits=['replies late']), why='no'),
    )
    assert call('127.0.0.1') == 1
    assert 'replies late' in capsys.readouterr().out


@pytest.mark.parametrize('how', ['end of input', 'Ctrl-C'])
def test_interruption_saves_the_finished_steps(call, capsys, how):
    call.answers = int(how == 'end of input')
    call.error = KeyboardInterrupt() if how == 'Ctrl-C' else None
    assert call('127.0.0.1', '--file=a.html') == INTERRUPTED
    assert 'ended, completed steps are saved in a.html' in capsys.readouterr().out


def test_page_of_another_robot_is_refused(call, capsys):
    assert call('127.0.0.1', '--file=a.html') == 0
    with pytest.raises(SystemExit, match='2'):
        call('127.0.0.1', '--file=a.html', '--robot=gx8_c552s')
    assert 'is for robot c3_a601s: use that, or another --file' in (capsys.readouterr().err)
    call.error = InputError('no such robot')
    with pytest.raises(SystemExit, match='2'):
        call('127.0.0.1')
    assert 'no such robot' in capsys.readouterr().err


def test_answers_can_come_from_a_file(monkeypatch, tmp_path):
    file = tmp_path / 'typed'
    file.write_bytes(b'q\n')
    call = Command(monkeypatch, tmp_path)
    call.answers = 1
    monkeypatch.setattr(os, 'pipe', lambda: (os.open(file, os.O_RDONLY), os.open(file, os.O_RDWR)))
    call.typed = b'q\n'
    assert call('127.0.0.1') == 0
    assert load(first_run.Path('first_run_127.0.0.1.html')).about['answers'] == 'q'


def looked(call, monkeypatch, **found):
    """Run the command without --controller, with a result of the look."""

    async def look(arguments):
        return Look(arguments.address, 5000, **found)

    monkeypatch.setattr(first_run, 'look', look)
    return call('127.0.0.1', '--controller=')


def test_profile_and_model_of_the_controller_are_used(call, monkeypatch):
    assert looked(call, monkeypatch, profile='remote', model='t6_602s') == 0
    question = call.run.question
    assert (question.profile.name, question.model.name) == ('remote', 't6_602s')
    about = load(first_run.Path('first_run_127.0.0.1.html')).about
    assert (about['controller'], about['robot']) == ('remote', 't6_602s')


def test_unknown_model_is_never_assumed(call, monkeypatch, capsys):
    with pytest.raises(SystemExit, match='2'):
        looked(call, monkeypatch, profile='spel')
    assert 'does not report its model: give --robot MODEL' in capsys.readouterr().err
    assert call.run is None


def test_address_without_a_controller_is_reported(call, monkeypatch, capsys):
    assert looked(call, monkeypatch) == 1
    assert 'no controller answers' in capsys.readouterr().out


def test_missing_address_is_reported(monkeypatch, capsys):
    monkeypatch.setattr(sys, 'argv', ['first_run'])
    with pytest.raises(SystemExit, match='2'):
        first_run.main()
    assert 'a file of connect, is needed' in capsys.readouterr().err
