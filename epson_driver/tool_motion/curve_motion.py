# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Motion along a curve in joint space from rest to rest, and stops on the way, inside every limit.

How fast it may be follows from the largest derivatives of the curve, so no limit is exceeded at
any instant; near a singularity, where some joint has far to go, all of it is slow.
"""

from dataclasses import dataclass

import numpy as np

from epson_driver.motion import Array, JointLimits, LineMotion, go
from epson_driver.tool_motion.speed_profile import share_of_limits

MIN_SAMPLES = 5


@dataclass(frozen=True, slots=True)
class CurveSpeed:
    """How fast it is meant to be, in shares of the curve: 1/s, 1/s², 1/s³, all above 0."""

    velocity: float
    acceleration: float
    jerk: float


class Curve:
    """A cubic spline through k ≥ 5 samples at even shares of it, shape (k, n), rad.

    Its second derivative is continuous, its third is constant between two samples. Raises
    ValueError for other samples.
    """

    def __init__(self, samples: Array) -> None:
        samples = np.asarray(samples, dtype=float)
        if samples.ndim != 2 or len(samples) < MIN_SAMPLES or not np.all(np.isfinite(samples)):
            raise ValueError(f'samples: must be finite, {MIN_SAMPLES} or more of each joint')
        self.samples = samples
        self._step = 1.0 / (len(samples) - 1)
        bends = (samples[2:] - 2.0 * samples[1:-1] + samples[:-2]) * 6.0 / self._step**2
        # M[i-1] + 4 M[i] + M[i+1] = bends; at the ends the second derivative goes on evenly
        matrix = 4.0 * np.eye(len(bends)) + np.eye(len(bends), k=1) + np.eye(len(bends), k=-1)
        matrix[0, :2] = matrix[-1, :-3:-1] = 6.0, 0.0
        inner = np.linalg.solve(matrix, bends)
        first, last = 2.0 * inner[0] - inner[1], 2.0 * inner[-1] - inner[-2]
        self._bends = np.vstack([first, inner, last])
        self._jumps = np.diff(self._bends, axis=0) / self._step

    def at(self, share: float) -> tuple[Array, Array, Array]:
        """Return position, first and second derivative by the share from 0 to 1, shapes (n,)."""
        share = min(max(share, 0.0), 1.0)
        index = min(int(share / self._step), len(self.samples) - 2)
        u = share - index * self._step
        bend, jump = self._bends[index], self._jumps[index]
        slope = self._slope(index)
        return (
            self.samples[index] + u * (slope + u * (bend / 2.0 + u * jump / 6.0)),
            slope + u * (bend + u * jump / 2.0),
            bend + u * jump,
        )

    def _slope(self, index: int) -> Array:
        """Return the first derivative at a sample that has one after it."""
        mean = (self.samples[index + 1] - self.samples[index]) / self._step
        bends = 2.0 * self._bends[index] + self._bends[index + 1]
        return np.asarray(mean - self._step * bends / 6.0)

    @property
    def most(self) -> tuple[Array, Array, Array]:
        """Bounds of the first three derivatives' sizes, shapes (n,)."""
        slopes = [np.abs(self._slope(index)) for index in range(len(self.samples) - 1)]
        slopes.append(np.abs(self.at(1.0)[1]))
        bend = np.max(np.abs(self._bends), axis=0)
        # between two samples the slope is off the nearer one by no more than half a step's bend
        slope = np.max(slopes, axis=0) + bend * self._step / 2.0
        return slope, bend, np.max(np.abs(self._jumps), axis=0)


class CurveMotion:
    """A motion along a curve, as a function of the time since it began: as LineMotion is.

    `origin` and `end` have shape (n,), rad; `duration` is in s. Made by `go_along` and `stop`.
    """

    def __init__(self, curve: Curve, timing: LineMotion) -> None:
        self._curve = curve
        self._timing = timing
        self.origin = curve.samples[0]
        self.end = curve.at(float(timing.end[0]))[0]
        self.duration = timing.duration

    @property
    def braking(self) -> float:
        """When the deceleration of a motion from rest to rest begins, s."""
        return self._timing.braking

    def at(self, time: float) -> tuple[Array, Array, Array]:
        """Return position, velocity, acceleration of each joint at `time` ≥ 0, shapes (n,)."""
        (share,), (rate,), (change,) = self._timing.at(time)
        position, slope, bend = self._curve.at(share)
        return position, slope * rate, bend * rate**2 + slope * change

    def stop(self, time: float) -> 'CurveMotion':
        """Return the fastest stop along the curve from this motion's state at `time`."""
        return CurveMotion(self._curve, self._timing.stop(time))


def go_along(limits: JointLimits, curve: Curve, speed: CurveSpeed) -> CurveMotion:
    """Return a motion along a curve from rest to rest, no faster than `speed`, and than limits.

    Raises ValueError for a curve that leaves the position limits.
    """
    lowest = np.min(curve.samples, axis=0)
    highest = np.max(curve.samples, axis=0)
    outside = (lowest < limits.position_min) | (highest > limits.position_max)
    if np.any(outside):
        name = limits.names[int(np.argmax(outside))]
        raise ValueError(f'{name}: the way leaves its range')
    v, a, j = speed.velocity, speed.acceleration, speed.jerk
    slower = float(share_of_limits(limits, curve.most, v, a, j))
    along = JointLimits(
        ('share',),
        np.array([-1.0]),
        np.array([2.0]),
        np.array([v * slower]),
        np.array([a * slower**2]),
        np.array([j * slower**3]),
    )
    return CurveMotion(curve, go(along, np.zeros(1), np.ones(1)))
