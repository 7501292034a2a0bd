# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The state of arm and controller at one moment, in words as well."""

from dataclasses import dataclass

from epson_driver.api.errors import in_python
from epson_driver.driver.arm_commands import ArmCommands
from epson_driver.driver.driver import Driver
from epson_driver.driver.stopping.arm_gate import what_forbids_motion
from epson_driver.error_texts import ErrorTexts
from epson_driver.link import LinkState
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
    """What is known now; None where the controller does not tell, or the link is down.

    connected: both links are up. enabled: motions are taken. paused: the controller denies motion
    for a while. text: the state as a clause. remedy: what to do before the arm can move, or ''.
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


def controller_error(status: Status, texts: ErrorTexts) -> ControllerError | None:
    """Return the error that a STATUS shows, if any."""
    if not status.error_code and status.in_error != TriState.TRUE:
        return None
    number = status.error_code
    return ControllerError(number, texts.phrase(number), texts.advice(number, ''))


def robot_status(driver: Driver, commands: ArmCommands, link_reason: str) -> RobotStatus:
    """Return the state of a driver; `link_reason`: why a link is down, if one is."""
    status = driver.robot.status or Status()
    links = (driver.state_link, driver.motion_link)
    connected = all(link.state is LinkState.CONNECTED for link in links)
    text, remedy = _in_words(driver, commands, status, connected, link_reason)
    return RobotStatus(
        connected=connected,
        enabled=driver.gate.reason is None,
        moving=_KNOWN.get(status.in_motion),
        paused=driver.robot.paused,
        e_stopped=_KNOWN.get(status.e_stopped),
        motors_on=_KNOWN.get(status.drives_powered),
        motion_possible=_KNOWN.get(status.motion_possible),
        mode=_MODES.get(status.mode),
        error=controller_error(status, driver.robot.errors),
        text=in_python(text),
        remedy=in_python(remedy),
    )


def _in_words(
    driver: Driver, commands: ArmCommands, status: Status, connected: bool, link_reason: str
) -> tuple[str, str]:
    if not connected:
        remedy = 'start the controller, or check robot_ip and the ports'
        return f'no connection to the controller ({link_reason})', remedy
    if (forbidden := what_forbids_motion(status, driver.robot.errors)) is not None:
        return forbidden, commands.in_the_way(status) or 'call ~/enable'
    if (reason := driver.gate.reason) is not None:
        return f'the arm is disabled: {reason}', 'call ~/enable'
    if driver.robot.paused:
        return 'the controller is paused', 'continue at the controller'
    return ('the arm moves' if driver.goal_queue.busy else 'the arm is enabled'), ''
