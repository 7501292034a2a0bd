# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`epson_driver exercise` without a real run: programs that fail without a fault, cell errors."""

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
from epson_driver.exercise.cell import SimulatedCell
from epson_driver.exercise.judge import Observed
from epson_driver.exercise.runner import CASES
from epson_driver.inputs import printable
from epson_driver.node.loop_bridge import outcome_line
from epson_driver.processes import interrupt, processes
from epson_driver.processes.interrupt import ENDING, INTERRUPTED
from epson_driver.processes.processes import Ports, RunError
from epson_driver.remote_ethernet.client import RemoteError
from epson_driver.robots import load_robot_model

MODEL = load_robot_model('c3_a601s')
USUAL = Observed('no fault', 0, 5.0, 'there', 1, np.zeros(6), moved=True)


@pytest.fixture
def called(monkeypatch, capsys):
    """Return a function that calls the command. `case` replaces a run of the program."""
    before = {item: signal.getsignal(item) for item in ENDING}

    def call(case, *words):
        monkeypatch.setattr(exercise, 'run_case', case)
        argv = ['epson_driver exercise', *words, '--', sys.executable]
        monkeypatch.setattr(sys, 'argv', argv)
        return exercise.main(), capsys.readouterr().out

    yield call
    for element, handler in before.items():
        signal.signal(element, handler)


@pytest.mark.parametrize(
    ('changes', 'reason'),
    [
        (
            {'code': None, 'last_line': 'waiting'},
            'still running after 60 s (--timeout), last line',
        ),
        ({'code': 3, 'last_line': ''}, 'exit code 3, last line: -'),
        ({'moved': False}, 'it ended without moving the arm'),
    ],
)
def test_program_that_fails_without_a_fault_is_not_judged(called, changes, reason):
    asked = []

    def case(_exercise, what, _folder, _usual):
        asked.append(what.name)
        return replace(USUAL, **changes)

    code, output = called(case)
    assert code == 2
    assert f'failed before a fault was started: {reason}' in ' '.join(output.split())
    assert len(asked) == 1


@pytest.mark.parametrize('aborted', [1, 2, 3])
def test_reference_run_with_an_aborted_goal_is_repeated(called, aborted):
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


def test_aborted_goal_is_read_from_the_driver_log(tmp_path):
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
def test_cell_error_gives_no_verdict(called, error):
    def case(*_):
        raise error

    code, output = called(case)
    assert code == 2
    assert f'exercise failed: {error}' in ' '.join(output.split())


@pytest.mark.parametrize('number', ENDING)
def test_second_signal_does_not_disturb_the_exit(called, number, monkeypatch):
    monkeypatch.setattr(interrupt, 'ending_signals', lambda: ENDING)  # the signals without nohup

    def case(*_):
        try:
            os.kill(os.getpid(), number)
            raise AssertionError('the signal did not come')
        finally:
            os.kill(os.getpid(), number)  # while the cell is closed

    code, output = called(case)
    assert (code, output.split()[-1]) == (INTERRUPTED, 'stopped')


def test_interrupt_ends_the_program_that_is_exercised(tmp_path):
    command = [sys.executable, '-c', 'import time; time.sleep(600)']
    run = runner.running_program(command, tmp_path / 'program.log', dict(os.environ))
    with pytest.raises(KeyboardInterrupt), run as program:
        raise KeyboardInterrupt
    assert program.returncode == -signal.SIGTERM


# --- the cell ---------------------------------------------------------------------------------


@pytest.fixture
def empty_cell(tmp_path, monkeypatch):
    """A cell without controller and driver."""
    monkeypatch.setattr(cell_module, 'READY_TIMEOUT_S', 0.1)
    port = vacant_port()
    result = SimulatedCell(
        Ports(port, port, port, port), processes.free_ros_domain(), tmp_path, MODEL, ''
    )
    yield result
    result.observer.close()


@pytest.mark.slow
def test_cell_without_processes_has_no_positions(empty_cell):
    assert not empty_cell.observer.wait_for_state(0.1)
    with pytest.raises(RunError, match='no joint positions received yet'):
        _ = empty_cell.positions
    with pytest.raises(RunError, match='~/enable: no service /epson_driver/enable'):
        empty_cell.enable()
    times, positions = empty_cell.observer.seen
    assert (times.shape, positions.shape) == ((0,), (0, 6))
    assert not empty_cell.observer.moved_after_stop()


def test_fault_is_started_by_pendant_and_refusal_reported(empty_cell, monkeypatch):
    commands_given = []

    async def execute(_host, port, commands, _timeout, _password):
        commands_given.extend(commands)
        if len(commands_given) > 1:
            raise RemoteError(commands[0], 20)

    monkeypatch.setattr(cell_module, 'execute', execute)
    empty_cell.fault('cut 2')
    case = CASES['cut']
    assert runner._begin(empty_cell, case).startswith(f'{commands_given[1]}: ')
    assert commands_given[0].startswith('Sim,fault,cut')
    runner._help(empty_cell, replace(case, person=('reset', 'motors on')))
    assert len(commands_given) == 4  # a refusal does not prevent the next action
