# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A driver as the panel needs it. How that is done by ROS: ros_robot.py."""

from collections.abc import Callable, Sequence
from typing import Any, Protocol

from epson_driver.motion import Array, Trajectory
from epson_driver.panel.robot_state import RobotState

Say = Callable[[str, int], object]
"""Takes a sentence about what became of a request, and its level."""


class Robot(Protocol):
    """A driver: what it reports, and what can be asked of it, by ROS or played.

    Requests wait for nothing, and raise RequestError if nobody serves them.
    """

    state: RobotState
    parameters: dict[str, Any]

    @property
    def name(self) -> str:
        """Return the name of the driver's node."""

    @property
    def goals(self) -> Sequence[object]:
        """Return those that the panel has sent, and that have not ended."""

    def log(self, text: str, level: int) -> None:
        """Add a line of the panel to the log of the driver."""

    def trigger(self, name: str, say: Say) -> None:
        """Call one of the driver's services."""

    def set_speed(self, factor: float, say: Say) -> None:
        """Set the speed of trajectories, as a share of the plan."""

    def write_output(self, index: int, value: int, say: Say) -> None:
        """Set a digital output."""

    def jog(self, names: Sequence[str], velocities: Array) -> None:
        """Send velocities of joints, rad/s or m/s."""

    def execute(self, trajectory: Trajectory, text: str, say: Say) -> None:
        """Send a trajectory as a goal."""

    def cancel_goals(self) -> Sequence[object]:
        """Cancel every goal that the panel has sent and return those that have not ended yet."""
