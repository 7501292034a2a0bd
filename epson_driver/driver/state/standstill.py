# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Detects standstill from measured positions and the controller's in_motion flag."""

import numpy as np

from epson_driver.driver.state.joint_velocity import VELOCITY_WINDOW_S
from epson_driver.driver.state.robot_state import JointSample, RobotState
from epson_driver.motion import Array
from epson_driver.simple_message import TriState

REST_TIME_S = 0.05
"""Minimum standstill until the arm is at rest, s. Longer than the velocity window."""

UNCONFIRMED_REST_TIME_S = 1.0
"""Minimum standstill if the controller has not confirmed STOP, s. It may be slow to execute
earlier messages."""

UNREPORTED_REST_TIME_S = 0.2
"""Minimum standstill at a goal if the controller does not report whether the arm moves, s."""

MIN_MOVEMENT_RAD = 1e-4
"""Change of position that counts as motion, rad. Well above the resolution of an encoder."""


class Standstill:
    """Detects whether the arm moves. Times are monotonic, s.

    Samples count by the time at which joints and status were measured, not by their arrival: a
    network may delay them, and a standstill before the motion started must not count as one after
    it.

    `alive` is the time of the last motion. The owner also updates it when the controller replies.
    """

    def __init__(self, now: float) -> None:
        self.alive = now
        self._alive_at: Array | None = None
        self._after: float | None = None
        self._rest = REST_TIME_S
        self._since: float | None = None
        self._stands_at: Array = np.zeros(0)

    def expect(self, after: float | None, rest: float = REST_TIME_S) -> None:
        """Count only samples measured after `after`, when the motion may have started.

        None: no sample counts yet. `rest`: required standstill, s.
        """
        self._after = after
        self._rest = rest
        self._since = None

    def expect_rest(self, rest: float) -> None:
        """Require a standstill of `rest` s, including the time already at rest."""
        self._rest = rest

    def see(self, sample: JointSample, robot: RobotState, stopped: Array, now: float) -> None:
        """Process a sample. `stopped`: velocities below which joints are stopped, rad/s, (n,)."""
        if (
            self._alive_at is None
            or np.abs(sample.positions - self._alive_at).max() > MIN_MOVEMENT_RAD
        ):
            self._alive_at = sample.positions
            self.alive = now
        moving = bool(np.any(np.abs(sample.velocities) >= stopped))
        if self._since is not None and robot.in_motion == TriState.UNKNOWN:  # it may creep
            moved = np.abs(sample.positions - self._stands_at)
            moving |= bool(np.any(moved >= stopped * VELOCITY_WINDOW_S))
        if moving or robot.in_motion == TriState.TRUE or self._after is None:
            self._since = None
        elif (
            self._since is None
            and sample.measured > self._after
            and (robot.in_motion == TriState.UNKNOWN or robot.status_measured > self._after)
        ):
            self._since, self._stands_at = sample.measured, sample.positions

    @property
    def is_at_rest(self) -> bool:
        """Whether the arm was at rest in the last sample that counts."""
        return self._since is not None

    def reached(self, now: float) -> bool:
        """Return whether the arm has been at rest long enough at `now`, a sample's `measured`."""
        return self._since is not None and now - self._since >= self._rest
