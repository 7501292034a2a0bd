# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Motions along a curve in joint space from rest to rest, and stops on it, within every limit.

One speed limit applies to the whole curve. It follows from the largest derivatives, so the joints
respect their limits at every instant. If a joint moves fast at one point, e.g. near a singularity,
the whole motion is slow.
"""

from dataclasses import dataclass

import numpy as np

from epson_driver.motion import Array, JointLimits, LineMotion, go
from epson_driver.tool_motion.speed_profile import fraction_of_limits

MIN_SAMPLES = 5

HALVINGS = 50
"""Number of bisection steps, which is enough for full precision."""


@dataclass(frozen=True, slots=True)
class CurveSpeed:
    """Limits of the motion along a curve, in fractions of the curve per s, s² and s³, all > 0."""

    velocity: float
    acceleration: float
    jerk: float


class Curve:
    """A cubic spline through k ≥ 5 joint positions, shape (k, n), rad.

    Its parameter is the fraction of the curve, [0, 1]. It increases by the same amount from each
    joint position to the next. Raises ValueError if the samples are invalid.
    """

    def __init__(self, samples: Array) -> None:
        samples = np.asarray(samples, dtype=float)
        if samples.ndim != 2 or len(samples) < MIN_SAMPLES or not np.all(np.isfinite(samples)):
            raise ValueError(f'samples: must be finite, {MIN_SAMPLES} or more of each joint')
        self.samples = samples
        self._step = 1.0 / (len(samples) - 1)
        second = (samples[2:] - 2.0 * samples[1:-1] + samples[:-2]) * 6.0 / self._step**2
        # M[i-1] + 4 M[i] + M[i+1] = second, with the second derivative linear at the ends
        matrix = 4.0 * np.eye(len(second)) + np.eye(len(second), k=1) + np.eye(len(second), k=-1)
        matrix[0, :2] = matrix[-1, :-3:-1] = 6.0, 0.0
        inner = np.linalg.solve(matrix, second)
        first, last = 2.0 * inner[0] - inner[1], 2.0 * inner[-1] - inner[-2]
        self._second = np.vstack([first, inner, last])
        self._third = np.diff(self._second, axis=0) / self._step

    def at(self, fraction: float) -> tuple[Array, Array, Array]:
        """Return position, first and second derivative at a fraction, [0, 1], shapes (n,)."""
        fraction = min(max(fraction, 0.0), 1.0)
        index = min(int(fraction / self._step), len(self.samples) - 2)
        u = fraction - index * self._step
        second, third = self._second[index], self._third[index]
        slope = self._slope(index)
        return (
            self.samples[index] + u * (slope + u * (second / 2.0 + u * third / 6.0)),
            slope + u * (second + u * third / 2.0),
            second + u * third,
        )

    def _slope(self, index: int) -> Array:
        mean = (self.samples[index + 1] - self.samples[index]) / self._step
        seconds = 2.0 * self._second[index] + self._second[index + 1]
        return np.asarray(mean - self._step * seconds / 6.0)

    def nearest(self, position: Array) -> float:
        """Return the fraction at which the curve is nearest to a position, shape (n,)."""
        middle = int(np.argmin(np.linalg.norm(self.samples - position, axis=1)))
        low, high = (min(max((middle + side) * self._step, 0.0), 1.0) for side in (-1, 1))
        for _ in range(HALVINGS):
            fraction = (low + high) / 2.0
            point, slope, _ = self.at(fraction)
            low, high = (fraction, high) if slope @ (position - point) > 0.0 else (low, fraction)
        return (low + high) / 2.0

    @property
    def derivative_bounds(self) -> tuple[Array, Array, Array]:
        """Upper bounds of the magnitudes of the first three derivatives, shapes (n,)."""
        slopes = [np.abs(self._slope(index)) for index in range(len(self.samples) - 1)]
        slopes.append(np.abs(self.at(1.0)[1]))
        second = np.max(np.abs(self._second), axis=0)
        # the slope differs from the one at the nearer sample by at most second · step / 2
        slope = np.max(slopes, axis=0) + second * self._step / 2.0
        return slope, second, np.max(np.abs(self._third), axis=0)


class CurveMotion:
    """A motion along a curve from `origin` to `end` in `duration` s, or a stop on it."""

    def __init__(self, curve: Curve, timing: LineMotion) -> None:
        self._curve = curve
        self._timing = timing
        self.origin = curve.samples[0]
        self.end = curve.at(float(timing.end[0]))[0]
        self.duration = timing.duration

    def when(self, fraction: float) -> float:
        """Return the time at which a fraction of the curve is reached, s."""
        early, late = 0.0, self.duration
        for _ in range(HALVINGS):
            time = (early + late) / 2.0
            early, late = (time, late) if self._timing.at(time)[0][0] < fraction else (early, time)
        return late

    @property
    def braking(self) -> float:
        return self._timing.braking

    def at(self, time: float) -> tuple[Array, Array, Array]:
        (fraction,), (rate,), (change,) = self._timing.at(time)
        position, slope, bend = self._curve.at(fraction)
        return position, slope * rate, bend * rate**2 + slope * change

    def stop(self, time: float) -> 'CurveMotion':
        return CurveMotion(self._curve, self._timing.stop(time))


def go_along(limits: JointLimits, curve: Curve, speed: CurveSpeed) -> CurveMotion:
    """Return the fastest motion along a curve from rest to rest within `speed` and the limits.

    Raises ValueError if the curve leaves the position limits.
    """
    check_range(limits, curve.samples)
    v, a, j = reduced(limits, curve, speed)
    along = JointLimits(
        ('fraction',),
        np.array([-1.0]),
        np.array([2.0]),
        np.array([v]),
        np.array([a]),
        np.array([j]),
    )
    return CurveMotion(curve, go(along, np.zeros(1), np.ones(1)))


def reduced(limits: JointLimits, curve: Curve, speed: CurveSpeed) -> tuple[float, float, float]:
    """Return velocity, acceleration and jerk of `speed`, reduced to respect the joint limits."""
    v, a, j = speed.velocity, speed.acceleration, speed.jerk
    factor = float(fraction_of_limits(limits, curve.derivative_bounds, v, a, j))
    return v * factor, a * factor**2, j * factor**3


def joint_use(curve: Curve, v: float, a: float, j: float) -> tuple[Array, Array, Array]:
    """Return upper bounds of the joints' velocity, acceleration and jerk, shapes (n,).

    v, a, j: velocity, acceleration and jerk along the curve, in fractions of the curve.
    """
    first, second, third = curve.derivative_bounds
    return (
        first * v,
        second * v**2 + first * a,
        third * v**3 + 3.0 * second * v * a + first * j,
    )


def check_range(limits: JointLimits, positions: Array) -> None:
    """Raise ValueError if positions, shape (k, n), exceed the range of a joint."""
    lowest, highest = np.min(positions, axis=0), np.max(positions, axis=0)
    outside = (lowest < limits.position_min) | (highest > limits.position_max)
    if np.any(outside):
        name = limits.names[int(np.argmax(outside))]
        raise ValueError(f'{name}: path exceeds the joint range')
