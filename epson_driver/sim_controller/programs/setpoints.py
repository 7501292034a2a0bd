# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""JOINT_SETPOINT requests: which are followed, for what reason not (docs/servo.md)."""

from collections.abc import Callable

import numpy as np

from epson_driver.motion import Array
from epson_driver.sim_controller.arm.following import Following
from epson_driver.sim_controller.condition.errors import ErrorNumber, Rejection, corrupt
from epson_driver.sim_controller.programs.points import angles_rejection, clipped
from epson_driver.simple_message import JointSetpoint

START_TOLERANCE = 0.1
"""How far from the arm a setpoint may be while the arm stands, rad or m."""

MIN_SCALE = 0.001
"""The smallest share of the limits that is obeyed: with less the arm would not come anywhere."""


class Setpoints:
    """Has the setpoints of one client followed.

    A setpoint has sequence 0, or one more than the last one that was taken. After `forget` only 0
    begins a stream, so one that goes on after a stop, an E-stop or a pause moves nothing; and a
    standing arm follows only what is near it. `blocked` returns why the controller's condition
    forbids motion, or None; `began` is called when a stream begins with sequence 0.
    """

    def __init__(
        self,
        arm: Following,
        blocked: Callable[[], Rejection | None],
        began: Callable[[], None],
    ) -> None:
        self._arm = arm
        self._blocked = blocked
        self._began = began
        self._last: int | None = None

    def forget(self) -> None:
        """End the stream: the next one begins with 0."""
        self._last = None

    def take(self, setpoint: JointSetpoint) -> Rejection | None:
        """Follow a setpoint; return why not, or None."""
        count = len(self._arm.limits.names)
        target = np.array(setpoint.joints[:count])
        velocity = np.array(setpoint.velocities[:count])
        rejection = (
            self._blocked()
            or self._sequence_rejection(setpoint.sequence)
            or self._number_rejection(setpoint)
            or angles_rejection(target, self._arm.limits)
            or self._arm_rejection(target)
        )
        if rejection is not None:
            return rejection.about(f'JOINT_SETPOINT {setpoint.sequence}')
        self._last = setpoint.sequence
        if setpoint.sequence == 0:
            self._began()
        self._arm.follow(clipped(target, self._arm.limits), velocity, setpoint.scale)
        return None

    def _sequence_rejection(self, sequence: int) -> Rejection | None:
        following = None if self._last is None else self._last + 1
        if sequence == 0 or sequence == following:
            return None
        expected = '0' if following is None else f'{following}, or 0 for a new stream'
        return corrupt(f'out of sequence: it must be {expected}')

    def _number_rejection(self, setpoint: JointSetpoint) -> Rejection | None:
        for name, values in (('joints', setpoint.joints), ('velocities', setpoint.velocities)):
            for index, value in enumerate(values):
                if not np.isfinite(value):
                    return corrupt(f'{name}[{index}] = {value} is not finite')
        if not MIN_SCALE <= setpoint.scale <= 1.0:
            return corrupt(f'scale = {setpoint.scale:g}: must be from {MIN_SCALE:g} to 1')
        return None

    def _arm_rejection(self, target: Array) -> Rejection | None:
        if not self._arm.ready:
            return corrupt('the arm has points to go to, or brakes')
        if self._arm.following:
            return None
        apart = np.abs(target - self._arm.position)
        joint = int(np.argmax(apart))
        if apart[joint] <= START_TOLERANCE:
            return None
        limits = self._arm.limits
        unit = limits.units[joint]
        sentence = (
            f'{limits.names[joint]} is {apart[joint]:.6g} {unit} away; a standing arm follows '
            f'what is within {START_TOLERANCE:g} {unit}'
        )
        return Rejection(ErrorNumber.OUT_OF_RANGE, sentence)
