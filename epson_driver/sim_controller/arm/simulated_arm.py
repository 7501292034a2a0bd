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
"""Maximum jerk, rad/s³, of the last step, which sets a joint exactly to its command."""

SETTLE_DISTANCE = 1e-12
"""Distance from the command, rad. Within it a joint is set to the command despite the jerk."""

MIN_STEP_S = 1e-9
"""Shortest step, s. The servos combine a shorter step with the next one."""


class Servo:
    """The servos of n joints, initially at rest at `start`, shape (n,), rad.

    `lag` ≥ 0 is the time constant with which the joints follow the command, s (0: no lag). With
    `encoder` the reported positions are rounded to whole pulses. `pulses`, shape (n,), is the
    number of pulses per rad or m, NaN if unknown.

    Each joint follows with a first-order lag, solved exactly for a command that is linear between
    steps. Its motion is a weighted mean of earlier commands. So it never exceeds the command's
    velocity, acceleration or jerk, and never overshoots.
    """

    def __init__(self, start: Array, pulses: Array, lag: float, encoder: bool) -> None:
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
        velocity = self._velocity.copy()
        for joint in self._frozen:
            velocity[joint] = 0.0
        return velocity

    @property
    def settled(self) -> bool:
        """Whether the command is constant and each joint rests exactly at its command."""
        return self._settled

    @property
    def actual(self) -> Array:
        """The true joint positions, shape (n,), rad.

        Frozen encoders report other positions.
        """
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
        # At constant speed a joint lags by `behind`. The difference from this lag decays.
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
        if joint is None:
            self._frozen.clear()
        else:
            self._frozen.setdefault(joint, float(self.position[joint]))

    def jump(self, position: Array) -> None:
        """Displace the joints. They then return to the command."""
        self._actual = position.copy()
        self._velocity = self._rest
        self._settled = bool((self._actual == self._command).all())
        self._pushed = True

    def set_position(self, position: Array) -> None:
        """Set the joint positions, shape (n,), rad. Requires that the joints have no power."""
        self._command = position.copy()
        self._arrive(settled=True)
        self._velocity = self._rest
        self._pushed = False


class Recovery:
    """The slow return to the position at which an interrupted motion resumes."""

    def __init__(self, limits: JointLimits, start: Array, target: Array, caps: LowPower) -> None:
        speed = caps.speed(limits, target - start)
        self._motion = go(limits, start, target, speed, caps.fraction)
        self._time = 0.0
        self._stopping = False

    @property
    def position(self) -> Array:
        return self._motion.at(self._time)[0]

    @property
    def at_rest(self) -> bool:
        return self._time >= self._motion.duration

    def stop(self) -> None:
        if not self._stopping:
            self._stopping = True
            self._motion = self._motion.stop(self._time)
            self._time = 0.0

    def step(self, dt: float) -> None:
        self._time += dt


class SimulatedArm:
    """An arm that executes points, with its servos.

    `executor` commands the joints, and the servos follow. After the door has interrupted a motion,
    the arm returns within the low-power `caps` to the point of interruption, while the executor
    waits. `switch_executor` gives another executor temporary control.
    """

    def __init__(self, executor: Executor, servo: Servo, caps: LowPower) -> None:
        self.executor = self.program_executor = executor
        self.servo = servo
        self._caps = caps
        self._recovery: Recovery | None = None
        self._pushed: Array | None = None  # the position after a push without power

    @property
    def in_motion(self) -> bool:
        """Whether the arm moves or is about to move."""
        moves = not self.executor.at_rest if self._recovery is None else not self._recovery.at_rest
        return moves or not self.servo.settled

    @property
    def moving(self) -> bool:
        """Whether the arm moves or has points to execute, even during a pause."""
        return self.executor.moving or self.in_motion

    @property
    def commanded(self) -> Array:
        """The commanded joint positions now, shape (n,), rad."""
        if self._recovery is not None:
            return self._recovery.position
        return self.executor.position if self._pushed is None else self._pushed

    def step(self, dt: float, execute: Callable[[float], None]) -> None:
        """Advance by `dt` s.

        `execute` is the program's `step`. It is not called during a recovery.
        """
        if self._recovery is not None:
            if not self.executor.moving:  # its points were discarded, so no return is needed
                self.brake_recovery()
            self._recovery.step(dt)
        else:
            execute(dt)
        self.servo.step(self.commanded, dt)

    def switch_executor(self, executor: Executor) -> None:
        """Give an executor control of the arm until it is idle. Requires an arm at rest."""
        if self.executor is not executor:
            executor.set_position(self.commanded)
            self._set_executor(executor)

    def _set_executor(self, to: Executor) -> None:
        now = self.executor
        to.low_power, to.speed, to.accel = now.low_power, now.speed, now.accel
        self.executor = to

    def hold(self) -> None:
        self.executor.hold()
        self.brake_recovery()

    def brake_recovery(self) -> None:
        if self._recovery is not None and not self._recovery.at_rest:
            self._recovery.stop()

    def start_recovery(self) -> None:
        start, target = self.commanded, self.executor.position
        self._recovery = Recovery(self.executor.limits, start, target, self._caps)

    def end_recovery(self) -> None:
        """End the recovery, complete or not, of an arm at rest."""
        rest = self.commanded
        self._recovery = self._pushed = None
        if not self.executor.moving and not np.array_equal(rest, self.executor.position):
            self.executor.set_position(rest)

    def push(self, angles: Array, powered: bool) -> None:
        """Displace the joints.

        Without power the arm must be at rest, and keeps the new position.
        """
        if powered:
            self.servo.jump(angles)
            return
        self._pushed = angles
        self._recovery = None
        self.servo.set_position(angles)

    def restore_executor(self) -> None:
        """Return control to the program's executor if the arm is at rest and has no points."""
        if not self.in_motion and not self.executor.moving:
            self.end_recovery()
            if self.executor is not self.program_executor:
                self.program_executor.set_position(self.executor.position)
                self._set_executor(self.program_executor)
