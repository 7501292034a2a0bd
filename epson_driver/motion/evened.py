# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Removes noise from timed points: moves them within a tolerance onto a smooth motion.

A recording has noise, and a motion through every noisy point is slower than the recording.
For each joint, with times in units of the mean spacing, the given points q are replaced by the
points p that

    minimise   Σ wᵢ (pᵢ - qᵢ)² + STIFFNESS · ∫ p̈² dt,

with the integral from second differences. The weights w start at 1 and grow where a point deviates
by more than the tolerance, until none does. A remaining excess is clipped. This is a smoothing
spline with bounds.
"""

import numpy as np

from epson_driver.motion.limits import Array, JointLimits
from epson_driver.motion.smoother.banded import solve_pentadiagonal
from epson_driver.motion.smoother.waypoints import MERGE_TOLERANCE, MIN_DWELL_S, MIN_MOVE
from epson_driver.motion.trajectory import Trajectory

MIN_TOLERANCE = 2.0 * MERGE_TOLERANCE
"""Minimum tolerance: the smoother merges points half as far apart and needs this margin."""

STIFFNESS = 1e3
"""Weight of the acceleration relative to the distances: noise over about 20 points is removed."""

HELD = 1e12
"""Weight of fixed points."""

MAX_ROUNDS = 40
MIN_GROWTH_RATIO = 1.2
"""Maximum number of increases of the weights, and the minimum ratio of each, squared."""


def evened(trajectory: Trajectory, limits: JointLimits, tolerance: float) -> Trajectory:
    """Return a trajectory whose points are within a tolerance, rad or m, of the given ones.

    They are close enough that the smoother's motion is within it, too, in each joint. The ends,
    and points that command a rest, are unchanged. The joints are in the order of the limits.
    Raises ValueError for a tolerance below MIN_TOLERANCE.
    """
    if not tolerance >= MIN_TOLERANCE:  # NaN too
        raise ValueError(f'the tolerance {tolerance} rad must be {MIN_TOLERANCE:g} or more')
    given = trajectory.in_order(limits.names)
    gaps = np.diff(given.times)
    if len(gaps) < 2:
        return given
    within = tolerance - MERGE_TOLERANCE
    still = np.abs(np.diff(given.positions, axis=0)).max(axis=1) <= MIN_MOVE
    rests = np.flatnonzero(still & (gaps >= MIN_DWELL_S))
    held = np.unique(np.concatenate([[0, len(gaps)], rests, rests + 1]))
    diagonals = _bending(gaps / gaps.mean())
    moved = np.stack([_joint(q, diagonals, within, held) for q in given.positions.T], axis=1)
    moved = np.clip(moved, given.positions - within, given.positions + within)
    moved = np.clip(moved, limits.position_min, limits.position_max)
    moved[held] = given.positions[held]
    return Trajectory(given.joint_names, given.times, moved)


def _bending(gaps: Array) -> tuple[Array, Array, Array]:
    """Return the diagonals of STIFFNESS times the integral, for `solve_pentadiagonal`."""
    before, after = 1.0 / gaps[:-1], 1.0 / gaps[1:]
    here = -(before + after)
    weight = 2.0 * STIFFNESS / (gaps[:-1] + gaps[1:])
    main, second, third = np.zeros((3, len(gaps) + 1))
    main[:-2] = weight * before**2
    main[1:-1] += weight * here**2
    main[2:] += weight * after**2
    second[:-2] = weight * before * here
    second[1:-1] += weight * here * after
    third[:-2] = weight * before * after
    return main, second, third


def _joint(
    given: Array, diagonals: tuple[Array, Array, Array], within: float, held: Array
) -> Array:
    """Return the positions of one joint, shape (k,), almost all within the tolerance."""
    main, second, third = diagonals
    weights = np.ones(len(given))
    weights[held] = HELD
    moved = given
    for _ in range(MAX_ROUNDS):
        found = solve_pentadiagonal(main + weights, second, third, weights * given)
        if found is None:
            break
        moved = found
        off = np.abs(moved - given) / within
        if off.max() <= 1.0:
            break
        weights = np.where(off > 1.0, weights * np.maximum(off, MIN_GROWTH_RATIO) ** 2, weights)
        weights = np.minimum(weights, HELD)
    return moved
