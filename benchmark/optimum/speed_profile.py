# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A speed profile on a path, x(u) = u̇², as a quadratic B-spline between two ramps.

The speed at rest has no derivative in u, so no spline can leave it: over the first and the last
few milliseconds the path's jerk is constant instead, x ∝ u^(4/3), joined with equal value and
slope. With x the limits of a joint read

    |q′|·√x ≤ V    |q′·x′/2 + q″·x| ≤ A    |q′·x″/2 + 1.5·q″·x′ + q‴·x|·√x ≤ J
"""

from dataclasses import dataclass

import numpy as np

from benchmark.arrays import Index
from benchmark.spline_path import SplinePath
from epson_driver.motion import Array, JointLimits
from epson_driver.motion.interpolation import cubic

_GAUSS, _WEIGHTS = np.polynomial.legendre.leggauss(4)


@dataclass(frozen=True, eq=False)
class SpeedProfile:
    """x(u) over breaks (k + 1,), with coefficients (k + 2,); clamped quadratic B-spline.

    breaks[0] is where the start ramp from u = 0 ends, breaks[-1] where the end ramp to `length`
    begins.
    """

    breaks: Array
    coefficients: Array
    length: float

    @property
    def start_ramp(self) -> float:
        """Parameter length of the start ramp, s at full speed."""
        return float(self.breaks[0])

    @property
    def end_ramp(self) -> float:
        """Parameter length of the end ramp, s at full speed."""
        return self.length - float(self.breaks[-1])

    def at(self, u: Array, intervals: Index | None = None) -> tuple[Array, Array, Array]:
        """Return x, x′, x″ at parameters (k,), also within both ramps, shapes (k,)."""
        where = interval_of(self.breaks, u) if intervals is None else intervals
        rows = basis_rows(self.breaks, where, u)
        x, dx, ddx = (
            np.einsum('kc,kc->k', row, self.coefficients[where[:, None] + np.arange(3)])
            for row in rows
        )
        for begin, sign, scale in self._ends():
            inside = (u < self.breaks[0]) if sign > 0 else (u > self.breaks[-1])
            s = np.maximum(sign * (u[inside] - begin), 1e-300)
            x[inside] = scale * s ** (4 / 3)
            dx[inside] = sign * scale * (4 / 3) * s ** (1 / 3)
            ddx[inside] = scale * (4 / 9) * s ** (-2 / 3)
        return x, dx, ddx

    def times_at_breaks(self) -> Array:
        """Return the time at each break, shape (k + 1,), s; the start ramp ends at the first."""
        return self._times(self.breaks)

    @property
    def start_ramp_time(self) -> float:
        """Duration of the start ramp, s."""
        return float(3.0 * self.start_ramp / np.sqrt(self.coefficients[0]))

    @property
    def end_ramp_time(self) -> float:
        """Duration of the end ramp, s."""
        return float(3.0 * self.end_ramp / np.sqrt(self.coefficients[-1]))

    @property
    def duration(self) -> float:
        """Time from rest to rest, s."""
        return float(self._times(self.breaks)[-1]) + self.end_ramp_time

    def scaled(self, factor: float) -> 'SpeedProfile':
        """Return the profile whose u̇² is `factor` times this one's."""
        return SpeedProfile(self.breaks, factor * self.coefficients, self.length)

    def parameters_at(self, times: Array) -> Array:
        """Return u at times (k,), s, from rest at 0 to rest at `duration`."""
        fine, intervals = _subdivided(self.breaks, 8)
        x, _, _ = self.at(fine, intervals)
        stamps = self._times(fine)
        result = _hermite(times, stamps, fine, np.sqrt(x))
        early, late = times < stamps[0], times > stamps[-1]
        result[early] = (
            self.start_ramp * (np.maximum(times[early], 0.0) / self.start_ramp_time) ** 3
        )
        rest = np.maximum(self.duration - times[late], 0.0)
        result[late] = self.length - self.end_ramp * (rest / self.end_ramp_time) ** 3
        return result

    def _times(self, u: Array) -> Array:
        """Return the times at increasing parameters from the first break on."""
        at, weights = quadrature(u)
        x, _, _ = self.at(at)
        steps = (weights / np.sqrt(x)).reshape(-1, len(_GAUSS)).sum(axis=1)
        times: Array = self.start_ramp_time + np.append(0.0, np.cumsum(steps))
        return times

    def _ends(self) -> tuple[tuple[float, float, float], ...]:
        return (
            (0.0, 1.0, float(self.coefficients[0]) / self.start_ramp ** (4 / 3)),
            (self.length, -1.0, float(self.coefficients[-1]) / self.end_ramp ** (4 / 3)),
        )


def interval_of(breaks: Array, u: Array) -> Index:
    """Return the index of the interval each parameter lies in, shape (k,)."""
    return np.asarray(np.clip(np.searchsorted(breaks, u, 'right') - 1, 0, len(breaks) - 2))


def greville(breaks: Array) -> Array:
    """Return where each coefficient (k + 2,) has its weight."""
    padded = np.concatenate([breaks[:1], breaks, breaks[-1:]])
    middles: Array = (padded[1:] + padded[:-1]) / 2.0
    return middles


def quadrature(breaks: Array) -> tuple[Array, Array]:
    """Return Gauss points and weights of all intervals in order, shapes (4·k,)."""
    half = np.diff(breaks)[:, None] / 2.0
    middle = (breaks[:-1] + breaks[1:])[:, None] / 2.0
    return (middle + half * _GAUSS).ravel(), (half * _WEIGHTS).ravel()


def basis_rows(breaks: Array, intervals: Index, u: Array) -> tuple[Array, Array, Array]:
    """Return the weights of three coefficients, from `intervals` on, in x, x′ and x″: (k, 3)."""
    padded = np.concatenate([breaks[:1], breaks, breaks[-1:]])
    before, begin, end, after = (padded[intervals + i] for i in range(4))
    h, s = end - begin, u - begin
    zero = np.zeros_like(u)
    left, right = 2.0 / (end - before), 2.0 / (after - begin)
    slope_begin = np.stack([-left, left, zero], axis=1)
    slope_end = np.stack([zero, -right, right], axis=1)
    value = np.stack([h / (end - before), (begin - before) / (end - before), zero], axis=1)
    second = (slope_end - slope_begin) / h[:, None]
    s = s[:, None]
    return value + slope_begin * s + second * s**2 / 2.0, slope_begin + second * s, second


def use_of_limits(
    path: SplinePath, profile: SpeedProfile, limits: JointLimits, per_interval: int = 12
) -> tuple[float, float, float]:
    """Return the largest |v|/V, |a|/A, |j|/J of a profile, from a dense sampling in u."""
    u, intervals = _subdivided(profile.breaks, per_interval)
    ends = [end * np.geomspace(1e-3, 1.0, 40) for end in (profile.start_ramp, profile.end_ramp)]
    worst = np.zeros(3)
    for points, where in (
        (u, intervals),
        (ends[0], np.zeros(40, dtype=int)),
        (profile.length - ends[1], np.full(40, len(profile.breaks) - 2)),
    ):
        x, dx, ddx = (column[:, None] for column in profile.at(points, where))
        _, first, second, third = path.at(points)
        speed = np.sqrt(np.maximum(x, 0.0))
        jerk = (first * ddx / 2 + 1.5 * second * dx + third * x) * speed
        for index, values in enumerate(
            (
                first * speed / limits.velocity,
                (first * dx / 2 + second * x) / limits.acceleration,
                jerk / limits.jerk,
            )
        ):
            worst[index] = max(worst[index], float(np.max(np.abs(values))))
    return float(worst[0]), float(worst[1]), float(worst[2])


def _subdivided(breaks: Array, count: int) -> tuple[Array, Index]:
    share = np.arange(count) / count
    points = (breaks[:-1, None] + np.diff(breaks)[:, None] * share).ravel()
    intervals = np.repeat(np.arange(len(breaks) - 1), count)
    return np.append(points, breaks[-1]), np.append(intervals, len(breaks) - 2)


def _hermite(at: Array, times: Array, values: Array, slopes: Array) -> Array:
    """Interpolate values with known slopes; the first and the last piece go on beyond the ends."""
    i = interval_of(times, at)
    h = times[i + 1] - times[i]
    begin, end = ((values[k], slopes[k]) for k in (i, i + 1))
    return cubic((at - times[i]) / h, h, begin, end)
