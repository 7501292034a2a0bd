# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""OPT: the fastest speed profile from rest to rest on a path within all limits.

Sequential convex programming over the coefficients of a `SpeedProfile`. The limits of velocity
and acceleration are linear in x = u̇². The jerk limit |…| ≤ J/√x is not convex, but J/√x is: its
tangent at the profile found so far lies below it, so every round's solution keeps the true limits
and is no slower than the one before. The grid is laid anew, in equal steps of time, until it no
longer helps.
"""

import math
from dataclasses import dataclass

import numpy as np

from benchmark.arrays import Index
from benchmark.optimum.interior_point import Rows, minimise
from benchmark.optimum.profile_grid import first_profile, joints, regridded
from benchmark.optimum.speed_profile import (
    SpeedProfile,
    basis_rows,
    greville,
    interval_of,
    quadrature,
    use_of_limits,
)
from benchmark.spline_path import SplinePath
from epson_driver.motion import Array, JointLimits

CONVERGED_SHARE = 2e-4
"""Relative change of the time in one round that ends the search."""
COARSE_SHARE = 0.05
"""As long as a round wins more than this share of the time, it is worth a new grid."""
GRIDS = 2
"""How often the search converges, each time on the grid of the profile before."""
DUALITY_GAP_SHARE = 1e-4
"""Duality gap that ends a round, relative to the time."""
MAX_ROUNDS = 120
START_SHARE = 0.97
"""What a round's start is slowed down by in x, to be inside every bound."""
LIMIT_SHARE = 0.9995
"""Use of the limits at the samples: leaves room for what happens between them."""


@dataclass(frozen=True, eq=False)
class Optimum:
    """A speed profile, the largest |v|/V, |a|/A, |j|/J that it attains, and the rounds it took."""

    profile: SpeedProfile
    velocity: float
    acceleration: float
    jerk: float
    rounds: int


def jerk_limited_optimum(path: SplinePath, limits: JointLimits) -> Optimum:
    """Return the fastest profile from rest to rest that was found."""
    profile = _feasible(path, limits, first_profile(path, limits))
    best: SpeedProfile | None = None
    rounds = 0
    for _ in range(GRIDS):
        before = math.inf
        while profile.duration < (1.0 - CONVERGED_SHARE) * before and rounds < MAX_ROUNDS:
            before = profile.duration
            profile = _improved(path, limits, profile)
            rounds += 1
            if best is None and profile.duration < (1.0 - COARSE_SHARE) * before:
                profile = _feasible(path, limits, regridded(profile))
        if best is None or profile.duration < best.duration:
            best = profile
        profile = _feasible(path, limits, regridded(profile))
    assert best is not None
    return Optimum(best, *use_of_limits(path, best, limits), rounds)


@dataclass(frozen=True, eq=False)
class _Samples:
    """Where a profile is held against the limits; k samples, in the order of their intervals."""

    intervals: Index
    u: Array
    pieces: Index


def _samples(path: SplinePath, breaks: Array) -> _Samples:
    """Return both ends and two inner points of each interval, and both sides of each knot."""
    h = np.diff(breaks)
    count = len(h)
    inside = (path.knots > breaks[0]) & (path.knots < breaks[-1])
    knots = path.knots[inside]
    index = np.flatnonzero(inside)
    u = np.concatenate([breaks[:-1] + h * share for share in (0.0, 1 / 3, 2 / 3, 1.0)])
    where = np.tile(np.arange(count), 4)
    pieces = path.pieces(u)
    at_knots = interval_of(breaks, knots)
    u = np.concatenate([u, knots, knots])
    where = np.concatenate([where, at_knots, at_knots])
    pieces = np.concatenate([pieces, index - 1, index])
    order = np.argsort(where, kind='stable')
    return _Samples(where[order], u[order], pieces[order])


def _use(
    path: SplinePath, limits: JointLimits, profile: SpeedProfile, samples: _Samples
) -> tuple[float, float, float]:
    """Return the largest use of each limit at the samples and in start ramp and end ramp."""
    x, dx, ddx = (column[:, None] for column in profile.at(samples.u, samples.intervals))
    if x.min() <= 0.0:
        raise ValueError('a profile must not stop on the way')
    _, first, second, third = path.at(samples.u, samples.pieces)
    speed = np.sqrt(x)
    v = np.max(np.abs(first) * speed / limits.velocity)
    a = np.max(np.abs(first * dx / 2 + second * x) / limits.acceleration)
    j = np.max(np.abs(first * ddx / 2 + 1.5 * second * dx + third * x) * speed / limits.jerk)
    caps = _end_caps(path, limits, profile.breaks, profile.length)
    ends = max(profile.coefficients[0] / caps[0], profile.coefficients[-1] / caps[1])
    return float(v), float(max(a, ends)), float(max(j, ends**1.5))


def _end_caps(
    path: SplinePath, limits: JointLimits, breaks: Array, length: float
) -> tuple[float, float]:
    """Return what x may be at the end of the start ramp and at the begin of the end ramp."""
    caps = []
    for end, sign in ((float(breaks[0]), 1.0), (length - float(breaks[-1]), -1.0)):
        s = end * np.geomspace(1e-4, 1.0, 30)[:, None]
        _, first, second, third = path.at(s[:, 0] if sign > 0 else length - s[:, 0])
        slope = first * sign
        acceleration = np.abs(slope * (2 / 3) * s ** (1 / 3) + second * s ** (4 / 3))
        jerk = np.abs(
            slope * (2 / 9) + 2 * second * s + third * sign * s**2
        )  # (q′x″/2 + 1.5q″x′ + q‴x)·√x, in scale^1.5
        scale = min(
            float(np.min(limits.acceleration / acceleration.clip(1e-300))),
            float(np.min(limits.jerk / jerk.clip(1e-300))) ** (2 / 3),
        )
        caps.append(LIMIT_SHARE * scale * end ** (4 / 3))
    return caps[0], caps[1]


def _feasible(path: SplinePath, limits: JointLimits, profile: SpeedProfile) -> SpeedProfile:
    """Return the profile slowed down until it keeps every limit at the samples."""
    v, a, j = _use(path, limits, profile, _samples(path, profile.breaks))
    return profile.scaled(min(1.0, LIMIT_SHARE**2 / max(v**2, a, j ** (2 / 3))))


def _improved(path: SplinePath, limits: JointLimits, profile: SpeedProfile) -> SpeedProfile:
    """Return the fastest profile on the same grid within the tangents at this one."""
    unknowns = _Unknowns(profile)
    bounds, room = _bounds(path, limits, profile, unknowns)
    time, weights = _time(profile, unknowns)
    y = minimise(time, weights, bounds, room, unknowns.start * START_SHARE, DUALITY_GAP_SHARE)
    return SpeedProfile(profile.breaks, unknowns.coefficients(y), profile.length)


def _bounds(
    path: SplinePath, limits: JointLimits, profile: SpeedProfile, unknowns: '_Unknowns'
) -> tuple[Rows, Array]:
    """Return rows and what they must not exceed: for each sample, 1 + 4 per joint."""
    samples = _samples(path, profile.breaks)
    _, first, second, third = path.at(samples.u, samples.pieces)
    row, slope, bend = basis_rows(profile.breaks, samples.intervals, samples.u)
    x0 = np.einsum(
        'kc,kc->k', row, profile.coefficients[samples.intervals[:, None] + np.arange(3)]
    )
    cap = 1.0 / np.max(np.abs(first) / limits.velocity, axis=1) ** 2
    tangent = row / (2.0 * x0[:, None])  # J/√x ≥ J/√x0·(1.5 − x/(2·x0)), times √x0/J
    rows, room = [row / cap[:, None]], [LIMIT_SHARE]
    for joint in range(first.shape[1]):
        q1, q2, q3 = (column[:, joint, None] for column in (first, second, third))
        a = (q1 * slope / 2 + q2 * row) / limits.acceleration[joint]
        j = (q1 * bend / 2 + 1.5 * q2 * slope + q3 * row) / limits.jerk[joint]
        j = j * np.sqrt(x0)[:, None] / LIMIT_SHARE
        rows += [a, -a, j + tangent, tangent - j]
        room += [LIMIT_SHARE, LIMIT_SHARE, 1.5, 1.5]
    caps = _end_caps(path, limits, profile.breaks, profile.length)
    ends = np.zeros(
        (len(rows), 2, 3)
    )  # start ramp and end ramp as two more samples, with one row each
    ends[0] = [[1.0 / caps[0], 0.0, 0.0], [0.0, 0.0, 1.0 / caps[1]]]
    bounds = unknowns.rows(
        np.append(samples.intervals, [0, len(profile.breaks) - 2]),
        np.concatenate([np.array(rows), ends], axis=1),
    )
    return bounds, np.broadcast_to(np.array(room)[:, None], bounds.weights.shape[1:])


def _time(profile: SpeedProfile, unknowns: '_Unknowns') -> tuple[Rows, Array]:
    """Return rows and weights so that the profile's duration is Σ weight / √row."""
    intervals = len(profile.breaks) - 1
    u, weights = quadrature(profile.breaks)
    where = np.repeat(np.arange(intervals), len(u) // intervals)
    value, _, _ = basis_rows(profile.breaks, where, u)
    ends = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    rows = unknowns.rows(np.append(where, [0, intervals - 1]), np.concatenate([value, ends])[None])
    return rows, np.append(weights, [3.0 * profile.start_ramp, 3.0 * profile.end_ramp])[None]


class _Unknowns:
    """The coefficients without the two that start ramp and end ramp determine, each about 1."""

    def __init__(self, profile: SpeedProfile) -> None:
        self._begin, self._end = joints(profile.breaks, profile.length)
        free = np.delete(profile.coefficients, [1, -2])
        x, _, _ = profile.at(greville(profile.breaks))
        self._scale = np.delete(x, [1, -2])
        self.start = free / self._scale

    def coefficients(self, y: Array) -> Array:
        """Return all coefficients (k + 2,) of the unknowns (k,)."""
        free = y * self._scale
        inner = free[1:-1]
        return np.concatenate(
            [[free[0], self._begin * free[0]], inner, [self._end * free[-1], free[-1]]]
        )

    def rows(self, intervals: Index, weights: Array) -> Rows:
        """Return weights (g, k, 3) of coefficients as rows on the unknowns."""
        count = len(self._scale)  # of unknowns; coefficients are two more
        column = intervals[:, None] + np.arange(3)
        factor = np.where(column == 1, self._begin, np.where(column == count, self._end, 1.0))
        target = np.clip(column - 1, 0, count - 1)
        first = np.minimum(target[:, 0], count - 3)
        placed = np.zeros((3, *weights.shape[:2]))
        for k in range(3):
            for place in range(3):
                here = target[:, k] - first == place
                placed[place][:, here] += (weights[:, :, k] * factor[:, k])[:, here]
        for place in range(3):
            placed[place] *= self._scale[first + place]
        return Rows(first, placed, count)
