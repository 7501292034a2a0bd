# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`epson_driver exercise` without a cell: what it says of a program that does not work at all."""

import os
import signal
import sys
from dataclasses import replace

import numpy as np
import pytest
from support.sim_process import vacant_port

from epson_driver.cli import exercise
from epson_driver.driver.outcome import End, ErrorCode, Outcome
from epson_driver.exercise import cell as cell_module
from epson_driver.exercise import runner
from epson_driver.exercise.cases import CASES
from epson_driver.exercise.cell import SimulatedCell
from epson_driver.exercise.judge import Observed
from epson_driver.exercise.observer import standstill
from epson_driver.inputs import printable
from epson_driver.node.goal_action import outcome_line
from epson_driver.processes import interrupt, processes
from epson_driver.processes.interrupt import ENDING, INTERRUPTED
from epson_driver.processes.processes import Ports, RunError
from epson_driver.remote_ethernet.client import RemoteError
from epson_driver.robots import load_robot_model

MODEL = load_robot_model('c3_a601s')
USUAL = Observed('no fault', 0, 5.0, 'there', 1, np.zeros(6), moved=True)


@pytest.fixture
def called(monkeypatch, capsys):
    """Return a function that calls the command; `case` stands in for a run of the program."""
    before = {each: signal.getsignal(each) for each in ENDING}

    def call(case, *words):
        monkeypatch.setattr(exercise, 'run_case', case)
        argv = ['epson_driver exercise', *words, '--', sys.executable]
        monkeypatch.setattr(sys, 'argv', argv)
        return exercise.main(), capsys.readouterr().out

    yield call
    for each, handler in before.items():
        signal.signal(each, handler)


@pytest.mark.parametrize(
    ('changes', 'said'),
    [
        (
            {'code': None, 'said': 'waiting'},
            'it did not end within 60 s (--timeout); last said',
        ),
        ({'code': 3, 'said': ''}, 'exit code 3; last said: -'),
        ({'moved': False}, 'it ended without having moved the arm'),
    ],
)
def test_a_program_that_does_not_finish_without_a_fault_is_not_judged(called, changes, said):
    asked = []

    def case(_exercise, what, _folder, _usual):
        asked.append(what.name)
        return replace(USUAL, **changes)

    code, output = called(case)
    assert code == 2
    assert f'without a fault it must finish: {said}' in ' '.join(output.split())
    assert len(asked) == 1


@pytest.mark.parametrize('aborted', [1, 2, 3])
def test_a_run_without_a_fault_in_which_a_goal_was_aborted_is_no_measure(called, aborted):
    asked = []

    def case(_exercise, what, folder, _usual):
        asked.append(folder.name)
        if len(asked) <= aborted:
            return replace(USUAL, trajectories=2, aborted='no joint state for 0.4 s')
        return replace(USUAL, case=what.name)

    code, output = called(case, '--fault=cut')
    assert code == 0
    assert asked == [*['no_fault', 'no_fault_2', 'no_fault_3'][: aborted + 1], 'cut']
    assert output.count('a goal was aborted: no joint state for 0.4 s') == aborted
    assert f'{2 if aborted == 3 else 1} trajectories' in output


def test_what_the_driver_aborted_is_read_from_its_log(tmp_path):
    log = tmp_path / 'client.log'
    lines = [
        outcome_line(Outcome(End(end), ErrorCode.SUCCESSFUL, text))
        for end, text in (('aborted', 'cut'), ('aborted', 'late\x1b'), ('succeeded', 'there'))
    ]
    log.write_text(lines[-1])
    assert runner._aborted(log) == ''
    log.write_text('\n'.join(f'[WARN] [1.5] [epson_driver]: {line}' for line in lines))
    assert runner._aborted(log) == printable('late\x1b')


@pytest.mark.parametrize('error', [RunError('~/enable: the E-stop is pressed'), OSError(28, 'x')])
def test_a_cell_that_does_not_work_is_no_verdict(called, error):
    def case(*_):
        raise error

    code, output = called(case)
    assert code == 2
    assert f'exercise failed: {error}' in ' '.join(output.split())


@pytest.mark.parametrize('number', ENDING)
def test_a_signal_ends_it_and_another_one_does_not_disturb_the_end(called, number, monkeypatch):
    monkeypatch.setattr(interrupt, 'ending_signals', lambda: ENDING)  # as without nohup

    def case(*_):
        try:
            os.kill(os.getpid(), number)
            raise AssertionError('the signal did not come')
        finally:
            os.kill(os.getpid(), number)  # while the cell is closed

    code, output = called(case)
    assert (code, output.split()[-1]) == (INTERRUPTED, 'stopped')


# --- the cell ---------------------------------------------------------------------------------


@pytest.fixture
def lonely(tmp_path, monkeypatch):
    """Return a cell whose controller and driver are not there."""
    monkeypatch.setattr(cell_module, 'READY_TIMEOUT_S', 0.1)
    port = vacant_port()
    found = SimulatedCell(
        Ports(port, port, port, port), processes.free_ros_domain(), tmp_path, MODEL, ''
    )
    yield found
    found.observer.close()


@pytest.mark.slow
def test_a_cell_that_has_said_nothing_has_no_positions_and_cannot_be_enabled(lonely):
    assert not lonely.observer.wait_for_state(0.1)
    with pytest.raises(RunError, match='has not said yet where the joints are'):
        _ = lonely.positions
    with pytest.raises(RunError, match='~/enable: no service /epson_driver/enable'):
        lonely.enable()
    times, positions = lonely.observer.seen
    assert (times.shape, positions.shape) == ((0,), (0, 6))
    assert not lonely.observer.moved_after_stop()


def test_a_fault_is_begun_at_the_pendant_and_a_refusal_is_said(lonely, monkeypatch):
    given = []

    async def execute(_host, port, commands, _timeout, _password):
        given.extend(commands)
        if len(given) > 1:
            raise RemoteError(commands[0], 20)

    monkeypatch.setattr(cell_module, 'execute', execute)
    lonely.fault('cut 2')
    case = CASES['cut']
    assert runner._begin(lonely, case).startswith(f'{given[1]}: ')
    assert given[0].startswith('Sim,fault,cut')
    runner._help(lonely, replace(case, person=('reset', 'motors on')))
    assert len(given) == 4  # a refusal keeps no person from the next


@pytest.mark.invariant(3)
def test_an_arm_that_never_stands_or_was_not_seen_has_no_standstill():
    times = np.arange(100) * 0.02
    assert standstill(times, np.arange(100)[:, None] * 0.01) is None
    assert standstill(np.array([]), np.zeros((0, 6))) is None


def test_a_wire_that_was_not_recorded_has_no_trajectories(tmp_path):
    assert runner._trajectories(tmp_path / 'wire.pcap', 'c3_a601s') == 0
    (tmp_path / 'wire.pcap').write_bytes(b'no capture')
    assert runner._trajectories(tmp_path / 'wire.pcap', 'c3_a601s') == 0
