# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Detects standstill from measured positions and the controller's in_motion flag."""

import numpy as np

from epson_driver.driver.state.joint_velocity import VELOCITY_WINDOW_S
from epson_driver.driver.state.robot_state import JointSample, RobotState
from epson_driver.motion import Array
from epson_driver.simple_message import TriState

REST_TIME_S = 0.05
"""Duration of a standstill after which the arm counts as at rest, s. It is longer than
VELOCITY_WINDOW_S, the window in which velocities are estimated."""

UNCONFIRMED_REST_TIME_S = 1.0
"""Duration of a standstill that counts as rest after a STOP without acknowledgement, s. It is
longer than REST_TIME_S, because the controller may still execute earlier points."""

UNREPORTED_REST_TIME_S = 0.2
"""Standstill that counts as rest at a goal if the controller never reports in_motion, s."""

MIN_MOVEMENT_RAD = 1e-4  # minimum change that counts as motion. Encoders are finer


class Standstill:
    """Detects whether the arm is at rest. Times are monotonic, s.

    Only the measurement times of joints and status are used, not their arrival times. Otherwise a
    delayed sample from before the motion could count as standstill after it.

    The controller must also report that the arm is at rest. Because STATUS is less frequent than
    joint states, a standstill counts from up to REST_TIME_S before this report.

    `alive` is the time of the last motion. The owner also updates it when the controller replies.
    """

    def __init__(self, now: float) -> None:
        self.alive = now
        self._last_position: Array | None = None
        self._after: float | None = None
        self._rest = REST_TIME_S
        self._still: float | None = None
        self._since: float | None = None
        self._reported: float | None = None
        self._rest_position: Array = np.zeros(0)

    def expect(self, after: float | None, rest: float = REST_TIME_S) -> None:
        """Restart the detection. Samples measured later than `after` count. None: none yet."""
        self._after = after
        self._rest = rest
        self._still = self._since = None

    def expect_rest(self, rest: float) -> None:
        """Change the required duration of the standstill, s. A current standstill continues."""
        self._rest = rest

    def update(self, sample: JointSample, robot: RobotState, stopped: Array, now: float) -> None:
        last = self._last_position
        if last is None or np.abs(sample.positions - last).max() > MIN_MOVEMENT_RAD:
            self._last_position = sample.positions
            self.alive = now
        moving = bool(np.any(np.abs(sample.velocities) >= stopped))
        if self._since is not None and robot.in_motion == TriState.UNKNOWN:  # it may creep
            moved = np.abs(sample.positions - self._rest_position)
            moving |= bool(np.any(moved >= stopped * VELOCITY_WINDOW_S))
        if moving or self._after is None:
            self._still = self._since = None
        elif sample.measured > self._after:
            if self._still is None:
                self._still = sample.measured
            if robot.in_motion == TriState.TRUE:
                self._since = None
            elif self._since is None and (
                robot.in_motion == TriState.UNKNOWN or robot.status_measured > self._after
            ):
                self._since = max(self._still, sample.measured - REST_TIME_S)
                self._rest_position = sample.positions
            reported = robot.status_measured
            if robot.in_motion == TriState.FALSE and reported < sample.measured:
                self._reported = reported

    @property
    def is_at_rest(self) -> bool:
        """Whether the arm did not move in the last sample, regardless of the duration."""
        return self._since is not None

    @property
    def is_reported(self) -> bool:
        """Whether the controller has reported rest for this standstill, and joints followed.

        Estimated velocities show a standstill late, by up to VELOCITY_WINDOW_S.
        """
        if self._since is None or self._still is None or self._reported is None:
            return False
        return self._reported > self._still - VELOCITY_WINDOW_S

    def reached(self, now: float) -> bool:
        """Return whether the arm has been at rest long enough. `now`: time of measurement, s."""
        return self._since is not None and now - self._since >= self._rest
