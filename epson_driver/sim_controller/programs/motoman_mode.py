# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Motoman's trajectory mode: whether points are accepted, and the reason if not."""

import logging
from collections.abc import Callable

from epson_driver.sim_controller.condition.errors import ErrorNumber
from epson_driver.sim_controller.condition.states import (
    Condition,
    Event,
    Fault,
    Mode,
    Motors,
    RejectedError,
    Tasks,
)
from epson_driver.sim_controller.core import Controller
from epson_driver.simple_message.motoman import NotReady

_log = logging.getLogger(__name__)

NOT_READY: tuple[tuple[NotReady, Callable[[Condition], bool]], ...] = (
    (NotReady.ALARM, lambda condition: condition.fault is not Fault.NONE),
    (NotReady.ESTOP, lambda condition: condition.estopped),
    (NotReady.NOT_PLAY, lambda condition: condition.mode is Mode.MANUAL),
    (NotReady.SERVO_OFF, lambda condition: condition.motors not in (Motors.ON, Motors.HOLDING)),
    (NotReady.HOLD, lambda condition: condition.paused or condition.tasks is Tasks.RECOVERING),
    (NotReady.NOT_STARTED, lambda condition: condition.tasks is not Tasks.RUNNING),
)
"""Reasons why a condition permits no motion. The first match counts, in MotoROS's order.

MotoROS has ERROR second. Here ERROR is the program's error, which an E-stop or the loss of servo
power can have caused, and is reported when none of these applies.
"""


class TrajectoryMode:
    """Trajectory mode, initially off. Only `begin` turns it on."""

    def __init__(self, controller: Controller) -> None:
        self._controller = controller
        self._on = False

    def missing(self) -> NotReady | None:
        """Return the first reason why motion is not possible, or None."""
        condition = self._controller.condition
        blocked = self._controller.motion_rejection()
        ready = condition.motors is Motors.ON and condition.tasks is Tasks.RUNNING
        if self._on and ready and blocked is None:
            return None
        for code, applies in NOT_READY:
            if applies(condition):
                return code
        if self._controller.errors.number is not ErrorNumber.NONE:
            return NotReady.ERROR
        return NotReady.NOT_STARTED if blocked is None else NotReady.UNSPECIFIED

    def begin(self) -> NotReady | None:
        """Turn the mode on. Reset an alarm and switch the servos on if needed.

        States that need an operator remain: the E-stop, a pause, the key switch, stopped tasks.
        Return the remaining reason, or None.
        """
        condition = self._controller.condition
        wants_person = (
            condition.estopped
            or condition.paused
            or condition.mode is Mode.MANUAL
            or condition.tasks in (Tasks.STOPPED, Tasks.RECOVERING)
        )
        if wants_person or self.missing() is None:
            return self.missing()
        try:
            self._controller.errors.clear()
            if condition.fault is not Fault.NONE:
                self._controller.apply(Event.RESET)
            if self._controller.condition.motors is not Motors.ON:
                self._controller.apply(Event.MOTORS_ON)
        except RejectedError as error:
            _log.warning('START_TRAJ_MODE: %s', error)
            return self.missing()
        self._on = True
        missing = self.missing()
        self._on = missing is None
        return missing

    def end(self) -> None:
        """Turn it off."""
        self._on = False
