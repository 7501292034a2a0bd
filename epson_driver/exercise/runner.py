# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Runs a program in a separate cell, triggers a fault, and records the program's behaviour."""

import contextlib
import os
import random
import signal
import subprocess
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from epson_driver.error_texts import load_error_texts
from epson_driver.exercise.cell import SimulatedCell, simulated_cell
from epson_driver.exercise.judge import Observed
from epson_driver.inputs import InputError, printable
from epson_driver.processes.interrupt import interrupts_held
from epson_driver.profiles import load_controller_profile
from epson_driver.remote_ethernet.client import RemoteError
from epson_driver.report.run import RunError
from epson_driver.report.trace_run import read_trace
from epson_driver.robots import load_robot_model
from epson_driver.sim_controller.faults.fault_kinds import FAULTS

Words = str  # an action in the syntax of `pendant`: `estop press`, `fault cut 2`


@dataclass(frozen=True, slots=True)
class Case:
    """A fault, with the operator's reaction. The operator does not enable the arm again.

    * what: description of the fault.
    * person: what the operator does PERSON_COMES_S after the fault.
    * stops: whether the fault causes an E-stop, after which nothing may move until the arm is
      enabled.
    * early: whether the fault starts before the program, because it affects the start of a motion.
    """

    name: str
    what: str
    trigger: tuple[Words, ...]
    person: tuple[Words, ...] = ()
    stops: bool = False
    early: bool = False


NO_FAULT = Case('no fault', 'no fault', ())

_FAULT_WORDS = {
    'cut': 'cut 1',
    'half_open': 'half_open for=3',
    'delay': 'delay seconds=0.2 for=5',
    'jitter': 'jitter seconds=0.1 for=5',
    'coalesce': 'coalesce seconds=0.1 for=5',
    'one_byte': 'one_byte for=5',
    'bit_errors': 'bit_errors rate=0.2 for=3',
    'wrong_length': 'wrong_length',
    'lost_reply': 'lost_reply skip=1',  # the reply to the second point
    'late_reply': 'late_reply seconds=2 skip=1',
    'wrong_byte_order': 'wrong_byte_order for=2',
    'frozen_encoder': 'frozen_encoder for=3',
    'servo_error': 'servo_error',
    'estop_at_point': 'estop_at_point 2',  # point 1 is at the arm's current position
    'reboot': 'reboot for=3',
}

_AFTERWARDS = {
    'servo_error': ('reset',),
    'estop_at_point': ('estop release', 'reset'),
}

STOPPED_FIRST = ('motors off', 'reset')  # refused while a SPEL+ program runs: it is stopped first

CASES: dict[str, Case] = {
    item.name: item
    for item in (
        Case(
            'estop',
            'the E-stop is pressed, released and reset',
            ('estop press',),
            ('estop release', 'reset'),
            stops=True,
        ),
        Case(
            'door',
            'the safeguard door is opened and closed',
            ('door open',),
            ('door close', 'reset'),
        ),
        Case('pause', 'the tasks are paused and continued', ('pause',), ('continue',)),
        Case('motors_off', 'the motors are switched off', ('motors off',)),
        Case(
            'manual',
            'the key switch is turned to MANUAL and back',
            ('mode manual',),
            ('mode auto',),
        ),
        *(
            Case(
                name,
                kind.text,
                (f'fault {_FAULT_WORDS[name]}',),
                _AFTERWARDS.get(name, ()),
                stops=name == 'estop_at_point',
                early=name in ('lost_reply', 'late_reply', 'estop_at_point'),
            )
            for name, kind in FAULTS.items()
        ),
    )
}
"""All cases: a person's interventions, then every fault of the simulated controller."""


def for_kind(actions: tuple[Words, ...], *, spel: bool) -> tuple[Words, ...]:
    """Return the operator's actions for a kind of controller.

    With `spel`, the action `stop` is inserted before each action in STOPPED_FIRST.
    """
    if not spel:
        return actions
    return tuple(
        words
        for action in actions
        for words in (('stop', action) if action in STOPPED_FIRST else (action,))
    )


MOTION_FRACTION = (0.1, 0.6)  # delay from first motion to fault / duration without fault
LATEST_BEGIN_S = 2.0
PERSON_COMES_S = 3.0  # time from the start of the fault to the person's reaction, s
AFTERWARDS_S = 2.0  # time for which the arm is observed after the program has ended, s
KILL_TIMEOUT_S = 10.0
ABORTED = 'goal aborted: '  # prefix of the driver's log line for an aborted goal
MAX_SAID_CHARACTERS = 200


@dataclass(frozen=True)
class Exercise:
    """The command to run, the kind of robot, and the timeout, s."""

    command: Sequence[str]
    robot: str
    controller: str
    arguments: Sequence[str]
    seed: int
    timeout: float
    enabled: bool


def run_case(exercise: Exercise, case: Case, folder: Path, usual: Observed | None) -> Observed:
    """Run the program once.

    Logs and trace are written to `folder`, which must not exist yet. `usual`: the observations
    without a fault, or None for the run without a fault.
    """
    folder.mkdir(parents=True)
    spel = bool(load_controller_profile(exercise.controller).spel.project)
    case = replace(
        case, trigger=for_kind(case.trigger, spel=spel), person=for_kind(case.person, spel=spel)
    )
    chance = random.Random(f'{exercise.seed}/{case.name}')  # noqa: S311 - no secret
    with simulated_cell(
        folder,
        robot=exercise.robot,
        controller=exercise.controller,
        arguments=[f'--seed={exercise.seed}', *exercise.arguments],
        enabled=exercise.enabled,
    ) as cell:
        seen = _watch(exercise, case, cell, chance, usual)
    return replace(
        seen,
        trajectories=_trajectories(cell.trace, exercise.robot),
        moved_after_stop=case.stops and seen.moved_after_stop,
        aborted=_aborted(folder / 'client.log'),
    )


@contextlib.contextmanager
def running_program(
    command: Sequence[str], log: Path, environment: Mapping[str, str]
) -> Iterator[subprocess.Popen[bytes]]:
    """Run a program and its child processes at most until the block ends."""
    with contextlib.ExitStack() as end:
        with log.open('wb') as output, interrupts_held():
            program = subprocess.Popen(  # noqa: S603 - the command that a person gave
                list(command),
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                env=environment,
                start_new_session=True,
            )
            end.callback(_kill, program)
        yield program


def _watch(
    exercise: Exercise,
    case: Case,
    cell: SimulatedCell,
    chance: random.Random,
    usual: Observed | None,
) -> Observed:
    refused = _begin(cell, case) if case.early else ''
    began = time.monotonic()
    log = cell.folder / 'program.log'
    environment = cell.environment | {'EPSON_DRIVER_EXERCISE': case.name}
    with running_program(exercise.command, log, environment) as program:
        deadline = began + exercise.timeout
        ended = threading.Event()

        def wait() -> None:
            program.wait()
            ended.set()

        waiting = threading.Thread(target=wait, name='program', daemon=True)
        waiting.start()
        begun = case.early
        latest = deadline if usual is None or not case.early else began + usual.seconds
        moved_at = cell.observer.wait_for_motion(latest, ended)
        if moved_at is not None and not case.early and case.name != NO_FAULT.name:
            ended.wait(max(moved_at + _delay(usual, chance) - time.monotonic(), 0.0))
            begun, refused = True, _begin(cell, case)
        if begun and case.person:
            ended.wait(PERSON_COMES_S)
            _help(cell, case)
        ended.wait(max(deadline - time.monotonic(), 0.0))
        code = program.returncode if ended.is_set() else None
        seconds = time.monotonic() - began
        last = _last_line(log)
        time.sleep(AFTERWARDS_S)  # a program that has ended may have left a goal running
    waiting.join()
    _, positions = cell.observer.seen
    return Observed(
        case=case.name,
        code=code,
        seconds=seconds,
        last_line=last,
        trajectories=0,
        end=np.asarray(positions[-1]) if len(positions) else None,
        moved=moved_at is not None or case.early,
        moved_after_stop=cell.observer.moved_after_stop(),
        refused=refused,
    )


def _delay(usual: Observed | None, chance: random.Random) -> float:
    fraction = chance.uniform(*MOTION_FRACTION)
    return fraction * min(usual.seconds if usual is not None else 1.0, LATEST_BEGIN_S)


def _begin(cell: SimulatedCell, case: Case) -> str:
    try:
        for words in case.trigger:
            cell.pendant(words)
    except RemoteError as error:
        return str(error)
    return ''


def _help(cell: SimulatedCell, case: Case) -> None:
    for words in case.person:
        with contextlib.suppress(RemoteError):
            cell.pendant(words)


def _kill(program: subprocess.Popen[bytes]) -> None:
    for number in (signal.SIGTERM, signal.SIGKILL):
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(program.pid, number)
        with contextlib.suppress(subprocess.TimeoutExpired):
            program.wait(KILL_TIMEOUT_S)
            break
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(program.pid, signal.SIGKILL)  # remaining child processes


def _last_line(log: Path) -> str:
    text = log.read_bytes()[-20_000:].decode(errors='replace')
    lines = [printable(line.strip()) for line in text.splitlines() if line.strip()]
    return lines[-1][:MAX_SAID_CHARACTERS] if lines else ''


def _aborted(log: Path) -> str:
    lines = log.read_text(encoding='utf-8', errors='replace').splitlines()
    reasons = [line.partition(ABORTED)[2] for line in lines if ABORTED in line]
    return printable(reasons[-1]) if reasons else ''


def _trajectories(trace: Path, robot: str) -> int:
    try:
        run = read_trace(trace, load_robot_model(robot).limits, load_error_texts())
    except (InputError, RunError):
        return 0
    return len(run.plans)
