# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Motion along the setpoints of a stream, which are followed instead of planned.

A stream is known only a few points ahead. A plan through these points would have to end at rest at
the last known point, so the arm would brake and accelerate again with every new point. Instead, a
tracker follows the setpoints at the times that the stream specifies, a little behind the newest
setpoint. Its motion always ends at rest.
"""

from bisect import bisect_right

import numpy as np

from epson_driver.motion import Array, JointLimits
from epson_driver.motion.joint_motion import State
from epson_driver.motion.setpoint_tracker import ServoTarget, SetpointTracker

CYCLE_S = 0.004
"""Period with which the target is updated, s. Setpoints that are closer in time are merged."""

RESERVE_POINTS = 4  # number of known setpoints at which the motion starts

MAX_START_DELAY_S = 0.1
"""Time after the last setpoint, s, at which the motion starts although few setpoints are known."""

RAMP_S = 0.25  # time to regain the full speed after a hold, s

NEAR, FAR = 0.01, 0.02
"""Distances of the arm from its target, rad or m. If the arm is farther away than NEAR, the time
of the stream advances more slowly. At FAR this time stops until the arm is closer."""

PASSED = 3e-4
"""Distance by which the arm may pass the last known setpoint, rad or m.

It is not 0, because the stream may reverse its direction between two setpoints.
"""

ROUNDING = 1e-8  # distance that may be due to rounding, rad or m
INTERPOLATED = 4  # setpoints per interpolating polynomial
POWERS = np.arange(INTERPOLATED)

REST_BEFORE_S = 0.02  # spacing of the setpoints for the rest before the stream


class SetpointFollower:
    """The motion of an arm that follows setpoints, from rest at `position`, shape (n,), rad or m.

    It respects `limits` at every instant. If no further setpoint arrives, it comes to rest at the
    last one. It passes this setpoint by more than PASSED only if the limits leave no choice.
    """

    def __init__(self, limits: JointLimits, position: Array) -> None:
        self.limits = limits
        self._tracker = SetpointTracker(limits, position)
        self._times: list[float] = (REST_BEFORE_S * np.arange(1.0 - INTERPOLATED, 1.0)).tolist()
        self._positions = [position] * INTERPOLATED
        self._clock = 0.0  # time of the stream that the arm has reached, s
        self._rate = 1.0  # ratio of stream time to real time, 0 to 1
        self._age = 0.0  # time since the last setpoint arrived, s
        self._due = 0.0  # time until the target is updated, s
        self._started = False
        self._held = False

    def append(self, position: Array, duration: float | None) -> None:
        """Add a setpoint, `duration` s after the previous one (None: as fast as possible)."""
        self._age = 0.0
        if duration is None or duration < CYCLE_S:
            self._times[-1] += duration or 0.0
            self._positions[-1] = position
            return
        self._times.append(self._times[-1] + duration)
        self._positions.append(position)

    @property
    def state(self) -> State:
        return self._tracker.state

    @property
    def look_ahead(self) -> float:
        """Time between the arm's target and the newest setpoint, on the clock of the stream, s."""
        return self._times[-1] - self._clock

    @property
    def points_ahead(self) -> int:
        return len(self._times) - bisect_right(self._times, self._clock)

    @property
    def at_rest(self) -> bool:
        return self._tracker.at_rest

    @property
    def moving(self) -> bool:
        distance = np.abs(self._tracker.motion.end - self._positions[-1]).max()
        return bool(self.points_ahead or not self.at_rest or distance > ROUNDING)

    def finish(self) -> None:
        """Do nothing, because a stream that starts during the motion continues this one."""

    def change_limits(self, limits: JointLimits) -> None:
        """Replace the limits of an arm at rest. The position limits must be the same."""
        self.limits = limits
        self._tracker = SetpointTracker(limits, self._tracker.state[0])

    def stop(self) -> None:
        """Discard all setpoints and brake as fast as the limits permit."""
        self._tracker.brake()
        self._clock = self._times[-1]
        self._positions[-1] = self._tracker.motion.end

    def hold(self) -> None:
        """Brake as fast as the limits permit, and keep the setpoints until the motion resumes."""
        self._held = True
        self._tracker.brake()
        self._rate = 0.0
        times = np.arange(self._clock, self._times[-1], CYCLE_S).tolist()
        away = [np.abs(self._at(time)[0] - self._tracker.motion.end).max() for time in times]
        if times:
            self._clock = times[int(np.argmin(away))]

    def resume(self) -> None:
        self._held = False

    def step(self, dt: float) -> None:
        self._age += dt
        while dt > 0.0:
            if self._due <= 0.0:
                self._due = CYCLE_S
                if not self._held:
                    self._aim()
            part = min(dt, self._due)
            self._tracker.step(part)
            self._due -= part
            dt -= part

    def _aim(self) -> None:
        ahead = self.points_ahead
        self._started = ahead > 0 and (
            self._started or ahead >= RESERVE_POINTS or self._age >= MAX_START_DELAY_S
        )
        if not self._started:
            if self.moving and not ahead:
                self._tracker.land(self._positions[-1], PASSED)
            return
        position, _, _ = self._tracker.state
        self._rate = min(self._rate + CYCLE_S / RAMP_S, 1.0)
        behind = float(np.abs(self._at(self._clock)[0] - position).max())
        rate = self._rate * min(max((FAR - behind) / (FAR - NEAR), 0.0), 1.0)
        self._clock = min(self._clock + rate * CYCLE_S, self._times[-1])
        target, velocity, acceleration = self._at(self._clock)
        first = bisect_right(self._times, self._clock)
        shown = np.array([target, *self._positions[first:]])
        aim = ServoTarget(
            target,
            rate * velocity,
            rate**2 * acceleration,
            shown.min(axis=0) - PASSED,
            shown.max(axis=0) + PASSED,
        )
        self._tracker.follow(CYCLE_S, aim)
        old = max(first - INTERPOLATED, 0)
        del self._times[:old], self._positions[:old]

    def _at(self, time: float) -> State:
        times = self._times
        if time >= times[-1]:
            rest = np.zeros_like(self._positions[-1])
            return self._positions[-1], rest, rest
        last = min(bisect_right(times, time) + INTERPOLATED // 2, len(times))
        chosen = slice(last - INTERPOLATED, last)
        offsets = np.array(times[chosen]) - time
        unit = offsets[-1] - offsets[0]
        coefficients = np.linalg.solve(
            (offsets / unit)[:, None] ** POWERS, np.array(self._positions[chosen])
        )
        return coefficients[0], coefficients[1] / unit, 2.0 * coefficients[2] / unit**2
