# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Motoman's checks of a JOINT_TRAJ_PT_FULL, and its trajectory mode.

Like MotoROS 1.9, they check group, valid fields, time, start position and speed. They are stricter
in three points: MotoROS only warns of times that do not increase, detects positions outside the
limits when the arm reaches them, and accepts non-finite numbers.
"""

import logging
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from epson_driver.motion import Array, JointLimits
from epson_driver.sim_controller.condition.errors import ErrorNumber, angles_rejection
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
from epson_driver.simple_message import JointTrajPtFull, ValidFields
from epson_driver.simple_message.motoman import Invalid, NotReady

REQUIRED = ValidFields.TIME | ValidFields.POSITION | ValidFields.VELOCITY

MAX_TIME_S = 4 * 3600.0
"""Maximum time of a point, s. In a longer trajectory float32 is too coarse for the times."""

START_TOLERANCE = 5e-4
"""Maximum distance of a joint from point 0, rad or m. MotoROS allows 30 encoder pulses."""


class InvalidReason(NamedTuple):
    subcode: Invalid
    sentence: str


def invalid_form(point: JointTrajPtFull) -> InvalidReason | None:
    """Return why the form of a point is invalid, or None.

    All values must be finite, also those of joints that the robot does not have.
    """
    if point.robot_id != 0:
        return InvalidReason(
            Invalid.GROUPNO, f'robot_id = {point.robot_id}: must be 0, the only group'
        )
    missing = REQUIRED & ~point.valid_fields
    if missing:
        names = ', '.join(str(field.name).lower() for field in REQUIRED if field & missing)
        sentence = f'valid_fields = {point.valid_fields}: without {names}'
        return InvalidReason(Invalid.DATA_INSUFFICIENT, sentence)
    if not 0.0 <= point.time < MAX_TIME_S:
        sentence = f'time = {point.time:g} s: must be from 0 to below {MAX_TIME_S:g} s'
        return InvalidReason(Invalid.DATA_TIME, sentence)
    fields = [
        ('positions', point.positions, Invalid.DATA_POSITION),
        ('velocities', point.velocities, Invalid.DATA_SPEED),
    ]
    if point.valid_fields & ValidFields.ACCELERATION:
        fields.append(('accelerations', point.accelerations, Invalid.DATA_ACCEL))
    for name, values, subcode in fields:
        for index, value in enumerate(values):
            if not np.isfinite(value):
                return InvalidReason(subcode, f'{name}[{index}] = {value} is not finite')
    return None


def invalid_start(
    point: JointTrajPtFull, position: Array, limits: JointLimits
) -> InvalidReason | None:
    off = np.abs(np.array(point.positions[: len(position)]) - position)
    joint = int(np.argmax(off))
    if off[joint] > START_TOLERANCE:
        unit = limits.units[joint]
        sentence = (
            f'{limits.names[joint]} = {point.positions[joint]:.7g} {unit}, but it is at '
            f'{position[joint]:.7g} {unit}, more than {START_TOLERANCE:g} {unit} away'
        )
        return InvalidReason(Invalid.DATA_START_POS, sentence)
    return _invalid_speed(point, limits)


def invalid_next(
    point: JointTrajPtFull, before: float, limits: JointLimits
) -> InvalidReason | None:
    if point.time <= before:
        sentence = (
            f'time = {point.time:g} s: must be later than {before:g} s of the previous point'
        )
        return InvalidReason(Invalid.DATA_TIME, sentence)
    rejection = angles_rejection(np.array(point.positions[: len(limits.names)]), limits)
    if rejection is not None:
        return InvalidReason(Invalid.DATA_POSITION, rejection.sentence)
    return _invalid_speed(point, limits)


def _invalid_speed(point: JointTrajPtFull, limits: JointLimits) -> InvalidReason | None:
    speeds = np.abs(np.array(point.velocities[: len(limits.names)]))
    # A limit that was rounded to float32 in transit is still allowed.
    above = speeds > np.maximum(limits.velocity, limits.velocity.astype(np.float32))
    if not above.any():
        return None
    joint = int(np.argmax(above))
    unit = limits.units[joint]
    sentence = (
        f'{limits.names[joint]}: {point.velocities[joint]:.7g} {unit}/s is above the limit, '
        f'{limits.velocity[joint]:.7g} {unit}/s'
    )
    return InvalidReason(Invalid.DATA_SPEED, sentence)


_log = logging.getLogger(__name__)

NOT_READY: tuple[tuple[NotReady, Callable[[Condition], bool]], ...] = (
    (NotReady.ALARM, lambda condition: condition.fault is not Fault.NONE),
    (NotReady.ESTOP, lambda condition: condition.estopped),
    (NotReady.NOT_PLAY, lambda condition: condition.mode is Mode.MANUAL),
    (NotReady.SERVO_OFF, lambda condition: condition.motors not in (Motors.ON, Motors.HOLDING)),
    (NotReady.HOLD, lambda condition: condition.paused or condition.tasks is Tasks.RECOVERING),
    (NotReady.NOT_STARTED, lambda condition: condition.tasks is not Tasks.RUNNING),
)
"""Reasons why a condition permits no motion, in MotoROS's order. The first match counts.

MotoROS checks ERROR second. Here ERROR is reported only if no other reason applies, because an
E-stop or the loss of servo power can have caused the error.
"""


class TrajectoryMode:
    """Motoman's trajectory mode, initially off."""

    def __init__(self, controller: Controller) -> None:
        self._controller = controller
        self._on = False

    def missing(self) -> NotReady | None:
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

    def start(self) -> NotReady | None:
        """Reset an alarm and switch the servos on if needed.

        Return why motion is still not possible, or None.
        """
        condition = self._controller.condition
        needs_operator = (
            condition.estopped
            or condition.paused
            or condition.mode is Mode.MANUAL
            or condition.tasks in (Tasks.STOPPED, Tasks.RECOVERING)
        )
        if needs_operator or self.missing() is None:
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
        self._on = False
