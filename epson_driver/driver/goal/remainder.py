# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The rest of a plan after a pause, from the position where the arm came to rest.

The arm does not stop at a planned point, and no controller reports how much of the plan it has
executed. The rest of the plan therefore starts at the position of the planned path closest to the
arm. A path may pass one position several times, for example in a pick and place. Among positions
at about the same distance, the one whose planned time is closest to the expected time is chosen.
"""

import numpy as np

from epson_driver.driver.delivery.trajectory_points import (
    MIN_DURATION_S,
    MIN_VELOCITY,
    START_MARGIN_RAD,
)
from epson_driver.motion import Array, JointLimits, Trajectory

TIME_WEIGHT = 0.05
"""Weight of the difference from the expected time, relative to the distance from the path. Both
are in s: the distance is divided by the plan's maximum speed."""

FROM_REST = 1.5
"""Factor on the time to the first point, because the arm accelerates from rest."""


def remainder(
    plan: Trajectory, start: Array, rest: Array, expected: float, limits: JointLimits
) -> Trajectory:
    """Return the trajectory from `rest` through the points that the arm has not passed.

    `start`: arm position at the start of the plan, shape (n,), rad. `rest`: arm position at rest,
    shape (n,), rad. `expected`: estimated plan time at which the arm stopped, s.

    The times between points are unchanged. Relative to the velocity limits, the arm moves to the
    first point no faster than the plan's fastest joint. A plan without motion is returned whole.
    """
    times, positions = plan.times, plan.positions
    added = int(times[0] > 0.0)
    if added:
        times, positions = np.append(0.0, times), np.vstack([start, positions])
    steps, durations = np.diff(positions, axis=0) / limits.velocity, np.diff(times)
    if np.max(np.abs(positions - positions[0])) < START_MARGIN_RAD:
        return plan
    fastest = float(np.max(np.abs(steps) / durations[:, None]))
    offsets = (rest - positions[:-1]) / limits.velocity
    squares = np.maximum(np.sum(steps**2, axis=1), np.finfo(float).tiny)
    fractions = np.clip(np.sum(offsets * steps, axis=1) / squares, 0.0, 1.0)
    distances = np.linalg.norm(offsets - fractions[:, None] * steps, axis=1)
    reached = times[:-1] + fractions * durations
    segment = int(np.argmin(distances / fastest + TIME_WEIGHT * np.abs(reached - expected)))
    first, last = segment + 1, len(times) - 1
    if first < last and np.max(np.abs(positions[first] - rest)) < START_MARGIN_RAD:
        first += 1
    approach = float(np.max(np.abs(positions[first] - rest) / limits.velocity))
    approach /= max(fastest, MIN_VELOCITY)  # a lower velocity is never sent
    needed = FROM_REST * max(float(times[first] - reached[segment]), approach, MIN_DURATION_S)

    def from_rest(values: Array | None) -> Array | None:
        """Return a row of zeros for the arm at rest, then `values` at the remaining points."""
        if values is None:
            return None
        return np.vstack([np.zeros_like(rest), values[first - added :]])

    return Trajectory(
        plan.joint_names,
        np.append(0.0, needed + times[first:] - times[first]),
        np.vstack([limits.settled(rest), positions[first:]]),
        from_rest(plan.velocities),
        from_rest(plan.accelerations),
    )
