# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The complete arm: commanded motion, recovery after an open door, and joints that follow."""

import math
from collections.abc import Callable

import numpy as np

from epson_driver.motion import Array, JointLimits, go
from epson_driver.sim_controller.arm.executor import Executor
from epson_driver.sim_controller.arm.low_power import LowPower

SETTLE_JERK = 10.0
"""Jerk within one step, rad/s³, below which a joint is set to its command."""

SETTLE_DISTANCE = 1e-12
"""Distance, rad, at which a joint is set to its command whatever the step."""

MIN_STEP_S = 1e-9
"""Shortest step, s.

A shorter one is ignored, and its change of command counts in the next step.
"""


class Servo:
    """The servos of n joints, initially at rest at `start`, shape (n,), rad.

    `lag` ≥ 0 is the delay of the joints behind the command, s (0: none). `encoder` rounds the
    reported positions to whole pulses, with `pulses`, shape (n,), per rad (or m), NaN where
    unknown. Raises ValueError for other numbers.

    Each joint follows with a first-order lag, solved exactly for a command that is linear between
    steps. Its motion is a weighted mean of earlier commands. So it never exceeds the command's
    velocity, acceleration or jerk, and never overshoots.
    """

    def __init__(self, start: Array, pulses: Array, lag: float, encoder: bool) -> None:
        if not 0.0 <= lag < math.inf:
            raise ValueError(f'lag = {lag}: must be finite and not negative')
        if start.shape != pulses.shape or start.ndim != 1:
            raise ValueError(f'{pulses.size} pulses per unit for {start.size} joints')
        self._pulses = pulses if encoder else None
        self._lag = lag
        self._frozen: dict[int, float] = {}
        self._rest = np.zeros_like(start)
        self._command = start.copy()
        self._actual = start.copy()
        self._velocity = self._rest
        self._settled = True
        self._pushed = False

    @property
    def position(self) -> Array:
        """The positions that the encoders report now, shape (n,), rad."""
        position = self._actual.copy()
        if self._pulses is not None:
            counted = np.rint(position * self._pulses) / self._pulses
            position = np.where(np.isnan(counted), position, counted)
        for joint, value in self._frozen.items():
            position[joint] = value
        return position

    @property
    def velocity(self) -> Array:
        """The joint velocities that the encoders report, shape (n,), rad/s."""
        velocity = self._velocity.copy()
        for joint in self._frozen:
            velocity[joint] = 0.0
        return velocity

    @property
    def settled(self) -> bool:
        """Whether the command is constant and all joints are at rest exactly at this position."""
        return self._settled

    @property
    def actual(self) -> Array:
        """The true joint positions, shape (n,), rad, independent of the encoders."""
        return self._actual

    def step(self, commanded: Array, dt: float) -> None:
        """Advance by `dt` ≥ 0 s, while the command changes to `commanded`, shape (n,), rad."""
        unchanged = bool((commanded == self._command).all())
        if self._settled and unchanged:
            return
        self._settled = False
        if dt < MIN_STEP_S:
            return
        before = commanded if self._pushed else self._command
        self._command, self._pushed = commanded.copy(), False
        speed = (commanded - before) / dt
        if self._lag == 0.0:
            self._velocity = speed
            self._arrive(unchanged)
            return
        # Behind a command of constant speed a joint lags by `behind`. The rest decays.
        behind = self._lag * speed
        lag = behind + (before - self._actual - behind) * math.exp(-dt / self._lag)
        self._actual = commanded - lag
        self._velocity = lag / self._lag
        if unchanged and float(np.abs(lag).max()) <= max(SETTLE_DISTANCE, SETTLE_JERK * dt**3):
            self._velocity = self._rest
            self._arrive(unchanged)

    def _arrive(self, settled: bool) -> None:
        self._actual = self._command
        self._settled = settled

    def freeze(self, joint: int | None) -> None:
        """Freeze the encoder of a joint (index from 0). None unfreezes all encoders."""
        if joint is None:
            self._frozen.clear()
        else:
            self._frozen.setdefault(joint, float(self.position[joint]))

    def jump(self, position: Array) -> None:
        """Move the joints, shape (n,), rad, as after a push or while the controller was off.

        They return to the command with the next step.
        """
        self._actual = position.copy()
        self._velocity = self._rest
        self._settled = bool((self._actual == self._command).all())
        self._pushed = True

    def place(self, position: Array) -> None:
        """Set the position of joints without power, shape (n,), rad."""
        self._command = position.copy()
        self._arrive(settled=True)
        self._velocity = self._rest
        self._pushed = False


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
    `switch_executor` lets another executor command the joints temporarily.
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

    def switch_executor(self, executor: Executor) -> None:
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
        rest = self.commanded
        self._recovery = self._pushed = None
        if not self.executor.moving and not np.array_equal(rest, self.executor.position):
            self.executor.settle(rest)

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
