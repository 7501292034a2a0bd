# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Whether an arm that stands has arrived at its goal."""

from functools import cached_property

import numpy as np

from epson_driver.driver.goal.goal import Goal
from epson_driver.motion import Array


class Arrival:
    """Compares where the arm is with the end of one goal. Distances have shape (n,), rad."""

    def __init__(self, goal: Goal) -> None:
        self._goal = goal
        self._left = False

    @cached_property
    def _min_excursion(self) -> float:
        """See `_min_excursion`. It looks at every point: not before the first one is sent."""
        return _min_excursion(self._goal)

    def see(self, positions: Array) -> Array:
        """Take measured positions, shape (n,), rad; return how far they are from the end."""
        distance: Array = np.abs(positions - self._goal.trajectory.positions[-1])
        self._left = self._left or float(distance.max()) >= self._min_excursion
        return distance

    def reached(self, distance: Array) -> bool:
        """Return whether the arm is at the goal, and has been on its way to it."""
        return self._left and bool(np.all(distance <= self._goal.goal_tolerance))

    def shortfall(self, distance: Array) -> str:
        """Return what an arm that stands at this distance has not done, as a clause."""
        if not self._left:
            return 'the controller acknowledged all points, but the arm did not move'
        tolerance = self._goal.goal_tolerance
        joint = int(np.argmax(distance - tolerance))
        name, unit = self._goal.trajectory.joint_names[joint], self._goal.unit(joint)
        return (
            f'the arm stands, and {name} is {distance[joint]:.6g} {unit} from the goal: '
            f'the tolerance is {tolerance[joint]:.6g} {unit}'
        )


def _min_excursion(goal: Goal) -> float:
    """Return how far from the goal the arm must have been seen, rad.

    On a path that ends where it began, an arm that has not moved yet is at the goal, too.
    """
    positions = goal.trajectory.positions
    last = positions[-1]
    excursion = float(np.maximum(positions.max(axis=0) - last, last - positions.min(axis=0)).max())
    finite = goal.goal_tolerance[np.isfinite(goal.goal_tolerance)]
    return excursion / 2 if excursion > 2 * float(finite.max(initial=0.0)) else 0.0
