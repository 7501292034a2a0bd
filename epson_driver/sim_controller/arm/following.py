# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Setpoints that replace each other: the arm follows the newest one, in every cycle.

Rules:

* A setpoint is taken while the arm has no points. What the arm does is always a whole motion that
  ends at rest inside all limits (motion/setpoint_tracker.py); each cycle replaces it by one
  towards where the setpoint has gone on to, if there is one.
* Silence of SILENCE_S brakes on the spot, unless the arm is about to rest anyway.
* Whatever stops or holds the arm ends the stream: it brakes, and nothing goes on after a hold.
* Where it rests, the executor of points begins again; points that come meanwhile wait.
"""

from dataclasses import replace

import numpy as np

from epson_driver.motion import Array, JointLimits
from epson_driver.motion.setpoint_tracker import SetpointTracker
from epson_driver.sim_controller.arm.executor import Executor, Point

SILENCE_S = 0.1
"""So long after the last setpoint the arm brakes, s."""

GOES_ON_S = 0.06
"""A setpoint goes on with its velocity for so long, s: three periods of a stream of 50 Hz."""


class Following:
    """An executor of points that also follows setpoints.

    `low_power_limits` count instead of the executor's limits in a stream that begins while
    `low_power` is set.
    """

    def __init__(self, points: Executor, low_power_limits: JointLimits) -> None:
        self.limits = points.limits
        self._points = points
        self._low_power_limits = low_power_limits
        self.tracker: SetpointTracker | None = None
        """Moves the arm after setpoints; None while it rests, or has points."""
        self._target = points.position
        self._velocity = np.zeros_like(self._target)
        self._age = 0.0
        self._ended = False
        self._held = False

    # --- setpoints --------------------------------------------------------------------------

    @property
    def following(self) -> bool:
        """Whether it moves after setpoints, or brakes after them."""
        return self.tracker is not None

    @property
    def ready(self) -> bool:
        """Whether it may take a setpoint now: it has no points, is not held, does not brake."""
        if self.tracker is not None:
            return not self._ended
        return not self._held and not self._points.moving and self._points.has_room

    def follow(self, target: Array, velocity: Array, scale: float = 1.0) -> None:
        """Be at a target, which moves on with a velocity: finite numbers, shapes (n,).

        `scale`: the share (0, 1] of all limits that the arm may use, which counts where it begins
        at rest. Only while it is ready.
        """
        if self.tracker is None:
            self.tracker = SetpointTracker(_scaled(self._power_limits, scale), self.position)
            self._ended = False
        fastest = self.tracker.limits.velocity
        self._target, self._age = target, 0.0
        self._velocity = np.clip(velocity, -fastest, fastest)
        self._aim(self.tracker)

    @property
    def _power_limits(self) -> JointLimits:
        return self._low_power_limits if self.low_power else self.limits

    def _aim(self, tracker: SetpointTracker) -> None:
        if self._ended or self._age >= SILENCE_S:
            tracker.brake()
            return
        on = min(self._age, GOES_ON_S)
        tracker.follow(self._target + on * self._velocity, self._velocity)

    def _end(self) -> None:
        """Follow no further setpoint, and brake with all that the arm has."""
        if self.tracker is not None:
            self._ended = True
            self.tracker.limits = self.limits
            self.tracker.brake()

    # --- as an executor ---------------------------------------------------------------------

    @property
    def low_power(self) -> bool:
        """See Executor."""
        return self._points.low_power

    @low_power.setter
    def low_power(self, value: bool) -> None:
        self._points.low_power = value

    @property
    def speed(self) -> float:
        """See Executor."""
        return self._points.speed

    @speed.setter
    def speed(self, value: float) -> None:
        self._points.speed = value

    @property
    def accel(self) -> float:
        """See Executor."""
        return self._points.accel

    @accel.setter
    def accel(self, value: float) -> None:
        self._points.accel = value

    @property
    def begun(self) -> int:
        """See Executor."""
        return self._points.begun

    @property
    def position(self) -> Array:
        """See Executor."""
        return self._points.position if self.tracker is None else self.tracker.state[0]

    @property
    def velocity(self) -> Array:
        """See Executor."""
        return self._points.velocity if self.tracker is None else self.tracker.state[1]

    @property
    def moving(self) -> bool:
        """See Executor."""
        return self.following or self._points.moving

    @property
    def still(self) -> bool:
        """See Executor."""
        return not self.following and self._points.still

    @property
    def has_room(self) -> bool:
        """See Executor; points wait until the arm rests after setpoints."""
        return not self.following and self._points.has_room

    @property
    def done(self) -> bool:
        """See Executor."""
        return self._points.done

    def take(self, point: Point) -> None:
        """See Executor."""
        self._points.take(point)

    def stop(self) -> bool:
        """See Executor; setpoints are not among the points that are forgotten."""
        self._end()
        self._held = False
        return self._points.stop()

    def hold(self) -> None:
        """See Executor; setpoints are not kept."""
        self._end()
        self._held = True
        self._points.hold()

    def resume(self) -> None:
        """See Executor."""
        self._held = False
        self._points.resume()

    def settle(self, position: Array) -> None:
        """See Executor."""
        if self.following:
            raise RuntimeError('the arm follows setpoints: it cannot be moved by hand')
        self._points.settle(position)

    def step(self, dt: float) -> float | None:
        """See Executor."""
        tracker = self.tracker
        if tracker is None:
            return self._points.step(dt)
        tracker.step(dt)
        self._age += dt
        self._aim(tracker)
        if tracker.at_rest and (self._ended or self._age >= SILENCE_S or not self._goes_on()):
            self.tracker = None
            self._points.settle(tracker.state[0])
        return None

    def _goes_on(self) -> bool:
        """Return whether the setpoint moves on."""
        return bool(np.any(self._velocity)) and self._age < GOES_ON_S


def _scaled(limits: JointLimits, scale: float) -> JointLimits:
    """Return a share (0, 1] of all limits but those of the position."""
    return replace(
        limits,
        velocity=scale * limits.velocity,
        acceleration=scale * limits.acceleration,
        jerk=scale * limits.jerk,
    )
