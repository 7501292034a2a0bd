# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The arm as a whole: commanded motion, recovery after the door, joints that follow."""

from collections.abc import Callable

import numpy as np

from epson_driver.motion import Array, JointLimits, go
from epson_driver.sim_controller.arm.executor import Executor
from epson_driver.sim_controller.arm.low_power import LowPower
from epson_driver.sim_controller.arm.servo import Servo


class Recovery:
    """A slow move in joint space from where the arm stands to where its motion goes on.

    `start` and `target` have shape (n,), rad; `caps` are those of low power.
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
        """Whether the recovery is over: complete, or stopped."""
        return self._time >= self._motion.duration

    def stop(self) -> None:
        """Brake on the way."""
        if not self._stopping:
            self._stopping = True
            self._motion = self._motion.stop(self._time)
            self._time = 0.0

    def step(self, dt: float) -> None:
        """Let `dt` ≥ 0 s pass."""
        self._time += dt


class SimulatedArm:
    """An arm that executes points, and its servos.

    `executor` says where the joints are to be; the servos follow. After the door has interrupted
    a motion, the arm goes back within `caps` to where that happened; the executor waits meanwhile.
    While it is lent, another executor says where the joints are to be.
    """

    def __init__(self, executor: Executor, servo: Servo, caps: LowPower) -> None:
        self.executor = self.own = executor
        self.servo = servo
        self._caps = caps
        self._recovery: Recovery | None = None
        self._pushed: Array | None = None  # where it was pushed to while it had no power

    @property
    def in_motion(self) -> bool:
        """Whether it moves, or is about to."""
        moves = not self.executor.still if self._recovery is None else not self._recovery.still
        return moves or not self.servo.settled

    @property
    def moving(self) -> bool:
        """Whether it moves or has somewhere to go, be it after a pause."""
        return self.executor.moving or self.in_motion

    @property
    def commanded(self) -> Array:
        """Where the joints are to be now, shape (n,), rad."""
        if self._recovery is not None:
            return self._recovery.position
        return self.executor.position if self._pushed is None else self._pushed

    def step(self, dt: float, execute: Callable[[float], None]) -> None:
        """Let `dt` ≥ 0 s pass.

        The time is for whoever commands the joints now. On the way back after the door that is
        the recovery. At all other times it is the executor, but it is `execute`, the program's
        `step`, that gets the time: only the program knows the point that follows when one is done
        within `dt`. Last, the servos follow what is commanded then.
        """
        if self._recovery is not None:
            if not self.executor.moving:  # its points are gone: there is nothing to go back for
                self.brake_recovery()
            self._recovery.step(dt)
        else:
            execute(dt)
        self.servo.step(self.commanded, dt)

    def lend(self, executor: Executor) -> None:
        """Let another executor move the arm, which must stand, until that rests."""
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
        """Go slowly back to where the motion goes on, or go on at once if the arm is there."""
        way = (self.commanded, self.executor.position)
        self._recovery = Recovery(self.executor.limits, *way, self._caps)

    def went_back(self) -> None:
        """End the recovery of a standing arm, whether it is complete or not."""
        stands = self.commanded
        self._recovery = self._pushed = None
        if not self.executor.moving and not np.array_equal(stands, self.executor.position):
            self.executor.settle(stands)

    def push(self, angles: Array, powered: bool) -> None:
        """Push the joints elsewhere, shape (n,), rad, within the limits.

        With power the servos push back; without, the arm stays there. It must stand then.
        """
        if powered:
            self.servo.jump(angles)
            return
        self._pushed = angles
        self._recovery = None
        self.servo.place(angles)

    def rest(self) -> None:
        """Let the executor begin where the arm stands, if there are no points to go to."""
        if not self.in_motion and not self.executor.moving:
            self.went_back()
            if self.executor is not self.own:
                self.own.settle(self.executor.position)
                self._hand_over(self.own)
