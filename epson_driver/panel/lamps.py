# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""From what was reported to the lamps, and to what is in the way and what to do about it."""

from collections.abc import Iterator, Mapping
from typing import NamedTuple

from epson_driver.panel.robot_state import RobotState, Tri

GOOD, WARN, BAD, OFF, UNKNOWN = COLOURS = ('good', 'warn', 'bad', 'off', 'unknown')
"""Of lamps. OFF: known, and nothing to look at; UNKNOWN: grey, as it may be anything."""


STOP_FAILED = 'STOP did not work'
"""So the driver's sentence begins when a STOP was not followed by rest."""

NO_ESTOP = 'not active'
NO_PROGRAM = ('stopped', 'aborted')
"""What the simulated controller says of its E-stop, and of its tasks when they have ended."""


class Lamp(NamedTuple):
    """One lamp: its name, what it says, its colour."""

    name: str
    text: str
    colour: str


class Advice(NamedTuple):
    """Why the arm would not move now, and what to do about it; `colour` as of a lamp."""

    reason: str
    remedy: str
    colour: str


def lamps(state: RobotState, now: float) -> list[Lamp]:
    """Return all lamps. What is too old is UNKNOWN, whatever it said."""
    status_known = state.fresh('status', now)
    driver_known = state.fresh('diagnostics', now)
    found = [_link(state, now), *_of_status(state)]
    shown = [
        lamp if status_known or lamp.name == 'Link' else lamp._replace(text='?', colour=UNKNOWN)
        for lamp in found
    ]
    shown.insert(3, _door(state, now))
    gate = Lamp('Arm gate', '?', UNKNOWN)
    if driver_known and state.gate_open is not None:
        gate = Lamp('Arm gate', *(('open', GOOD) if state.gate_open else ('closed', WARN)))
    return [*shown, gate]


def _link(state: RobotState, now: float) -> Lamp:
    if not state.fresh('diagnostics', now):
        return Lamp('Link', 'no driver', UNKNOWN)
    if state.link == 'connected' and not state.fresh('joints', now):
        return Lamp('Link', 'no joint states', BAD)
    text = state.link.replace('_', ' ')
    return Lamp('Link', text or '?', GOOD if state.link == 'connected' else BAD)


def _of_status(state: RobotState) -> Iterator[Lamp]:
    status = state.status
    yield _tri('Motors', status.motors_on, ('on', GOOD), ('off', OFF))
    yield _tri('E-stop', status.e_stopped, ('active', BAD), ('clear', GOOD))
    codes = ', '.join(str(code) for code in status.error_codes)
    yield _tri('Error', status.in_error, (codes or 'yes', BAD), (codes or 'none', GOOD))
    yield Lamp(
        'Mode', status.mode or '?', {'AUTO': GOOD, 'MANUAL': WARN}.get(status.mode, UNKNOWN)
    )
    moving = _tri('Motion', status.in_motion, ('moving', GOOD), ('standing', OFF))
    if status.in_motion is Tri.NO and status.motion_possible is Tri.NO:
        moving = Lamp('Motion', 'not possible', WARN)
    yield moving


def _door(state: RobotState, now: float) -> Lamp:
    """Return the door's lamp. robot_status does not have it; the simulated controller tells."""
    if state.simulation is None or not state.fresh('simulation', now):
        return Lamp('Door', 'not reported', UNKNOWN)
    door = state.simulation.condition.get('door', '')
    return Lamp('Door', door or '?', {'closed': GOOD, '': UNKNOWN}.get(door, BAD))


def _tri(name: str, value: Tri, yes: tuple[str, str], no: tuple[str, str]) -> Lamp:
    return Lamp(name, *{Tri.YES: yes, Tri.NO: no, Tri.UNKNOWN: ('unknown', UNKNOWN)}[value])


def advice(state: RobotState, now: float) -> Advice:
    """Return what is in the way of motion, the first that has to be dealt with."""
    if not state.fresh('diagnostics', now):
        return Advice(
            'the driver does not report', 'start it, or look whether it still runs', UNKNOWN
        )
    condition = _condition(state, now)
    if state.arm_text.startswith(STOP_FAILED):
        return Advice(state.arm_text, 'keep away, press the E-stop, and see why', BAD)
    if state.link != 'connected':
        return _ended(condition) or Advice(
            f'no link to the controller ({state.link.replace("_", " ") or "not yet"})',
            'check that it runs, the cable and robot_ip; the driver connects by itself, then '
            'press Enable',
            BAD,
        )
    if not state.fresh('joints', now) or not state.fresh('status', now):
        return Advice(
            state.arm_text or 'the controller is silent', 'wait, or check the controller', BAD
        )
    status, error = state.status, _error(state)
    if status.e_stopped is Tri.YES:
        return Advice(
            'the E-stop is pressed, or not reset yet' + (f' ({error})' if error else ''),
            'release the E-stop, then Reset error, then Enable',
            BAD,
        )
    if status.in_error is Tri.YES or status.error_codes:
        return Advice(
            error or 'the controller reports an error',
            state.remedy or 'Reset error, then Enable',
            BAD,
        )
    told = _ended(condition) or _held(condition)
    if told is not None:
        return told
    if status.mode == 'MANUAL' and status.motion_possible is not Tri.YES:
        return Advice('the key switch is at MANUAL', 'turn it to AUTO, then press Enable', WARN)
    if state.gate_open is False:
        reason = state.gate_reason
        text = reason if reason.startswith('not enabled') else f'not enabled: {reason}'
        return Advice(text, 'press Enable', WARN)
    if status.motion_possible is Tri.NO:
        return Advice('the controller would not move now', 'see its pendant', WARN)
    if state.goal_running:
        return Advice('a goal is being executed', '', GOOD)
    return Advice('ready for a goal', '', GOOD)


def _condition(state: RobotState, now: float) -> Mapping[str, str]:
    """Return what the simulated controller says of itself; of any other, nothing."""
    if state.simulation is None or not state.fresh('simulation', now):
        return {}
    return state.simulation.condition


def _ended(condition: Mapping[str, str]) -> Advice | None:
    """Return why a simulated controller's program does not run; its ports may be closed then."""
    estop, tasks = condition.get('estop', NO_ESTOP), condition.get('tasks', '')
    if estop != NO_ESTOP:
        first = 'release the E-stop, then ' if estop == 'pressed' else ''
        return Advice(f'the E-stop is {estop}', f'{first}Reset error, then Enable', BAD)
    if tasks in NO_PROGRAM:
        return Advice(
            f"the controller's program is {tasks}", 'Tasks: start at the pendant, then Enable', BAD
        )
    return None


def _held(condition: Mapping[str, str]) -> Advice | None:
    """Return why a simulated controller's program waits."""
    if condition.get('door', 'closed') != 'closed':
        return Advice(
            'the safeguard door is open', 'close the door, then Continue at the pendant', BAD
        )
    if condition.get('tasks') == 'paused':
        return Advice('the controller is paused', 'Continue at the pendant', WARN)
    return None


def _error(state: RobotState) -> str:
    codes = ', '.join(str(code) for code in state.status.error_codes)
    if not codes:
        return ''
    return f'error {codes}: {state.error_text}' if state.error_text else f'error {codes}'
