# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Builds a RobotStatus from the state of a driver, and calls the user's callbacks on changes."""

from collections.abc import Callable
from typing import Generic, ParamSpec

from epson_driver.api.errors import WORDS
from epson_driver.api.status import ControllerError, RobotStatus, Sample
from epson_driver.driver.driver import Driver
from epson_driver.driver.inhibit import Cause, Purpose
from epson_driver.driver.remedy import with_remedy
from epson_driver.driver.state.robot_state import JointSample
from epson_driver.error_texts import ErrorTexts
from epson_driver.simple_message import Mode, Status, TriState

_KNOWN = {int(TriState.TRUE): True, int(TriState.FALSE): False}
_MODES = {int(Mode.MANUAL): 'manual', int(Mode.AUTO): 'auto'}


def controller_error(status: Status, texts: ErrorTexts) -> ControllerError | None:
    if not status.error_code and status.in_error != TriState.TRUE:
        return None
    number = status.error_code
    return ControllerError(number, texts.phrase(number), texts.advice(number, ''))


def robot_status(driver: Driver, now: float, link_reason: str) -> RobotStatus:
    """Return a driver's state at the loop time `now`, s. `link_reason`: why a link is down."""
    status = driver.robot.status or Status()
    text = 'the arm is moving' if driver.goal_queue.busy else 'the arm is enabled'
    remedy = ''
    paused = driver.goal_queue.scaling.target == 0.0
    if paused:
        moves = driver.robot.why_not_at_rest(driver.goal_queue.settings.stopped_velocity)
        text = 'pausing: the arm brakes' if moves else 'motions are paused: the speed scaling is 0'
        remedy = 'call set_speed_scaling(1.0)'
    if (result := driver.why_not(Purpose.REPORT, now)) is not None:
        text, remedy = result.text, with_remedy(result.advice, result.remedy, WORDS)
        if result.cause in (Cause.NO_STATE_LINK, Cause.NO_MOTION_LINK):
            text += f' ({link_reason})'
    return RobotStatus(
        connected=driver.state_link.connected and driver.motion_link.connected,
        enabled=driver.gate.reason is None,
        moving=_KNOWN.get(status.in_motion),
        paused=driver.robot.paused or paused,
        e_stopped=_KNOWN.get(status.e_stopped),
        motors_on=_KNOWN.get(status.drives_powered),
        motion_possible=_KNOWN.get(status.motion_possible),
        mode=_MODES.get(status.mode),
        error=controller_error(status, driver.robot.errors),
        text=text,
        remedy=remedy,
    )


P = ParamSpec('P')


class Callbacks(Generic[P]):
    """The callbacks for one event. All of them are called, even if one raises an exception."""

    def __init__(self, failed: Callable[[Exception], None]) -> None:
        self._failed = failed
        self._functions: list[Callable[P, object]] = []

    @property
    def registered(self) -> bool:
        return bool(self._functions)

    def add(self, function: Callable[P, object]) -> Callable[[], None]:
        self._functions.append(function)

        def remove() -> None:
            if function in self._functions:
                self._functions.remove(function)

        return remove

    def clear(self) -> None:
        self._functions.clear()

    def call(self, *args: P.args, **kwargs: P.kwargs) -> None:
        for function in list(self._functions):
            try:
                function(*args, **kwargs)
            except Exception as error:  # noqa: BLE001 - it is reported, and stops the arm
                self._failed(error)


class Changes:
    """The user's callbacks by event. A value that becomes unknown does not count as a change."""

    def __init__(self, failed: Callable[[Exception], None], texts: ErrorTexts) -> None:
        self.estop: Callbacks[[bool]] = Callbacks(failed)
        self.error: Callbacks[[ControllerError | None]] = Callbacks(failed)
        self.link: Callbacks[[str, str]] = Callbacks(failed)
        self.joints: Callbacks[[Sample]] = Callbacks(failed)
        self.recorded: Callbacks[[JointSample]] = Callbacks(failed)
        self._texts = texts
        self._e_stopped = False
        self._number: int | None = None

    def update(self, status: Status) -> None:
        if status.e_stopped in (TriState.TRUE, TriState.FALSE):
            e_stopped = status.e_stopped == TriState.TRUE
            if e_stopped != self._e_stopped:
                self._e_stopped = e_stopped
                self.estop.call(e_stopped)
        error = controller_error(status, self._texts)
        number = None if error is None else error.number
        if number != self._number and (error is not None or status.in_error == TriState.FALSE):
            self._number = number
            self.error.call(error)
