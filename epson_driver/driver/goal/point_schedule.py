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
    it at the latest, monotonic, s. `lead`: how far ahead of the clock points are sent, s.

    `sent`: the factors with which its first points were sent already, as those of another goal,
    and `sent_until`: when the last of them is reached, monotonic, s.
    """

    def __init__(
        self,
        trajectory: Trajectory,
        messages: Sequence[Message],
        start: Array,
        scaling: SpeedScaling,
        begins_by: float,
        *,
        lead: float = float('inf'),
        sent: Sequence[float] = (),
        sent_until: float = 0.0,
    ) -> None:
        self.clock = GoalClock(trajectory, start, scaling, begins_by, sent)
        self.duration = max(sent_until - begins_by, 0.0)
        """How long the point that was sent last takes, s, or what was sent before."""
        self.waits = False
        """A point is held back, for the speed scaling or as it is too far ahead of the clock."""
        self.sent_until = max(begins_by, sent_until)
        """When what was sent ends, monotonic, s."""
        self._times = trajectory.times.data  # gives floats, as an array does not
        self._messages = messages
        self._count = len(messages)
        self._scaling = scaling
        self._lead = lead
        self._delay = 0.0

    def __len__(self) -> int:
        """How many points there are."""
        return self._count

    def ahead(self, index: int) -> float:
        """Return how far ahead of the clock a point is, s; 0 if it is not."""
        return max(self._times[index] - self.clock.time, 0.0) if index >= 0 else 0.0

    def message(self, index: int, now: float) -> Message | None:
        """Return the point to send now; None if it is held back.

        That is as long as the factor is 0, and while what was sent reaches `lead` s ahead.
        """
        before = self._times[index - 1] if index else 0.0
        planned = max(self._times[index] - before, MIN_DURATION_S)
        begin = max(now, self.sent_until)  # it runs after what was sent before
        takes = self._scaling.time_for(planned, begin)
        self.clock.held = takes is None
        self.waits = takes is None or before - self.clock.time > self._lead
        if takes is None or self.waits:
            return None
        factor = planned / takes
        self.sent_until = begin + takes
        self._delay += takes - planned
        message = scaled(self._messages[index], factor, self._delay)
        self.duration = max(takes, getattr(message, 'duration', 0.0))
        self.clock.sent(factor)
        return message
