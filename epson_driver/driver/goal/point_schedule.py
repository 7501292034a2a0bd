# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""When each point of a goal may be sent, and how fast it then runs."""

from collections.abc import Sequence

from epson_driver.driver.delivery.trajectory_points import MIN_DURATION_S
from epson_driver.driver.goal.goal_clock import GoalClock
from epson_driver.driver.goal.speed_scaling import SpeedScaling, scaled
from epson_driver.motion import Array, Trajectory
from epson_driver.simple_message import Message


class PointSchedule:
    """Scales the messages of one trajectory to the speed of the moment, and keeps its clock.

    `start`: shape (n,), rad, where the arm stands. `begins_by`: when the controller begins to move
    it at the latest, monotonic, s.
    """

    def __init__(
        self,
        trajectory: Trajectory,
        messages: Sequence[Message],
        start: Array,
        scaling: SpeedScaling,
        begins_by: float,
    ) -> None:
        self.clock = GoalClock(trajectory, start, scaling, begins_by)
        self.duration = 0.0
        """How long the point that was sent last takes, s."""
        self._times = trajectory.times
        self._messages = messages
        self._scaling = scaling
        self._sent_until = begins_by
        self._delay = 0.0

    def __len__(self) -> int:
        """How many points there are."""
        return len(self._messages)

    def message(self, index: int, now: float) -> Message | None:
        """Return the point to send now; None if it is held back, as long as the factor is 0."""
        before = float(self._times[index - 1]) if index else 0.0
        planned = max(float(self._times[index]) - before, MIN_DURATION_S)
        begin = max(now, self._sent_until)  # it runs after what was sent before
        takes = self._scaling.time_for(planned, begin)
        self.clock.held = takes is None
        if takes is None:
            return None
        factor = planned / takes
        self._sent_until = begin + takes
        self._delay += takes - planned
        message = scaled(self._messages[index], factor, self._delay)
        self.duration = max(takes, getattr(message, 'duration', 0.0))
        self.clock.sent(factor)
        return message
