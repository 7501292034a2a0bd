# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Estimates from a stream's setpoints: target, velocity, speed and lag of the arm."""

from bisect import bisect_right
from collections import deque
from dataclasses import dataclass
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from epson_driver.driver.servo.setpoint import Setpoint, contradiction
from epson_driver.driver.state.robot_state import JointSample
from epson_driver.motion import Array, JointLimits
from epson_driver.motion.setpoint_tracker import ServoTarget, stopping_distance

FIT_SPANS_S = (0.8, 0.3, 0.14)
"""Spans of setpoints that may be fitted together, s. The longest span in which the setpoints are a
line apart from noise is used. The shortest span is fitted with a parabola, however noisy it is."""

NOISE = 1.5e-3
"""Maximum rms deviation from a line that counts as noise, rad or m."""

RANDOM = 1.0
"""Minimum ratio of squared successive differences to squared deviations for noise (von Neumann's
ratio: 2 for noise, 0 for a curve)."""

SIGNIFICANT = 4.0
"""Multiple of a slope's variance from noise that is subtracted from its square. A slope whose
square is smaller is treated as 0."""

LAG_S = 0.034
"""Age of the position that is followed in a stream of positions, s. It ensures that setpoints are
known on both sides of that position."""

LAG_WITH_VELOCITIES_S = 0.004
"""The same lag for setpoints with velocities."""

FRESH_S = 0.07
"""Time for which a setpoint is extrapolated, s. Afterward the arm rests at that setpoint."""

PASSED = 1e-3
"""Maximum distance beyond a setpoint at which a stream stops, rad or m."""

ABRUPT = 0.2
"""Minimum change of velocity from one setpoint to the next that is abrupt, rad/s or m/s."""

ABRUPT_SHARE = 0.8
"""Minimum change as a fraction of the larger velocity, which also has to be exceeded. A stream
that starts abruptly may also stop abruptly."""

FORGET_S = 30.0
"""Time constant for forgetting abrupt changes, s. One gentle reversal clears them immediately."""

MIN_SPAN_S = 0.01
"""Minimum interval for estimating velocity, s. Closer arrivals are network bunching."""

OLDEST_SHARE = 0.2
"""Filter weight of a new setpoint in the usual age of a setpoint before the next one."""

ABRUPT_MARGIN = 1.2
"""Expected size of the next abrupt stop, as a multiple of the largest abrupt change."""

MIN_FITTED = 6
"""Minimum number of setpoints for estimating noise."""

ROUNDING = 1e-12
"""Maximum difference between positions that count as equal, rad or m."""


TINY = 1e-30


class StreamFilter:
    """Estimates where the joints are to be from setpoints that are late, noisy or missing.

    A line is fitted through the longest span of setpoints whose deviations from it are noise.
    Janabi-Sharifi et al. (2000) choose the span for encoder velocities in this manner. If even a
    short span is not a line, a parabola is fitted through the newest setpoints. The followed
    position is a little in the past of the fit, where it is known best. Given velocities are
    integrated first, so that only the remainder of the positions is fitted.

    The joints do not pass a position where the stream stops, as far as they can stop there. A
    stream that has once changed its velocity abruptly may do so again. It is therefore followed at
    the distance needed to stop from such a velocity. A stream that moves like a machine or a hand
    decelerates before its end, so it needs no such distance. Times are the loop's, s.
    """

    def __init__(self, limits: JointLimits) -> None:
        """Set the limits with which the joints stop."""
        self._limits = limits
        none = np.zeros((0, len(limits.names)))
        self._times = np.zeros(0)
        self._positions = self._velocities = self._led = none
        """Setpoint times, shape (k,), positions, velocities and their integral, shape (k, n)."""
        self._fit: tuple[Array, ...] = ()
        """Time in the middle, and value, slope and second derivative there, each of shape (n,)."""
        self._speed = self._abrupt = none.sum(axis=0)
        """Last velocity between two setpoints, and largest abrupt change that is remembered."""
        self._age = self._oldest = 0.0
        """Age of the newest setpoint at the last step, and usual age when the next one arrives."""

    def add(self, time: float, positions: Array, velocities: Array | None = None) -> Array:
        """Add a setpoint with shapes (n,), and return the stream's minimum speed, shape (n,).

        It is the smaller of the fitted velocity and the velocity over the last step.
        """
        limits = self._limits
        position = np.clip(positions, limits.position_min, limits.position_max)
        velocity = np.zeros_like(position) if velocities is None else velocities
        velocity = np.clip(velocity, -limits.velocity, limits.velocity)
        led = np.zeros_like(position)
        if (before := len(self._times)) and time > self._times[-1]:
            span = time - self._times[-1]
            led = self._led[-1] + span * (self._velocities[-1] + velocity) / 2.0
            report = (position - self._positions[-1]) / max(span, MIN_SPAN_S)
            self._see_speed(velocity if velocity.any() else report, span)
            self._oldest += OLDEST_SHARE * (self._age - self._oldest)
            first = int(np.searchsorted(self._times, time - FIT_SPANS_S[0]))
        elif before:  # at the same time: replaces the previous setpoint
            first, led, time = 0, self._led[-1], float(self._times[-1])
            self._times, self._positions, self._velocities, self._led = (
                item[:-1] for item in (self._times, self._positions, self._velocities, self._led)
            )
        else:
            self._see_speed(velocity, 0.0)
            first = 0
        self._times = np.append(self._times[first:], time)
        self._positions = np.concatenate([self._positions[first:], position[None]])
        self._velocities = np.concatenate([self._velocities[first:], velocity[None]])
        self._led = np.concatenate([self._led[first:], led[None]])
        self._fit = self._fitted()
        middle, _, slope, curvature = self._fit
        speed = velocity + slope + curvature * (time - middle)
        lower = np.minimum(np.abs(speed), np.abs(self._speed))
        return np.where(speed * self._speed > 0.0, lower, 0.0)

    def _see_speed(self, speed: Array, span: float) -> None:
        """Compare the velocity between two setpoints with the previous one."""
        change = np.abs(speed - self._speed)
        fastest = np.maximum(np.abs(speed), np.abs(self._speed))
        abrupt = (change > ABRUPT) & (change > ABRUPT_SHARE * fastest)
        turned = (speed * self._speed < 0.0) & np.logical_not(abrupt)
        remembered = np.where(turned, 0.0, self._abrupt * np.exp(-span / FORGET_S))
        self._abrupt = np.maximum(remembered, np.where(abrupt, change, 0.0))
        self._speed = speed

    def _fitted(self) -> tuple[Array, ...]:
        """Fit the positions minus the integrated velocities, in the longest suitable span."""
        report = self._positions - self._led
        count = report.shape[1]
        chosen = np.zeros((4, count))
        open_ = np.ones(count, dtype=bool)
        now = self._times[-1]
        for span in FIT_SPANS_S:
            first = int(np.searchsorted(self._times, now - span - 1e-6))
            times, values = self._times[first:], report[first:]
            last = span == FIT_SPANS_S[-1]
            if not last and len(times) < MIN_FITTED:
                continue
            fit, noise = _line(times, values) if not last else (_parabola(times, values), None)
            chosen[:, open_] = fit[:, open_]
            if noise is not None:
                open_ = open_ & np.logical_not(noise)
            if not open_.any():
                break
        first = int(np.searchsorted(self._times, now - FIT_SPANS_S[-1]))
        resting = np.ptp(self._positions[first:], axis=0) < ROUNDING
        resting &= ~np.any(self._velocities[first:], axis=0)
        chosen[1] = np.where(resting, report[-1], chosen[1])
        chosen[2:, resting] = 0.0
        return tuple(chosen)

    def aim(self, now: float, ahead: float = 0.0) -> ServoTarget:
        """Return the target of the joints at `now`, a time later than all setpoints.

        `ahead`: time by which the current step is longer than usual, s. A stop starts earlier by
        this time.
        """
        times, limits = self._times, self._limits
        age = float(now - times[-1])
        self._age = age - ahead
        lag = LAG_WITH_VELOCITIES_S if self._velocities[-1].any() else LAG_S
        if age > FRESH_S:
            position, still = self._positions[-1], np.zeros_like(self._speed)
            return ServoTarget(position, still, still, position - PASSED, position + PASSED)
        middle, value, slope, curvature = self._fit
        time = now - lag
        index = max(int(np.searchsorted(times, time, side='right')) - 1, 0)
        velocity, acceleration, since = self._velocities[index], 0.0 * slope, time - times[index]
        if index + 1 < len(times):
            acceleration = (self._velocities[index + 1] - velocity) / (
                times[index + 1] - times[index]
            )
        elif velocity.any():
            before = max(index - 3, 0)
            span = max(times[index] - times[before], 2.0 * MIN_SPAN_S)
            acceleration = (velocity - self._velocities[before]) / span
        led = self._led[index] + since * (velocity + since * acceleration / 2.0)
        away = time - middle
        position = value + away * (slope + away * curvature / 2.0) + led
        velocity = velocity + since * acceleration + slope + away * curvature
        acceleration = acceleration + curvature
        # the minimum that the stream shows: it may stop there
        newest = self._positions[-1] + age * self._velocities[-1]
        shown = np.concatenate([self._positions[index:], newest[None]])
        # the fitted velocity stays between the velocities of the adjacent setpoints
        last = slice(max(index - 1, 0), None)
        if len(times[last]) > 1 and not self._velocities[-1].any():
            steps = np.diff(self._positions[last], axis=0) / np.diff(times[last])[:, None]
            steps = np.concatenate([steps, self._velocities[last]])
            within = np.clip(velocity, steps.min(axis=0), steps.max(axis=0))
            acceleration = np.where(within == velocity, acceleration, 0.0)
            velocity = within
        speed = np.abs(velocity)
        abrupt = np.minimum(speed, ABRUPT_MARGIN * self._abrupt)
        way = stopping_distance(limits, abrupt)
        stop = way + abrupt * (self._oldest - lag)
        # the same delay for all joints, so that they stay on their line
        back = speed * max(float(np.max(stop / np.maximum(speed, TINY))), 0.0)
        on = np.maximum(stopping_distance(limits, speed) + speed * (age - lag) - back, 0.0)
        low = shown.min(axis=0) - PASSED - np.where(velocity < 0.0, on, 0.0)
        high = shown.max(axis=0) + PASSED + np.where(velocity > 0.0, on, 0.0)
        position = np.clip(position, low, high) - np.sign(velocity) * back
        been = self._positions[int(np.searchsorted(times, now - FIT_SPANS_S[1])) :]
        position = np.clip(
            position,
            np.minimum(low, been.min(axis=0, initial=np.inf)),
            np.maximum(high, been.max(axis=0, initial=-np.inf)),
        )
        return ServoTarget(position, velocity, acceleration, low, high)


def _line(times: Array, values: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Fit lines to values of shape (k, n), k ≥ 3 (format of `StreamFilter._fit`).

    Return the fits, and whether their residuals are noise, shape (n,).
    """
    middle = times.mean()
    away = times - middle
    mean = values.mean(axis=0)
    off = values - mean
    spread = float(away @ away)
    slope = (away @ off) / spread
    left = off - away[:, None] * slope
    squares = (left * left).sum(axis=0)
    variance = squares / (len(times) - 2)
    steps = np.diff(left, axis=0)
    noise = (variance <= NOISE**2) & ((steps * steps).sum(axis=0) >= RANDOM * squares)
    certain = 1.0 - SIGNIFICANT * variance / spread / np.maximum(slope * slope, TINY)
    slope = slope * np.maximum(certain, 0.0)
    return np.array([np.full_like(mean, middle), mean, slope, np.zeros_like(mean)]), noise


def _parabola(times: Array, values: Array) -> Array:
    """Fit parabolas to values of shape (k, n), or lines to fewer than four."""
    middle = times.mean()
    away = times - middle
    mean = values.mean(axis=0)
    spread = float(away @ away)
    fit = np.zeros((4, values.shape[1]))
    fit[0], fit[1] = middle, mean
    if len(times) < 2:
        return fit
    fit[2] = (away @ (values - mean)) / spread
    if len(times) < 4:
        return fit
    cubes, square = float((away**3).sum()) / spread, spread / len(times)
    bend = away * away - cubes * away - square  # orthogonal to points and lines
    curvature = (bend @ values) / float(bend @ bend)
    fit[1] -= curvature * square
    fit[2] -= curvature * cubes
    fit[3] = 2.0 * curvature
    return fit


MOVED = 1e-3
"""Minimum displacement that shows the arm's direction, rad or m."""

CHECK_MEMORY_S = 0.4
"""Maximum age of setpoints that are compared, s."""

BEHIND_S = 0.1
"""Maximum delay of positions relative to the integral of their velocities, s."""

TRUSTED_AFTER_S = 0.15
"""Time of agreement between velocities and positions until velocities are trusted, s."""


class VelocityCheck:
    """Compares positions with the integral of their velocities, over CHECK_MEMORY_S."""

    def __init__(self, limits: JointLimits) -> None:
        self._limits = limits
        self._seen: deque[tuple[float, Array, Array]] = deque()
        self.trusted = False
        """Whether the positions have agreed with the velocities for long enough."""

    def add(self, time: float, positions: Array, velocities: Array) -> str | None:
        """Add a setpoint with shapes (n,), received at `time` s, and return a contradiction.

        Returns None if the positions agree with the velocities.
        """
        seen = self._seen
        if seen and time - seen[-1][0] > CHECK_MEMORY_S:
            seen.clear()
        seen.append((time, positions, velocities))
        while time - seen[0][0] > CHECK_MEMORY_S:
            seen.popleft()
        self.trusted = False
        if len(seen) < 2:
            return None
        times = np.array([item[0] for item in seen])
        claimed = np.array([item[2] for item in seen])
        led = np.diff(times) @ (claimed[:-1] + claimed[1:]) / 2.0
        moved = positions - seen[0][1]
        message = contradiction(moved[None], led[None], claimed, self._limits, BEHIND_S)
        self.trusted = message is None and time - seen[0][0] >= TRUSTED_AFTER_S
        return message


MAX_EXTRAPOLATION_S = 0.04
"""Time for which a setpoint is extrapolated with its last velocity, s. It lasts until the next one
comes, in streams of 30 Hz and more."""


class StreamReference:
    """Positions and velocities over time, from one position setpoint.

    All points of a window are used, within the range and the velocity limits. Times count from the
    arrival of the setpoint, s. `estimate`: velocities for a setpoint without any, shape (n,).
    """

    def __init__(
        self, setpoint: Setpoint, limits: JointLimits, estimate: Array | None = None
    ) -> None:
        assert setpoint.positions is not None  # noqa: S101 - the caller checks the mode
        window = setpoint.window
        if window is None:
            times, positions = np.zeros(1), setpoint.positions[None]
            given = setpoint.velocities if setpoint.velocities is not None else estimate
            velocities = np.zeros_like(positions) if given is None else given[None]
        else:
            times, positions = window.times, window.positions
            velocities = (
                np.gradient(positions, times, axis=0)
                if window.velocities is None
                else window.velocities
            )
        self._times: list[float] = times.tolist()
        self._positions = np.clip(positions, limits.position_min, limits.position_max)
        self._velocities = np.clip(velocities, -limits.velocity, limits.velocity)
        self.fastest: Array = np.abs(self._velocities).max(axis=0)
        """Highest speed of each joint, shape (n,)."""

    @property
    def reach(self) -> float:
        """Time after its arrival for which a setpoint is known, s (0: a single setpoint)."""
        return max(self._times[-1], 0.0)

    def aim(self, time: float, dt: float, limits: JointLimits) -> ServoTarget:
        """Return the target at a time of a window, for a step of `dt` s.

        The joints pass neither the later points nor the stopping position at the window's end.
        """
        position, velocity = self.at(time)
        acceleration = (velocity - self.at(time - dt)[1]) / dt
        end, speed = self.at(max(time, self._times[-1]))
        stop = end + stopping_distance(limits, speed)
        later = self._positions[bisect_right(self._times, time) :]
        shown = np.concatenate([later, position[None], stop[None]])
        low, high = shown.min(axis=0) - PASSED, shown.max(axis=0) + PASSED
        return ServoTarget(position, velocity, acceleration, low, high)

    def at(self, time: float) -> tuple[Array, Array]:
        """Return position and velocity at a time, shapes (n,).

        Between points a cubic is used. Before the first point the joints are at rest. After the
        last point its velocity continues for MAX_EXTRAPOLATION_S.
        """
        times, positions, velocities = self._times, self._positions, self._velocities
        if time >= times[-1]:
            on = min(time - times[-1], MAX_EXTRAPOLATION_S)
            return positions[-1] + on * velocities[-1], velocities[-1]
        index = bisect_right(times, time) - 1
        if index < 0:
            return positions[0], velocities[0]
        span = times[index + 1] - times[index]
        s = (time - times[index]) / span
        before, after = positions[index], positions[index + 1]
        leaving, arriving = velocities[index] * span, velocities[index + 1] * span
        # Hermite's cubic, as before + s·leaving + s²·b + s³·a
        a = 2.0 * (before - after) + leaving + arriving
        b = 3.0 * (after - before) - 2.0 * leaving - arriving
        position = before + s * (leaving + s * (b + s * a))
        velocity = (leaving + s * (2.0 * b + s * 3.0 * a)) / span
        return position, velocity


PACE_SPAN_S = 0.1
"""Minimum duration of a step for estimating its speed, s: messages may come in bursts."""

PACE_MEMORY_S = 0.5
"""Minimum time for which a speed is remembered, s."""


@dataclass(slots=True)
class _Passage:
    """Position and speed of a stream at a time, s, shapes (n,)."""

    time: float
    position: Array
    speed: Array


class StreamSpeedEstimator:
    """Estimates the speed of a stream of positions over the path that is still to be followed.

    The first step starts at the arm's position `start`, shape (n,). Times are the loop's, s.
    """

    def __init__(self, start: Array, time: float) -> None:
        first = _Passage(time - PACE_SPAN_S, start, np.zeros_like(start))
        self._way = deque([first], maxlen=MAX_SENT)
        self._passed = 0

    def add(self, time: float, reference: StreamReference) -> None:
        """Add a setpoint of the stream, later than the previous ones."""
        position, _ = reference.at(0.0)
        before = next(
            (item for item in reversed(self._way) if time - item.time >= PACE_SPAN_S), self._way[0]
        )
        span = max(time - before.time, PACE_SPAN_S)
        speed = np.maximum(np.abs(position - before.position) / span, reference.fastest)
        self._passed -= len(self._way) == self._way.maxlen
        self._way.append(_Passage(time, position, speed))

    def see(self, time: float, position: Array) -> float:
        """Return how far a commanded position of the arm, shape (n,), is behind the stream, s."""
        way = self._way
        first = max(self._passed, 0)
        if float(np.abs(way[-1].position - position).max()) <= NEAR:
            first = len(way) - 1
        else:
            ahead = np.array([item.position for item in islice(way, first, first + NEXT)])
            first += int(np.argmin(np.abs(ahead - position).max(axis=1)))
        behind = 0.0 if first == len(way) - 1 else way[-1].time - way[first].time
        while first and time - way[0].time > PACE_MEMORY_S:
            way.popleft()
            first -= 1
        self._passed = first
        return behind

    def fastest(self) -> Array:
        """Return the highest speed of each joint on that path, shape (n,)."""
        speeds: Array = np.array([item.speed for item in self._way]).max(axis=0)
        return speeds


NEAR = 1e-3
"""Distance to the last setpoint, rad or m, within which the arm has reached it."""

MAX_SENT = 256
"""Maximum number of stored setpoints, which cover five seconds."""

BEHIND_FILTER_S = 0.2
"""Time constant for smoothing the lag of the arm, s."""

NEXT = 25
"""Number of setpoints compared with the arm's position, from the last nearest one."""


class StreamLag:
    """Compares the arm's position with the positions sent. Times are the loop's, s."""

    def __init__(self) -> None:
        self.now = 0.0
        """Time from sending the arm's current position to its newest measurement, s. It is 0 if
        the arm is at the position that was sent last."""
        self.behind = 0.0
        """The same, smoothed over samples in motion. Samples at the last position sent are
        ignored: an arm that moves from point to point is there whenever it receives the next."""
        self._seen = 0.0
        self._sent: deque[tuple[float, Array]] = deque(maxlen=MAX_SENT)
        self._from: Array | None = None
        self._direction: Array = np.zeros(0)
        """Last step of the arm of more than MOVED, and its end, shapes (n,)."""

    @property
    def ahead(self) -> float:
        """Time by which the points sent are ahead of the arm, s. It shrinks if none are added."""
        return self._sent[-1][0] - self._sent[0][0] if self._sent else 0.0

    def sent(self, time: float, position: Array) -> None:
        """Record a position that was sent, shape (n,)."""
        self._sent.append((time, position))

    def see(self, sample: JointSample) -> None:
        """Update the lag from a sample of the arm's position."""
        sent = self._sent
        if not sent:
            return
        moved = sample.positions - (sample.positions if self._from is None else self._from)
        if self._from is None or np.abs(moved).max() > MOVED:
            self._from, self._direction = sample.positions, moved
        if float(np.abs(sent[-1][1] - sample.positions).max()) <= NEAR:
            passed, self.now = len(sent) - 1, 0.0
        else:
            near = np.array([position for _, position in islice(sent, NEXT)])
            passed = self._passed(near, sample.positions)
            self.now = max(sample.measured - sent[passed][0], 0.0)
            fraction = min((sample.measured - self._seen) / BEHIND_FILTER_S, 1.0)
            self.behind += fraction * (self.now - self.behind)
        self._seen = sample.measured
        for _ in range(passed):
            sent.popleft()

    def _passed(self, near: Array, position: Array) -> int:
        """Return the index of the position sent, shape (k, n), that the arm passed last.

        On a path to and fro the arm is near a position twice, and its direction shows which one it
        is. The nearest position with motion in that direction is returned, unless it is farther
        away than the overall nearest position by more than half a step.
        """
        away = np.abs(near - position).max(axis=1)
        nearest = int(np.argmin(away))
        ways = np.diff(near, axis=0)
        along = ways @ self._direction > 0.0
        if not along.any():
            return nearest
        result = int(np.argmin(np.where(along, away[:-1], np.inf)))
        step = float(np.abs(ways[result]).max())
        return result if away[result] <= away[nearest] + step / 2.0 else nearest
