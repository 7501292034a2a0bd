# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The driver interface needed by the panel. Its ROS implementation: ros_robot.py."""

from collections.abc import Callable, Sequence
from typing import Any, Protocol

from epson_driver.motion import Array, Trajectory
from epson_driver.panel.robot_state import RobotState

Say = Callable[[str, int], object]
"""Callback for the outcome of a request: a sentence and its log level."""


class Robot(Protocol):
    """A driver: its reported state and the requests to it, over ROS or simulated.

    Requests do not block. They raise RequestError if no server is available.
    """

    state: RobotState
    parameters: dict[str, Any]

    @property
    def name(self) -> str:
        """Return the name of the driver's node."""

    @property
    def goals(self) -> Sequence[object]:
        """Return the panel's goals that have not ended."""

    def log(self, text: str, level: int) -> None:
        """Add a line of the panel to the log of the driver."""

    def trigger(self, name: str, say: Say) -> None:
        """Call a service of the driver by name."""

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
