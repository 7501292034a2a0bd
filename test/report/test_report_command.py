# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`epson_driver report` as a person calls it, with right and with wrong arguments."""

import json
import sys

import pytest
from support.recorded_run import usual_run

from epson_driver.cli import report
from epson_driver.cli.interrupt import INTERRUPTED


@pytest.fixture
def called(tmp_path, monkeypatch, capsys):
    """Return a function that runs the command in a folder with two traces."""
    usual_run().write(tmp_path / 'a.pcap')
    usual_run(estop=2.0).write(tmp_path / 'b.pcap')
    monkeypatch.chdir(tmp_path)

    def call(*words):
        monkeypatch.setattr(sys, 'argv', ['epson_driver report', *words])
        try:
            code = report.main()
        except SystemExit as stop:
            code = stop.code
        return code, capsys.readouterr()

    return call


def test_each_file_becomes_a_page_with_its_json(called, tmp_path):
    code, said = called('a.pcap', 'b.pcap')
    assert code == 0
    assert 'report: b-report.html' in said.out
    figures = json.loads((tmp_path / 'a-report.json').read_text())
    assert figures['source'] == 'a.pcap'
    assert figures['motions'][0]['points'] == 3
    assert (tmp_path / 'b-report.html').read_text().startswith('<!doctype html>')
    assert [path for path in tmp_path.iterdir() if path.name.startswith('.')] == []


def test_two_runs_side_by_side(called, tmp_path):
    code, _ = called('--compare', 'a.pcap', 'b.pcap', '--output', 'both.html')
    assert code == 0
    both = json.loads((tmp_path / 'both.json').read_text())
    assert [each['source'] for each in both] == ['a.pcap', 'b.pcap']


def test_a_bag_and_its_report(called, tmp_path):
    pytest.importorskip('rosbags')
    assert called('a.pcap', '--mcap', 'bag')[0] == 0
    assert called('bag')[0] == 0
    first = json.loads((tmp_path / 'a-report.json').read_text())
    second = json.loads((tmp_path / 'bag-report.json').read_text())
    assert second['motions'][0]['top_velocity'] == first['motions'][0]['top_velocity']


@pytest.mark.parametrize(
    ('words', 'said'),
    [
        (('--compare', 'a.pcap'), 'puts two files side by side, not 1'),
        (('a.pcap', 'b.pcap', '--output', 'x.html'), 'are for one report'),
        (('a.pcap', '--output', 'x.pdf'), 'must end in .html'),
        (('nothing.pcap',), 'nothing.pcap: No such file'),
        (('a.pcap', '--robot', 'gx4_c251s', '--output', 'no/x.html'), 'No such file or directory'),
        (('a.pcap', '--robot', 'mars'), 'no mars'),
        (('a.pcap', '--controller', 'mars'), 'no mars'),
        (('--compare', 'a.pcap', 'b.pcap', '--mcap', 'bag'), 'leave out --compare'),
        (('a.pcap', '--address', '10.9.9.9'), 'no connection to a controller'),
    ],
)
def test_what_is_wrong_is_said_in_one_sentence(called, words, said):
    code, output = called(*words)
    assert code == 2
    assert said in output.err
    assert 'Traceback' not in output.err


def test_without_the_extra_the_command_that_brings_it_is_named(called, monkeypatch):
    for name in [n for n in sys.modules if n.startswith(('rosbags', 'epson_driver.report.bag_'))]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, 'rosbags', None)
    code, output = called('a.pcap', '--mcap', 'bag')
    assert code == 2
    assert "pip install 'epson_driver[report]'" in output.err


def test_a_report_that_cannot_be_put_in_place_leaves_nothing_behind(called, tmp_path):
    (tmp_path / 'there.html').mkdir()
    code, output = called('a.pcap', '--output', 'there.html')
    assert code == 2
    assert 'there.html' in output.err
    assert {path.name for path in tmp_path.iterdir()} == {'a.pcap', 'b.pcap', 'there.html'}


def test_a_bag_of_another_arm_is_refused_with_both_numbers(called):
    pytest.importorskip('rosbags')
    assert called('a.pcap', '--mcap', 'bag')[0] == 0
    code, output = called('bag', '--robot', 'gx4_c251s')
    assert code == 2
    assert 'bag: 6 joints, the robot gx4_c251s has 4: name its model with --robot' in output.err


def test_ctrl_c_ends_it_as_an_interrupt(called, monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(report, 'read_trace', interrupted)
    assert called('a.pcap')[0] == INTERRUPTED


def test_a_library_that_is_missing_and_no_extra_of_ours_is_not_taken_for_one(called, monkeypatch):
    def missing(*_):
        raise ModuleNotFoundError("No module named 'numpy'", name='numpy')

    monkeypatch.setattr(report, 'read_trace', missing)
    with pytest.raises(ModuleNotFoundError, match='numpy'):
        called('a.pcap')
