# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A goal: what was asked, in the controller's joint order."""

from dataclasses import dataclass

from epson_driver.driver.goal.tolerances import Tolerances
from epson_driver.motion import Array, Trajectory


@dataclass(frozen=True, eq=False)
class Goal:
    """A trajectory in the controller's joint order and what counts as having done it.

    goal_tolerance: shape (n,), rad; inf where it is not checked. goal_time: s after the planned
    end within which the arm must be there; 0 means no limit. goal_velocity: shape (n,), rad/s,
    below which each joint counts as standing at the end, if that is less than what holds for all;
    None: no such. path_tolerance: on the way, against the plan at that moment; None: not checked.
    units: 'rad' or 'm', one per joint; all rad where nothing is said. may_end_moving: its last
    point may have a velocity; the arm comes to rest there anyway.

    The goal queue checks every goal before anything of it is sent.
    """

    trajectory: Trajectory
    goal_tolerance: Array
    goal_time: float
    goal_velocity: Array | None = None
    path_tolerance: Tolerances | None = None
    units: tuple[str, ...] = ()
    may_end_moving: bool = False

    def unit(self, joint: int) -> str:
        """Return the unit of a joint's position, by its index."""
        return self.units[joint] if self.units else 'rad'
