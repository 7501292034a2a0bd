# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Builds a RobotStatus from the state of a driver."""

from epson_driver.api.errors import WORDS
from epson_driver.api.status import ControllerError, RobotStatus
from epson_driver.driver.driver import Driver
from epson_driver.driver.inhibit import Purpose
from epson_driver.driver.remedy import Remedy, with_remedy
from epson_driver.error_texts import ErrorTexts
from epson_driver.simple_message import Mode, Status, TriState

_KNOWN = {int(TriState.TRUE): True, int(TriState.FALSE): False}
_MODES = {int(Mode.MANUAL): 'manual', int(Mode.AUTO): 'auto'}


def controller_error(status: Status, texts: ErrorTexts) -> ControllerError | None:
    """Return the error that a STATUS reports, or None."""
    if not status.error_code and status.in_error != TriState.TRUE:
        return None
    number = status.error_code
    return ControllerError(number, texts.phrase(number), texts.advice(number, ''))


def robot_status(driver: Driver, now: float, link_reason: str) -> RobotStatus:
    """Return the state of a driver at loop time `now`, s. `link_reason`: why a link is down."""
    status = driver.robot.status or Status()
    text = 'the arm moves' if driver.goal_queue.busy else 'the arm is enabled'
    remedy = ''
    held = driver.goal_queue.scaling.target == 0.0
    if held:
        moves = driver.robot.why_not_standing(driver.goal_queue.settings.stopped_velocity)
        text = 'pausing: the arm brakes' if moves else 'motions are paused: the speed scaling is 0'
        remedy = 'call set_speed_scaling(1.0)'
    if (found := driver.why_not(Purpose.REPORT, now)) is not None:
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
