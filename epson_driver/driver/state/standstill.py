# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Since when the arm stands, by what is measured and by what the controller says."""

import numpy as np

from epson_driver.driver.state.joint_velocity import VELOCITY_WINDOW_S
from epson_driver.driver.state.robot_state import JointSample, RobotState
from epson_driver.motion import Array
from epson_driver.simple_message import TriState

REST_TIME_S = 0.05
"""How long the arm must stand before it counts as standing, s: more than the velocity window."""

UNCONFIRMED_REST_TIME_S = 1.0
"""How long it must stand where the controller has not confirmed STOP, s: it may be slow to do what
it was sent before."""

UNSAID_REST_TIME_S = 0.2
"""How long it must stand at a goal where the controller does not say whether it moves, s."""

MIN_MOVEMENT_RAD = 1e-4
"""A change of position that shows that the arm moves, rad: well above an encoder's step."""


class Standstill:
    """Sees whether the arm moves. Times are monotonic, s.

    What counts is when joints and status were measured, not when they came: a network may hold
    them up, and what stood before the motion began is no standstill after it.

    `alive` is when the arm was last seen to move; whoever hears from the controller sets it, too.
    """

    def __init__(self, now: float) -> None:
        self.alive = now
        self._alive_at: Array | None = None
        self._after: float | None = None
        self._rest = REST_TIME_S
        self._since: float | None = None
        self._stands_at: Array = np.zeros(0)

    def expect(self, after: float | None, rest: float = REST_TIME_S) -> None:
        """Count only samples after this time, before which the motion may not have begun.

        None: nothing counts yet. `rest`: how long the arm must stand, s.
        """
        self._after = after
        self._rest = rest
        self._since = None

    def expect_rest(self, rest: float) -> None:
        """Require rest for `rest` s, including the time the arm has stood already."""
        self._rest = rest

    def see(self, sample: JointSample, robot: RobotState, stopped: Array, now: float) -> None:
        """Take a sample. `stopped`: rad/s, shape (n,), below which a joint counts as standing."""
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
    def stands(self) -> bool:
        """Whether the arm stood in the last sample that counts."""
        return self._since is not None

    def reached(self, now: float) -> bool:
        """Return whether the arm has stood for long enough at `now`, the sample's `measured`."""
        return self._since is not None and now - self._since >= self._rest
