# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""TOPP-RA: the fastest time on a path within velocity and acceleration alone. No jerk limit.

Pham and Pham, "A New Approach to Time-Optimal Path Parameterization Based on Reachability
Analysis", IEEE Transactions on Robotics 34 (2018). Nothing that keeps the jerk can be faster.
"""

import logging

import numpy as np
from toppra.algorithm import TOPPRA
from toppra.constraint import JointAccelerationConstraint, JointVelocityConstraint
from toppra.interpolator import AbstractGeometricPath

from benchmark.spline_path import SplinePath
from epson_driver.motion import Array, JointLimits

GRID_POINTS = 4000
"""Grid points beside those at the knots."""

logging.getLogger('toppra').setLevel(logging.ERROR)


class _Path(AbstractGeometricPath):  # type: ignore[misc]
    """A SplinePath as toppra wants to see it."""

    def __init__(self, path: SplinePath) -> None:
        self._path = path

    def __call__(self, path_positions: float | Array, order: int = 0) -> Array:
        values = self._path.at(np.atleast_1d(np.asarray(path_positions, dtype=float)))[order]
        return values if np.ndim(path_positions) else values[0]

    @property
    def dof(self) -> int:
        return int(self._path.coefficients.shape[2])

    @property
    def path_interval(self) -> Array:
        return np.array([0.0, self._path.length])


def jerk_free_time(path: SplinePath, limits: JointLimits) -> float:
    """Return the time of the fastest motion from rest to rest, s.

    Raises RuntimeError if TOPP-RA finds none.
    """
    uniform = np.linspace(0.0, path.length, GRID_POINTS)
    # denser at both ends, where the speed grows as the root of the way
    ends = path.length * np.geomspace(1e-7, 1.0 / GRID_POINTS, 40)
    grid = np.unique(np.concatenate([uniform, ends, path.length - ends, path.knots]))
    grid = grid[np.append(True, np.diff(grid) > 1e-12 * path.length)]
    grid[-1] = path.length
    bounds = [
        JointVelocityConstraint(np.stack([-limits.velocity, limits.velocity], axis=1)),
        JointAccelerationConstraint(np.stack([-limits.acceleration, limits.acceleration], axis=1)),
    ]
    solver = TOPPRA(bounds, _Path(path), gridpoints=grid, solver_wrapper='seidel')
    _, speeds, _ = solver.compute_parameterization(0.0, 0.0)
    if speeds is None or not np.all(np.isfinite(speeds)):
        raise RuntimeError('TOPP-RA found no motion')
    # u̇² is linear in u on every interval: its time is exactly this
    return float(np.sum(2.0 * np.diff(grid) / (speeds[1:] + speeds[:-1])))
