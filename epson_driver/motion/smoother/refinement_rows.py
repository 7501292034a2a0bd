# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What the refinement of a path may change, and what it is held to besides the limits in motion.

A knot's parameters are its position, its first and its second derivative, in this order. Joints
are measured in what they move in a second at their velocity limit.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from epson_driver.motion.interpolation import hermite
from epson_driver.motion.limits import Array, JointLimits
from epson_driver.motion.smoother import optimal
from epson_driver.motion.smoother.path import DEGREE, Path
from epson_driver.motion.smoother.problem import Problem
from epson_driver.motion.smoother.speed_spline import Ramp, SpeedSpline

PARAMETERS = 3
"""Of a knot, for each joint."""

BEND_RATIO, MIN_BEND = 1.5, 0.002
"""How far from the straight way between two knots the path may be: so many times as far as the
spline is in any joint, or so many rad (or m)."""

_BASIS = hermite(tuple(np.eye(6)[:3, None]), tuple(np.eye(6)[3:, None]))[0]
"""From the parameters at both ends of a segment of length 1 to its coefficients."""

_BETWEEN = np.linspace(0.0, 1.0, 9)[1:-1]
_ALONG_RAMP = np.array([0.0, 0.5, 1.0])


@dataclass(frozen=True, slots=True, eq=False)
class Freedom:
    """Which parameters of k knots may change, shape (k, 3).

    Where that is the position: within `tolerance`, shape (k,), rad (or m) in every joint, of
    `centre`, shape (k, n). spline: the path to bend little more than, through the same knots.
    """

    free: npt.NDArray[np.bool_]
    centre: Array
    tolerance: Array
    spline: Path


class PathRows:
    """What holds of n joints at m places of the path: the derivatives from the parameters.

    weights: shape (4, m, 6), from the parameters at both ends of the segment to q, q′, q″, q‴;
    ends: which of the knots' parameters these are, shape (m, 6).
    """

    def __init__(self, us: Array, knots: Array, units: Array) -> None:
        segment = np.clip(knots.searchsorted(us, side='right') - 1, 0, len(knots) - 2)
        h = np.diff(knots)[segment]
        powers = ((us - knots[segment]) / h)[:, None] ** np.arange(DEGREE + 1)
        self.ends = segment[:, None] * PARAMETERS + np.arange(2 * PARAMETERS)
        sizes = h[:, None] ** np.tile(np.arange(PARAMETERS), 2) * units.ravel()[self.ends]
        self.weights = np.empty((4, len(us), 2 * PARAMETERS))
        factors = np.ones(DEGREE + 1)
        for order in range(4):
            derivative = np.zeros_like(powers)
            derivative[:, order:] = powers[:, : DEGREE + 1 - order]
            weights = (derivative * factors) @ _BASIS
            self.weights[order] = weights * sizes / h[:, None] ** order
            factors = factors * np.maximum(np.arange(DEGREE + 1.0) - order, 0.0)

    def derivatives(self, values: Array) -> Array:
        """Return q′, q″, q‴, shape (3, n, m), of parameters (3 k, n)."""
        result: Array = (self.weights[1:, :, None] @ values[self.ends])[:, :, 0].transpose(0, 2, 1)
        return np.ascontiguousarray(result)

    def combined(self, factors: tuple[Array | float, ...], count: int) -> Array:
        """Return what gives a sum of q, q′, q″, q‴ from all of `count` parameters, (m, count)."""
        rows = np.zeros((len(self.ends), count))
        each = np.stack([np.broadcast_to(factor, len(self.ends)) for factor in factors])
        local = (each[:, :, None] * self.weights).sum(axis=0)
        np.put_along_axis(rows, self.ends, local, axis=1)
        return rows


def side_rows(
    problem: Problem, spline: SpeedSpline, freedom: Freedom, units: Array
) -> tuple[Array, Array, Array]:
    """Return rows in the parameters alone: limits in both ramps, tolerance, and way between knots.

    As rows on the parameters, shape (r, 3 k), their scale and their centre, shape (n, r):
    |rows · parameters - centre| · scale ≤ 1.
    """
    limits, count = problem.limits, units.size
    rows, scales = [np.zeros((0, count))], [np.zeros((len(limits.names), 0))]
    for ramp, end, inward in (
        (spline.start_ramp, problem.start[0], 1.0),
        (spline.end_ramp, problem.end, -1.0),
    ):
        if ramp.time > 0.0:
            for row, scale in _on_ramp(ramp, end, inward, problem.path.knots.u, units, limits):
                rows.append(row)
                scales.append(np.repeat(scale[:, None], len(row), axis=1))
    centres = [np.zeros((len(limits.names), sum(len(row) for row in rows)))]
    moved = np.flatnonzero(freedom.free[:, 0])
    if len(moved):
        row = np.zeros((len(moved), count))
        row[np.arange(len(moved)), moved * PARAMETERS] = units[moved, 0]
        rows.append(row)
        scales.append(limits.velocity[:, None] / freedom.tolerance[moved])
        centres.append((freedom.centre[moved] / limits.velocity).T)
    for row, scale, centre in _between(problem.path, freedom, units, limits):
        rows.append(row)
        scales.append(scale)
        centres.append(centre)
    return np.concatenate(rows), np.concatenate(scales, axis=1), np.concatenate(centres, axis=1)


def _between(
    path: Path, freedom: Freedom, units: Array, limits: JointLimits
) -> Iterator[tuple[Array, Array, Array]]:
    """Yield rows, scale and centre: the path is about as near to the straight way as a spline."""
    knots = path.knots
    free: npt.NDArray[np.bool_] = np.any(freedom.free, axis=1)
    segment = np.flatnonzero(free[:-1] | free[1:])
    us = knots.u[segment] + np.diff(knots.u)[segment] * _BETWEEN[:, None]
    now, share = _bends(path, segment, us)
    # where the path bends more already it may: its ends may be those of a path in motion
    most = np.maximum(
        np.maximum(BEND_RATIO * _bends(freedom.spline, segment, us)[0], now), MIN_BEND
    )
    most += np.maximum(freedom.tolerance[segment], freedom.tolerance[segment + 1])
    scale = limits.velocity[:, None] / most
    ways = np.diff(knots.position, axis=0)[segment]
    for u, part in zip(us, share, strict=True):
        centre = (knots.position[segment] + part[:, None] * ways) / limits.velocity
        row = PathRows(u, knots.u, units).combined((1.0, 0.0, 0.0, 0.0), units.size)
        yield row, scale, centre.T


def _bends(path: Path, segment: npt.NDArray[np.intp], us: Array) -> tuple[Array, Array]:
    """Return how far segments (s,) are from the straight way, in any joint, shape (s,).

    And where on it, in its length, each of the places `us`, shape (7, s), is nearest to.
    """
    since = path.sample(us.ravel())[0].reshape(*us.shape, -1) - path.knots.position[segment]
    ways = np.diff(path.knots.position, axis=0)[segment]
    share = np.clip((since * ways).sum(axis=2) / (ways**2).sum(axis=1), 0.0, 1.0)
    return np.abs(since - share[:, :, None] * ways).max(axis=(0, 2)), share


def _on_ramp(
    ramp: Ramp, end: float, inward: float, knots: Array, units: Array, limits: JointLimits
) -> list[tuple[Array, Array]]:
    """Return rows on the parameters for acceleration and jerk in a ramp, each with its scale."""
    times = ramp.time * _ALONG_RAMP
    v, a = ramp.jerk * times**2 / 2.0, inward * ramp.jerk * times
    places = PathRows(end + inward * ramp.jerk * times**3 / 6.0, knots, units)
    bend = places.combined((0.0, a, v**2, 0.0), units.size)
    twist = places.combined((0.0, ramp.jerk, 3.0 * v * a, v**3), units.size)
    acceleration = (1.0 - optimal.ACCELERATION_RESERVE_SHARE) * limits.acceleration
    jerk = (1.0 - optimal.JERK_RESERVE_SHARE) * limits.jerk
    return [(bend, limits.velocity / acceleration), (twist, limits.velocity / jerk)]
