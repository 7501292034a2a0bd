# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The complete arm: commanded motion, recovery after an open door, and joints that follow."""

from collections.abc import Callable

import numpy as np

from epson_driver.motion import Array, JointLimits, go
from epson_driver.sim_controller.arm.executor import Executor
from epson_driver.sim_controller.arm.low_power import LowPower
from epson_driver.sim_controller.arm.servo import Servo


class Recovery:
    """A slow move in joint space from the current position to where the motion resumes.

    `start` and `target` have shape (n,), rad. `caps` are the low-power caps.
    """

    def __init__(self, limits: JointLimits, start: Array, target: Array, caps: LowPower) -> None:
        speed = caps.speed(limits, target - start)
        self._motion = go(limits, start, target, speed, caps.fraction)
        self._time = 0.0
        self._stopping = False

    @property
    def position(self) -> Array:
        """The commanded joint angles now, shape (n,), rad."""
        return self._motion.at(self._time)[0]

    @property
    def still(self) -> bool:
        """Whether the recovery has ended: complete, or stopped."""
        return self._time >= self._motion.duration

    def stop(self) -> None:
        """Brake on the path."""
        if not self._stopping:
            self._stopping = True
            self._motion = self._motion.stop(self._time)
            self._time = 0.0

    def step(self, dt: float) -> None:
        """Advance by `dt` ≥ 0 s."""
        self._time += dt


class SimulatedArm:
    """An arm that executes points, with its servos.

    `executor` commands the joints, and the servos follow. After an open door has interrupted a
    motion, the arm returns within `caps` to the point of interruption while the executor waits.
    `lend` lets another executor command the joints temporarily.
    """

    def __init__(self, executor: Executor, servo: Servo, caps: LowPower) -> None:
        self.executor = self.own = executor
        self.servo = servo
        self._caps = caps
        self._recovery: Recovery | None = None
        self._pushed: Array | None = None  # the position after a push without power

    @property
    def in_motion(self) -> bool:
        """Whether the arm moves or is about to move."""
        moves = not self.executor.still if self._recovery is None else not self._recovery.still
        return moves or not self.servo.settled

    @property
    def moving(self) -> bool:
        """Whether the arm moves or has a target, possibly after a pause."""
        return self.executor.moving or self.in_motion

    @property
    def commanded(self) -> Array:
        """The commanded joint positions now, shape (n,), rad."""
        if self._recovery is not None:
            return self._recovery.position
        return self.executor.position if self._pushed is None else self._pushed

    def step(self, dt: float, execute: Callable[[float], None]) -> None:
        """Advance by `dt` ≥ 0 s.

        The recovery gets the time while the arm returns after an open door. At all other times
        `execute`, the program's `step`, gets it instead of the executor, because only the program
        knows the next point when one is done within `dt`. Finally the servos follow the resulting
        command.
        """
        if self._recovery is not None:
            if not self.executor.moving:  # its points were discarded, so no return is needed
                self.brake_recovery()
            self._recovery.step(dt)
        else:
            execute(dt)
        self.servo.step(self.commanded, dt)

    def lend(self, executor: Executor) -> None:
        """Switch to another executor until it is at rest. The arm must be at rest now."""
        if self.executor is not executor:
            executor.settle(self.commanded)
            self._hand_over(executor)

    def _hand_over(self, to: Executor) -> None:
        now = self.executor
        to.low_power, to.speed, to.accel = now.low_power, now.speed, now.accel
        self.executor = to

    def hold(self) -> None:
        """Brake on the path and stay there, keeping the points."""
        self.executor.hold()
        self.brake_recovery()

    def brake_recovery(self) -> None:
        """Brake, if the arm is recovering."""
        if self._recovery is not None and not self._recovery.still:
            self._recovery.stop()

    def go_back(self) -> None:
        """Start the slow return to where the motion resumes.

        An arm that is already there resumes.
        """
        way = (self.commanded, self.executor.position)
        self._recovery = Recovery(self.executor.limits, *way, self._caps)

    def went_back(self) -> None:
        """End the recovery of an arm at rest, complete or not."""
        stands = self.commanded
        self._recovery = self._pushed = None
        if not self.executor.moving and not np.array_equal(stands, self.executor.position):
            self.executor.settle(stands)

    def push(self, angles: Array, powered: bool) -> None:
        """Push the joints to a position, shape (n,), rad, within the limits.

        With power the servos push back. Without power the arm stays there, and it must be at rest.
        """
        if powered:
            self.servo.jump(angles)
            return
        self._pushed = angles
        self._recovery = None
        self.servo.place(angles)

    def rest(self) -> None:
        """Set the executor to the current position, if the arm is at rest without points."""
        if not self.in_motion and not self.executor.moving:
            self.went_back()
            if self.executor is not self.own:
                self.own.settle(self.executor.position)
                self._hand_over(self.own)
