# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Estimates from the setpoints of a stream: target of the arm, speed of the stream, lag."""

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
"""Time spans for fitting setpoints, s. The longest span in which all deviations from a line are
noise is used. If there is no such span, a parabola is fitted in the shortest span."""

NOISE = 1.5e-3  # maximum rms deviation from a line that counts as noise, rad or m

RANDOM = 1.0
"""Minimum ratio of squared successive differences to squared deviations that counts as noise. It
is von Neumann's ratio, which is 2 for noise and 0 for a curve."""

SIGNIFICANT = 4.0
"""Multiple of a slope's variance that is subtracted from the slope's square, so that a slope that
noise can explain is treated as 0."""

LAG_S = 0.034
"""Age of the position that the arm follows in a stream of positions, s. At this age, setpoints
before and after the position are known."""

LAG_IN_REAL_TIME_S = 0.002
"""Age of the followed position if the arm gets a target in each control cycle, s. The stream is
extrapolated to this age."""

LAG_WITH_VELOCITIES_S = 0.004  # the same if the setpoints have velocities
FRESH_S = 0.07  # time for which a setpoint is extrapolated, s. After it the arm stops there
PASSED = 1e-3  # tolerance by which the arm may pass the last setpoint of a stream, rad or m
ABRUPT = 0.2  # minimum abrupt change of velocity between two setpoints, rad/s or m/s
ABRUPT_FRACTION = 0.8  # the same as a fraction of the larger velocity
FORGET_S = 30.0  # time constant for forgetting abrupt changes, s. A gentle reversal clears them
MIN_SPAN_S = 0.01  # minimum interval for a velocity, s. Network delays cause shorter ones
AGE_FILTER_WEIGHT = 0.2  # weight of a new value in the average age of replaced setpoints
ABRUPT_MARGIN = 1.2  # the next abrupt stop, as a multiple of the largest abrupt change
MIN_FITTED = 6  # minimum number of setpoints for estimating noise
ROUNDING = 1e-12  # maximum difference between positions that count as equal, rad or m
TINY = 1e-30  # minimum divisor, which prevents a division by zero


class StreamFilter:
    """Estimates the target of the arm from position setpoints that are late, noisy or missing.

    A line is fitted to the longest span of setpoints whose deviations from the line are noise.
    Janabi-Sharifi et al. (2000) choose the span for encoder velocities in this manner. If a line
    does not even fit a short span, a parabola is fitted. The target lags a little behind the
    newest setpoint, because the fit is most accurate inside its span. If the setpoints have
    velocities, these are integrated, and only the difference to the positions is fitted.

    The arm passes the last setpoint of a stream only if its limits prevent an earlier stop. A
    stream that has changed its velocity abruptly may also end abruptly. The arm therefore follows
    such a stream at a distance in which it can stop. Other streams decelerate before they end, so
    the arm needs no such distance.
    Times are the event loop's, s. `limits`: limits with which the joints stop.
    """

    def __init__(self, limits: JointLimits) -> None:
        self._limits = limits
        empty = np.zeros((0, len(limits.names)))
        self._times = np.zeros(0)
        self._positions = self._velocities = self._integral = empty
        """Setpoint times, shape (k,), positions, velocities and their integral, shape (k, n)."""
        self._fit: tuple[Array, ...] = ()
        """Middle of the fitted span, and value, slope and second derivative at it, shapes (n,)."""
        self._speed = self._abrupt = empty.sum(axis=0)
        """Last velocity between two setpoints, and largest recent abrupt change, shape (n,)."""
        self._age = self._usual_age = 0.0
        """Age of the newest setpoint at the last step, and mean age of replaced setpoints, s."""

    def add(self, time: float, positions: Array, velocities: Array | None = None) -> Array:
        """Add a setpoint, and return an estimate of its velocity. All arrays have the shape (n,).

        The estimate is the smaller one of the fitted velocity and the velocity since the previous
        setpoint. If their signs differ, it is 0.
        """
        limits = self._limits
        position = np.clip(positions, limits.position_min, limits.position_max)
        velocity = np.zeros_like(position) if velocities is None else velocities
        velocity = np.clip(velocity, -limits.velocity, limits.velocity)
        integral = np.zeros_like(position)
        if (before := len(self._times)) and time > self._times[-1]:
            span = time - self._times[-1]
            integral = self._integral[-1] + span * (self._velocities[-1] + velocity) / 2.0
            mean = (position - self._positions[-1]) / max(span, MIN_SPAN_S)
            self._add_speed(velocity if velocity.any() else mean, span)
            self._usual_age += AGE_FILTER_WEIGHT * (self._age - self._usual_age)
            first = int(np.searchsorted(self._times, time - FIT_SPANS_S[0]))
        elif before:  # at the same time: replaces the previous setpoint
            first, integral, time = 0, self._integral[-1], float(self._times[-1])
            self._times, self._positions = self._times[:-1], self._positions[:-1]
            self._velocities, self._integral = self._velocities[:-1], self._integral[:-1]
        else:
            self._add_speed(velocity, 0.0)
            first = 0
        self._times = np.append(self._times[first:], time)
        self._positions = np.concatenate([self._positions[first:], position[None]])
        self._velocities = np.concatenate([self._velocities[first:], velocity[None]])
        self._integral = np.concatenate([self._integral[first:], integral[None]])
        self._fit = self._fitted()
        middle, _, slope, curvature = self._fit
        speed = velocity + slope + curvature * (time - middle)
        lower = np.minimum(np.abs(speed), np.abs(self._speed))
        return np.where(speed * self._speed > 0.0, lower, 0.0)

    def _add_speed(self, speed: Array, span: float) -> None:
        """Record a setpoint's velocity, and update the largest abrupt change of velocity.

        `span`: time since the previous setpoint, s.
        """
        change = np.abs(speed - self._speed)
        fastest = np.maximum(np.abs(speed), np.abs(self._speed))
        abrupt = (change > ABRUPT) & (change > ABRUPT_FRACTION * fastest)
        turned = (speed * self._speed < 0.0) & np.logical_not(abrupt)
        remembered = np.where(turned, 0.0, self._abrupt * np.exp(-span / FORGET_S))
        self._abrupt = np.maximum(remembered, np.where(abrupt, change, 0.0))
        self._speed = speed

    def _fitted(self) -> tuple[Array, ...]:
        differences = self._positions - self._integral
        count = differences.shape[1]
        chosen = np.zeros((4, count))
        undecided = np.ones(count, dtype=bool)
        now = self._times[-1]
        for span in FIT_SPANS_S:
            first = int(np.searchsorted(self._times, now - span - 1e-6))
            times, values = self._times[first:], differences[first:]
            last = span == FIT_SPANS_S[-1]
            if not last and len(times) < MIN_FITTED:
                continue
            fit, noise = _line(times, values) if not last else (_parabola(times, values), None)
            chosen[:, undecided] = fit[:, undecided]
            if noise is not None:
                undecided = undecided & np.logical_not(noise)
            if not undecided.any():
                break
        first = int(np.searchsorted(self._times, now - FIT_SPANS_S[-1]))
        resting = np.ptp(self._positions[first:], axis=0) < ROUNDING
        resting &= ~np.any(self._velocities[first:], axis=0)
        chosen[1] = np.where(resting, differences[-1], chosen[1])
        chosen[2:, resting] = 0.0
        return tuple(chosen)

    def aim(self, now: float, ahead: float = 0.0, lead: float = 0.0) -> ServoTarget:
        """Return the target `lead` s after `now`. `ahead`: how much too long this step is, s."""
        times, limits = self._times, self._limits
        age = float(now - times[-1])
        self._age = age - ahead
        without = LAG_IN_REAL_TIME_S if lead else LAG_S
        lag = LAG_WITH_VELOCITIES_S if self._velocities[-1].any() else without
        if age > FRESH_S:
            position, zero = self._positions[-1], np.zeros_like(self._speed)
            return ServoTarget(position, zero, zero, position - PASSED, position + PASSED)
        now, age = now + lead, age + lead
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
        integral = self._integral[index] + since * (velocity + since * acceleration / 2.0)
        offset = time - middle
        position = value + offset * (slope + offset * curvature / 2.0) + integral
        velocity = velocity + since * acceleration + slope + offset * curvature
        acceleration = acceleration + curvature
        # positions that the stream has reached: it may stop at one of them
        newest = self._positions[-1] + age * self._velocities[-1]
        shown = np.concatenate([self._positions[index:], newest[None]])
        # limit the fitted velocity to the velocities between the adjacent setpoints
        last = slice(max(index - 1, 0), None)
        if len(times[last]) > 1 and not self._velocities[-1].any():
            steps = np.diff(self._positions[last], axis=0) / np.diff(times[last])[:, None]
            steps = np.concatenate([steps, self._velocities[last]])
            within = np.clip(velocity, steps.min(axis=0), steps.max(axis=0))
            acceleration = np.where(within == velocity, acceleration, 0.0)
            velocity = within
        speed = np.abs(velocity)
        abrupt = np.minimum(speed, ABRUPT_MARGIN * self._abrupt)
        stop = stopping_distance(limits, abrupt) + abrupt * (self._usual_age - lag)
        # the same delay for all joints, so that they stay on their line
        distance = speed * max(float(np.max(stop / np.maximum(speed, TINY))), 0.0)
        # a stop must end the acceleration first, whose estimate is certain in gentle streams only
        gain = np.where(self._abrupt > 0.0, 0.0, np.sign(velocity) * acceleration)
        ends = np.clip(gain, 0.0, limits.acceleration) / limits.jerk
        before_stop = ends * (speed + limits.jerk * ends**2 / 3.0)
        stop = before_stop + stopping_distance(limits, speed + limits.jerk * ends**2 / 2.0)
        beyond = np.maximum(stop + speed * (age - lag) - distance, 0.0)
        low = shown.min(axis=0) - PASSED - np.where(velocity < 0.0, beyond, 0.0)
        high = shown.max(axis=0) + PASSED + np.where(velocity > 0.0, beyond, 0.0)
        position = np.clip(position, low, high) - np.sign(velocity) * distance
        recent = self._positions[int(np.searchsorted(times, now - FIT_SPANS_S[1])) :]
        position = np.clip(
            position,
            np.minimum(low, recent.min(axis=0, initial=np.inf)),
            np.maximum(high, recent.max(axis=0, initial=-np.inf)),
        )
        return ServoTarget(position, velocity, acceleration, low, high)


def _line(times: Array, values: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Fit a line to each column. Return `_fit`, and whether each column's residuals are noise."""
    middle = times.mean()
    offsets = times - middle
    mean = values.mean(axis=0)
    deviations = values - mean
    spread = float(offsets @ offsets)
    slope = (offsets @ deviations) / spread
    residuals = deviations - offsets[:, None] * slope
    squares = (residuals * residuals).sum(axis=0)
    variance = squares / (len(times) - 2)
    steps = np.diff(residuals, axis=0)
    noise = (variance <= NOISE**2) & ((steps * steps).sum(axis=0) >= RANDOM * squares)
    certain = 1.0 - SIGNIFICANT * variance / spread / np.maximum(slope * slope, TINY)
    slope = slope * np.maximum(certain, 0.0)
    return np.array([np.full_like(mean, middle), mean, slope, np.zeros_like(mean)]), noise


def _parabola(times: Array, values: Array) -> Array:
    """Fit a parabola to each column of `values`, shape (k, n), or a line if k < 4."""
    middle = times.mean()
    offsets = times - middle
    mean = values.mean(axis=0)
    spread = float(offsets @ offsets)
    fit = np.zeros((4, values.shape[1]))
    fit[0], fit[1] = middle, mean
    if len(times) < 2:
        return fit
    fit[2] = (offsets @ (values - mean)) / spread
    if len(times) < 4:
        return fit
    cubes, square = float((offsets**3).sum()) / spread, spread / len(times)
    bend = offsets * offsets - cubes * offsets - square  # orthogonal to constants and lines
    curvature = (bend @ values) / float(bend @ bend)
    fit[1] -= curvature * square
    fit[2] -= curvature * cubes
    fit[3] = 2.0 * curvature
    return fit


MOVED = 1e-3  # minimum displacement for determining the arm's direction of motion, rad or m
CHECK_MEMORY_S = 0.4  # maximum age of setpoints whose positions and velocities are compared, s
BEHIND_S = 0.1  # maximum delay of positions relative to the integral of their velocities, s
TRUSTED_AFTER_S = 0.15  # velocities must agree with the positions for this time


class VelocityCheck:
    def __init__(self, limits: JointLimits) -> None:
        self._limits = limits
        self._setpoints: deque[tuple[float, Array, Array]] = deque()
        self.trusted = False  # they have agreed for TRUSTED_AFTER_S

    def add(self, time: float, positions: Array, velocities: Array) -> str | None:
        """Add a setpoint.

        Return a text that describes how the positions contradict the velocities, or None.
        """
        setpoints = self._setpoints
        if setpoints and time - setpoints[-1][0] > CHECK_MEMORY_S:
            setpoints.clear()
        setpoints.append((time, positions, velocities))
        while time - setpoints[0][0] > CHECK_MEMORY_S:
            setpoints.popleft()
        self.trusted = False
        if len(setpoints) < 2:
            return None
        times = np.array([item[0] for item in setpoints])
        rates = np.array([item[2] for item in setpoints])
        integral = np.diff(times) @ (rates[:-1] + rates[1:]) / 2.0
        moved = positions - setpoints[0][1]
        problem = contradiction(moved[None], integral[None], rates, self._limits, BEHIND_S)
        self.trusted = problem is None and time - setpoints[0][0] >= TRUSTED_AFTER_S
        return problem


MAX_EXTRAPOLATION_S = 0.04
"""Time for which the last point of a setpoint is extrapolated with its velocity, s. It covers the
time until the next setpoint at rates of 30 Hz and more."""


class StreamReference:
    """Positions and velocities over time, from one position setpoint and its upcoming points.

    All values are clipped to the limits. Times are relative to the arrival of the setpoint, s.
    `estimate`: velocities, shape (n,), used if the setpoint has neither velocities nor a window.
    """

    def __init__(
        self, setpoint: Setpoint, limits: JointLimits, estimate: Array | None = None
    ) -> None:
        assert setpoint.positions is not None  # noqa: S101 - the caller checks the mode
        window = setpoint.window
        if window is None:
            times, positions = np.zeros(1), setpoint.positions[None]
            rates = setpoint.velocities if setpoint.velocities is not None else estimate
            velocities = np.zeros_like(positions) if rates is None else rates[None]
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
        self.fastest: Array = np.abs(self._velocities).max(axis=0)  # shape (n,), rad/s or m/s

    @property
    def reach(self) -> float:
        """Time of the last point, s, or 0 for a setpoint without a window."""
        return max(self._times[-1], 0.0)

    def aim(self, time: float, dt: float, limits: JointLimits) -> ServoTarget:
        """Return the target at `time`, for a step of `dt` s, within the range of later points."""
        position, velocity = self.at(time)
        acceleration = (velocity - self.at(time - dt)[1]) / dt
        end, speed = self.at(max(time, self._times[-1]))
        stop = end + stopping_distance(limits, speed)
        later = self._positions[bisect_right(self._times, time) :]
        shown = np.concatenate([later, position[None], stop[None]])
        low, high = shown.min(axis=0) - PASSED, shown.max(axis=0) + PASSED
        return ServoTarget(position, velocity, acceleration, low, high)

    def at(self, time: float) -> tuple[Array, Array]:
        """Return position and velocity at a time, by cubic interpolation, shapes (n,).

        The velocity of the last point continues for MAX_EXTRAPOLATION_S after the point.
        """
        times, positions, velocities = self._times, self._positions, self._velocities
        if time >= times[-1]:
            extra = min(time - times[-1], MAX_EXTRAPOLATION_S)
            return positions[-1] + extra * velocities[-1], velocities[-1]
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


PACE_SPAN_S = 0.1  # minimum interval for estimating a speed: messages arrive in bursts
PACE_MEMORY_S = 0.5  # minimum time for which a speed is stored, s


@dataclass(slots=True)
class _StreamState:
    """Position and speed of a stream, each shape (n,), at `time`, s."""

    time: float
    position: Array
    speed: Array


class StreamSpeedEstimator:
    """Records the positions and speeds of a stream that the arm has not reached yet.

    `fastest` is the highest recorded speed of each joint.
    """

    def __init__(self, start: Array, time: float) -> None:
        first = _StreamState(time - PACE_SPAN_S, start, np.zeros_like(start))
        self._path = deque([first], maxlen=MAX_SENT)
        self._passed = 0  # index of the position that the arm has passed last

    def add(self, time: float, reference: StreamReference) -> None:
        position, _ = reference.at(0.0)
        before = next(
            (item for item in reversed(self._path) if time - item.time >= PACE_SPAN_S),
            self._path[0],
        )
        span = max(time - before.time, PACE_SPAN_S)
        speed = np.maximum(np.abs(position - before.position) / span, reference.fastest)
        if len(self._path) == self._path.maxlen:  # the arm may still have to pass the first state
            self._passed -= 1
            self._path[1].speed = np.maximum(self._path[0].speed, self._path[1].speed)
        self._path.append(_StreamState(time, position, speed))

    def lag(self, time: float, position: Array) -> float:
        """Return the time by which a commanded position, (n,), lags behind the stream, s."""
        path = self._path
        passed = max(self._passed, 0)
        if float(np.abs(path[-1].position - position).max()) <= NEAR:
            passed = len(path) - 1
        else:
            ahead = np.array([item.position for item in islice(path, passed, passed + NEXT)])
            passed += int(np.argmin(np.abs(ahead - position).max(axis=1)))
        behind = 0.0 if passed == len(path) - 1 else path[-1].time - path[passed].time
        while passed and time - path[0].time > PACE_MEMORY_S:
            path.popleft()
            passed -= 1
        self._passed = passed
        return behind

    def fastest(self) -> Array:
        speeds: Array = np.array([item.speed for item in self._path]).max(axis=0)
        return speeds


NEAR = 1e-3  # distance to the last position sent, rad or m, within which the arm has reached it
MAX_SENT = 256  # maximum number of stored setpoints, which cover five seconds
BEHIND_FILTER_S = 0.2  # time constant for smoothing the lag of the arm, s
NEXT = 25  # maximum number of stored positions that are searched for the one nearest to the arm


class StreamLag:
    """Lag of the arm behind the sent positions. Times are the event loop's, s."""

    def __init__(self) -> None:
        self.now = 0.0
        """Time since the arm's current position was sent, s. It is 0 at the last sent position."""
        self.behind = 0.0
        """Filtered value of `now`, s. Samples at the last sent position are ignored, because an
        arm that stops at each point is always at this position when it receives the next point."""
        self._last_sample = 0.0
        self._sent: deque[tuple[float, Array]] = deque(maxlen=MAX_SENT)
        self._position: Array | None = None
        self._direction: Array = np.zeros(0)
        """Last displacement of the arm above MOVED, shape (n,). It ended at `_position`."""

    @property
    def ahead(self) -> float:
        """Time from the last point that the arm has passed to the last point sent, s."""
        return self._sent[-1][0] - self._sent[0][0] if self._sent else 0.0

    def sent(self, time: float, position: Array) -> None:
        self._sent.append((time, position))

    def update(self, sample: JointSample) -> None:
        sent = self._sent
        if not sent:
            return
        before = sample.positions if self._position is None else self._position
        moved = sample.positions - before
        if self._position is None or np.abs(moved).max() > MOVED:
            self._position, self._direction = sample.positions, moved
        if float(np.abs(sent[-1][1] - sample.positions).max()) <= NEAR:
            passed, self.now = len(sent) - 1, 0.0
        else:
            near = np.array([position for _, position in islice(sent, NEXT)])
            passed = self._passed(near, sample.positions)
            self.now = max(sample.measured - sent[passed][0], 0.0)
            weight = min((sample.measured - self._last_sample) / BEHIND_FILTER_S, 1.0)
            self.behind += weight * (self.now - self.behind)
        self._last_sample = sample.measured
        for _ in range(passed):
            sent.popleft()

    def _passed(self, near: Array, position: Array) -> int:
        """Return the index of the position that the arm passed last.

        `near`: sent positions, shape (k, n). `position`: position of the arm, shape (n,).

        The nearest position counts. But a path may pass a position twice, in opposite directions,
        so a position whose step has the arm's direction of motion takes precedence if it is at
        most half a step farther away.
        """
        distances = np.abs(near - position).max(axis=1)
        nearest = int(np.argmin(distances))
        steps = np.diff(near, axis=0)
        along = steps @ self._direction > 0.0
        if not along.any():
            return nearest
        result = int(np.argmin(np.where(along, distances[:-1], np.inf)))
        step = float(np.abs(steps[result]).max())
        return result if distances[result] <= distances[nearest] + step / 2.0 else nearest
