# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Motion along real-time targets, of which the arm takes one in each control cycle.

The arm does not plan. It checks the position of each target, and the velocity and acceleration
that result from the previous targets, against the limits. How a real controller reacts to a
violation is not documented, so the reaction here is a guess.
"""

from collections import deque

import numpy as np

from epson_driver.motion import Array, JointLimits
from epson_driver.motion.joint_motion import JointMotion, fastest_stop
from epson_driver.sim_controller.arm.executor import Point
from epson_driver.sim_controller.arm.low_power import LowPower

TOLERANCE = 1.01
"""Allowed velocity and acceleration, as a multiple of the limit. It allows for rounded targets."""

REST_SHARE = 1e-6
"""Fraction of the velocity limit below which the arm counts as at rest."""


class TargetMotion:
    """The commanded motion through targets with a period of `cycle` s, from `position`.

    It has the methods of an `Executor`, but accepts no points. `ran_empty`: number of cycles in
    which a moving arm had no target.
    """

    low_power = True
    speed = accel = 1.0
    started_points = 0
    has_room = False
    done = False

    def __init__(self, limits: JointLimits, position: Array, caps: LowPower, cycle: float) -> None:
        self.limits = limits
        self.position = position
        self.velocity = np.zeros_like(position)
        self.targets: deque[Array] = deque()
        self.active = False
        self.at_rest = True
        self.ran_empty = 0
        self._acceleration = self.velocity
        self._low_velocity = caps.limits(limits).velocity
        self._cycle = cycle
        self._brake: JointMotion | None = None
        self._time = 0.0

    @property
    def moving(self) -> bool:
        return self.active or not self.at_rest

    def take_target(self) -> str | None:
        """Move to the next target, or stay if there is none.

        Return which limit the target exceeds, or None.
        """
        limits = self.limits
        target = self.targets.popleft() if self.targets else self.position
        velocity = (target - self.position) / self._cycle
        acceleration = (velocity - self.velocity) / self._cycle
        maximum = self._low_velocity if self.low_power else limits.velocity
        empty = target is self.position and not self.at_rest
        self.ran_empty += empty
        for name, exceeded in (
            ('position', (target < limits.position_min) | (target > limits.position_max)),
            ('velocity', np.abs(velocity) > TOLERANCE * maximum),
            ('acceleration', np.abs(acceleration) > TOLERANCE * limits.acceleration),
        ):
            if exceeded.any():
                joint = limits.names[int(np.argmax(exceeded))]
                cause = 'the buffer ran empty' if empty else f'a target exceeds its {name} limit'
                return f'{joint}: {cause}'
        self.position, self.velocity, self._acceleration = target, velocity, acceleration
        self.at_rest = bool((np.abs(velocity) <= REST_SHARE * limits.velocity).all())
        return None

    def take(self, _point: Point) -> None:
        raise RuntimeError('real-time motion accepts no points')

    def stop(self) -> bool:
        """Discard all targets and brake."""
        self.active = False
        self.targets.clear()
        if self._brake is None and not self.at_rest:
            limits = self.limits
            velocity = np.clip(self.velocity, -limits.velocity, limits.velocity)
            acceleration = np.clip(self._acceleration, -limits.acceleration, limits.acceleration)
            self._brake = fastest_stop(limits, (self.position, velocity, acceleration))
            self._time = 0.0
        return False

    def hold(self) -> None:
        self.stop()

    def resume(self) -> None:
        """Do nothing, because discarded targets do not return."""

    def set_position(self, position: Array) -> None:
        """Set the position of an arm at rest. Raises RuntimeError if it moves."""
        if self.moving:
            raise RuntimeError('the position can only be set at rest')
        self.position = position
        self.velocity = self._acceleration = np.zeros_like(position)

    def step(self, dt: float) -> None:
        """Advance a braking motion by `dt` ≥ 0 s. Targets advance with `take_target`."""
        if self._brake is not None:
            self._time += dt
            self.position, self.velocity, self._acceleration = self._brake.at(self._time)
            if self._time >= self._brake.duration:
                self._brake, self.at_rest = None, True
