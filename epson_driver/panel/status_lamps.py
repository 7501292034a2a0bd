# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The status lamps, and the advice: why the arm cannot move now, and the remedy."""

from collections.abc import Iterator, Mapping
from typing import NamedTuple

from epson_driver.driver.inhibit import Cause
from epson_driver.driver.remedy import Remedy, with_remedy
from epson_driver.panel.robot_state import RobotState, Tri

GOOD, WARN, BAD, OFF, UNKNOWN = COLOURS = ('good', 'warn', 'bad', 'off', 'unknown')
"""Colours of lamps. OFF means inactive, and is no fault. UNKNOWN is grey: the state is not
known."""

WORDS = {
    Remedy.CONNECT: 'check that it is running, the cable and robot_ip. The driver reconnects '
    'automatically, then press Enable',
    Remedy.CHECK_STATE_SERVER: 'wait, or check the controller',
    Remedy.RELEASE_ESTOP: 'release the E-stop, then Reset error, then Enable',
    Remedy.RESET: 'Reset error, then Enable',
    Remedy.CLOSE_SAFEGUARD: 'close it, then press Enable',
    Remedy.TURN_TO_AUTO: 'turn it to AUTO, then press Enable',
    Remedy.START_MAIN: 'start main, or press Enable',
    Remedy.ENABLE: 'press Enable',
    Remedy.CONTINUE: 'Continue at the pendant',
}
"""Remedy → its text, with the names of the page's buttons."""

NEED_ARMING = WORDS.keys() - {Remedy.CONNECT, Remedy.CHECK_STATE_SERVER, Remedy.CONTINUE}
CALM = (Cause.MANUAL_MODE, Cause.NOT_ENABLED, Cause.MOTORS_OFF, Cause.PAUSED)
"""Causes that are no fault. For a simulated controller, `_condition` is the source of more precise
advice."""

NO_ESTOP, RELEASED = 'not active', 'released, not reset'
"""Values of `estop` in a simulated controller's condition. The third value is 'pressed'."""

NO_PROGRAM = ('stopped', 'aborted')  # values of a condition's `tasks` after the program has ended


class Lamp(NamedTuple):
    name: str
    text: str
    colour: str


class Advice(NamedTuple):
    """Why the arm cannot move now, and the remedy.

    `armed`: whether the user must arm the browser window before the remedy is possible.
    """

    reason: str
    remedy: str
    colour: str
    armed: bool = False


def lamps(state: RobotState, now: float) -> list[Lamp]:
    """Return all lamps. Lamps with outdated values are UNKNOWN. `now`: the panel's clock, s."""
    status_known = state.fresh('status', now)
    result = [_link(state, now), *_of_status(state, _condition(state, now))]
    shown = [
        lamp if status_known or lamp.name == 'Link' else lamp._replace(text='?', colour=UNKNOWN)
        for lamp in result
    ]
    shown.insert(3, _door(state, now))
    enabled = Lamp('Enabled', '?', UNKNOWN)
    if state.gate_open is not None and state.fresh('diagnostics', now):
        enabled = Lamp('Enabled', *(('yes', GOOD) if state.gate_open else ('no', WARN)))
    return [*shown, enabled]


def _link(state: RobotState, now: float) -> Lamp:
    if not state.fresh('diagnostics', now):
        return Lamp('Link', 'no driver', UNKNOWN)
    if state.link == 'connected' and state.joints_missing(now):
        return Lamp('Link', 'no joint states', BAD)
    text = state.link.replace('_', ' ')
    return Lamp('Link', text or '?', GOOD if state.link == 'connected' else BAD)


def _of_status(state: RobotState, condition: Mapping[str, str]) -> Iterator[Lamp]:
    status = state.status
    yield _tri('Motors', status.motors_on, ('on', GOOD), ('off', OFF))
    active = 'not reset' if condition.get('estop') == RELEASED else 'active'
    yield _tri('E-stop', status.e_stopped, (active, BAD), ('clear', GOOD))
    codes = ', '.join(str(code) for code in status.error_codes)
    yield _tri('Error', status.in_error, (codes or 'yes', BAD), (codes or 'none', GOOD))
    colour = {'AUTO': GOOD, 'MANUAL': WARN}.get(status.mode, UNKNOWN)
    yield Lamp('Mode', status.mode or '?', colour)
    moving = _tri('Motion', status.in_motion, ('moving', GOOD), ('at rest', OFF))
    if status.in_motion is Tri.NO and status.motion_possible is Tri.NO:
        moving = Lamp('Motion', 'not possible', WARN)
    yield moving


def _door(state: RobotState, now: float) -> Lamp:
    if not (condition := _condition(state, now)):
        return Lamp('Door', 'not reported', UNKNOWN)
    door = condition.get('door', '')
    return Lamp('Door', door or '?', {'closed': GOOD, '': UNKNOWN}.get(door, BAD))


def _tri(name: str, value: Tri, yes: tuple[str, str], no: tuple[str, str]) -> Lamp:
    return Lamp(name, *{Tri.YES: yes, Tri.NO: no, Tri.UNKNOWN: ('unknown', UNKNOWN)}[value])


def advice(state: RobotState, now: float) -> Advice:
    """Return the advice for the first condition that prevents motion.

    If nothing prevents motion, return the advice for an arm that is ready or moving. `now`: the
    panel's clock, s.
    """
    if not state.fresh('diagnostics', now):
        remedy = 'STOP may not reach it: use the E-stop. Start it, or check whether it is running'
        return Advice('the driver does not report', remedy, UNKNOWN)
    result = state.inhibit
    condition = _condition(state, now)
    if result is None or result.cause in CALM:
        if state.joints_missing(now) or not state.fresh('status', now):
            remedy = WORDS[Remedy.CHECK_STATE_SERVER]
            return Advice(state.no_joints or 'the controller is silent', remedy, BAD)
        simulated = _held(condition)
    elif result.remedy in (Remedy.CONNECT, Remedy.END_CLIENT):
        simulated = _ended(condition)
    elif result.cause is Cause.ESTOP:
        simulated = _estop(condition)
    else:
        simulated = None
    if simulated is not None:
        return simulated
    if result is not None:
        colour = WARN if result.cause in CALM else BAD
        remedy = with_remedy(result.advice, result.remedy, WORDS)
        return Advice(result.text, remedy, colour, result.remedy in NEED_ARMING)
    doing = 'executing a goal' if state.goal_running else 'ready for a goal'
    return Advice(doing, '', GOOD)


def _condition(state: RobotState, now: float) -> Mapping[str, str]:
    """Return a simulated controller's condition (see `Simulation`), or {} if not known."""
    if state.simulation is None or not state.fresh('simulation', now):
        return {}
    return state.simulation.condition


def _estop(condition: Mapping[str, str]) -> Advice | None:
    """Return the advice while the E-stop of a simulated controller is active, else None.

    Unlike a robot_status, `condition` shows whether the E-stop is still pressed or needs only a
    reset, so the advice can name the next action.
    """
    estop = condition.get('estop', NO_ESTOP)
    if estop == NO_ESTOP:
        return None
    if estop == RELEASED:
        return Advice('the E-stop was pressed', WORDS[Remedy.RESET], BAD, True)
    return Advice(f'the E-stop is {estop}', WORDS[Remedy.RELEASE_ESTOP], BAD, True)


def _ended(condition: Mapping[str, str]) -> Advice | None:
    """Return why a simulated controller's program does not run, or None if the program runs."""
    if (estop := _estop(condition)) is not None:
        return estop
    if (tasks := condition.get('tasks')) in NO_PROGRAM:
        remedy = 'Tasks: start at the pendant, then Enable'
        return Advice(f"the controller's program is {tasks}", remedy, BAD, True)
    return None


def _held(condition: Mapping[str, str]) -> Advice | None:
    """Return why a simulated controller's program waits, or None if the program does not wait."""
    if condition.get('door', 'closed') != 'closed':
        remedy = 'close the door, Continue at the pendant, then press Enable'
        return Advice('the safeguard door is open', remedy, BAD, True)
    if condition.get('tasks') == 'paused':
        return Advice('the controller is paused', 'Continue at the pendant', WARN)
    return None
