# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The state of arm and controller at one moment, in words as well."""

from dataclasses import dataclass

from epson_driver.api.errors import WORDS
from epson_driver.driver.driver import Driver
from epson_driver.driver.inhibit import Remedy, with_remedy
from epson_driver.error_texts import ErrorTexts
from epson_driver.motion import Array
from epson_driver.simple_message import Mode, Status, TriState

_KNOWN = {int(TriState.TRUE): True, int(TriState.FALSE): False}
_MODES = {int(Mode.MANUAL): 'manual', int(Mode.AUTO): 'auto'}


@dataclass(frozen=True, slots=True)
class ControllerError:
    """An error of the controller: its number, what it means, and what helps ('' if not known)."""

    number: int
    text: str
    remedy: str


@dataclass(frozen=True, slots=True)
class RobotStatus:
    """What is known now, or None where the controller does not tell, or the link is down.

    connected: both links are up. enabled: motions are taken. paused: the controller denies motion
    for a while, or the speed scaling is 0. text: the state as a clause. remedy: what to do before
    the arm can move, or ''.
    """

    connected: bool
    enabled: bool
    moving: bool | None
    paused: bool
    e_stopped: bool | None
    motors_on: bool | None
    motion_possible: bool | None
    mode: str | None
    error: ControllerError | None
    text: str
    remedy: str


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """Joints as measured at one moment, and the state then.

    positions, velocities: shape (n,), rad and rad/s (m, m/s). time: of the measurement, s since
    1970, as `time.time()`.
    """

    positions: Array
    velocities: Array
    time: float
    status: RobotStatus


def controller_error(status: Status, texts: ErrorTexts) -> ControllerError | None:
    """Return the error that a STATUS shows, if any."""
    if not status.error_code and status.in_error != TriState.TRUE:
        return None
    number = status.error_code
    return ControllerError(number, texts.phrase(number), texts.advice(number, ''))


def robot_status(driver: Driver, now: float, link_reason: str) -> RobotStatus:
    """Return the state of a driver at a time of its loop. `link_reason`: why a link is down."""
    status = driver.robot.status or Status()
    text = 'the arm moves' if driver.goal_queue.busy else 'the arm is enabled'
    remedy = ''
    held = driver.goal_queue.scaling.target == 0.0
    if held:
        text, remedy = 'motions are paused: the speed scaling is 0', 'call set_speed_scaling(1.0)'
    if (found := driver.inhibit(now)) is not None:
        text, remedy = found.text, with_remedy(found.advice, found.remedy, WORDS)
        if found.remedy is Remedy.CONNECT:
            text += f' ({link_reason})'
    return RobotStatus(
        connected=driver.state_link.connected and driver.motion_link.connected,
        enabled=driver.gate.reason is None,
        moving=_KNOWN.get(status.in_motion),
        paused=driver.robot.paused or held,
        e_stopped=_KNOWN.get(status.e_stopped),
        motors_on=_KNOWN.get(status.drives_powered),
        motion_possible=_KNOWN.get(status.motion_possible),
        mode=_MODES.get(status.mode),
        error=controller_error(status, driver.robot.errors),
        text=text,
        remedy=remedy,
    )
