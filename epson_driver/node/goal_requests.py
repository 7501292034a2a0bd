# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""From the request of a goal, as it comes from ROS, to a goal for the driver's queue."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from control_msgs.action import FollowJointTrajectory
from control_msgs.msg import JointTolerance
from rclpy.clock import Clock

from epson_driver.driver.goal.goal import Goal, Tolerances, untimed
from epson_driver.driver.outcome import ErrorCode, GoalRejectedError
from epson_driver.motion import JointLimits, Trajectory
from epson_driver.node.trajectory_messages import (
    duration_in_s,
    tolerances_from_messages,
    trajectory_from_message,
)

MAX_START_AHEAD_S = 1.0
"""A trajectory stamped further ahead is rejected: it would move when nobody expects it, s."""


class GoalRequests:
    """Reads requests, with the parameters that hold at that moment. The queue checks limits.

    `parameters`: the node's values by name, which may change. `clock`: the node's.
    """

    def __init__(self, limits: JointLimits, parameters: Mapping[str, Any], clock: Clock) -> None:
        self._limits = limits
        self._parameters = parameters
        self._clock = clock

    def checked_goal(self, request: FollowJointTrajectory.Goal) -> Goal:
        """Return the goal of a request, names and stamps checked. Raises GoalRejectedError."""
        values = self._parameters
        check_single(request)
        trajectory = trajectory_from_message(request.trajectory, self._limits.names)
        if values['timing'] == 'time_optimal':
            trajectory = untimed(trajectory, self._limits)
        check_stamp(request.trajectory.header.stamp, trajectory.duration, self._clock)
        goal_time = duration_in_s(request.goal_time_tolerance)
        return self._goal(trajectory, request.path_tolerance, request.goal_tolerance, goal_time)

    def planned_goal(self, trajectory: Trajectory) -> Goal:
        """Return the goal of a trajectory that was planned here: the parameters' tolerances."""
        return self._goal(trajectory, (), (), 0.0)

    def _goal(
        self,
        trajectory: Trajectory,
        path_tolerance: Sequence[JointTolerance],
        goal_tolerance: Sequence[JointTolerance],
        goal_time: float,
    ) -> Goal:
        values = self._parameters
        path = self._tolerances(path_tolerance, 'path_tolerance', 'trajectory')
        goal = self._tolerances(goal_tolerance, 'goal_tolerance', 'goal')
        return Goal(
            trajectory,
            goal.position,
            max(goal_time, 0.0) if goal_time != 0.0 else values['constraints.goal_time'],
            goal_velocity=goal.velocity,
            path_tolerance=path if path.checked else None,
            units=self._limits.units,
            may_end_moving=values['allow_nonzero_velocity_at_trajectory_end'],
        )

    def _tolerances(self, given: Sequence[JointTolerance], field: str, default: str) -> Tolerances:
        """Return a field's tolerances over the parameters `constraints.<joint>.<default>`."""
        names = self._limits.names
        defaults = [self._parameters[f'constraints.{name}.{default}'] for name in names]
        return tolerances_from_messages(given, field, names, np.array(defaults))


def check_single(request: FollowJointTrajectory.Goal) -> None:
    """Raise GoalRejectedError for joints of several degrees of freedom."""
    if request.multi_dof_trajectory.points:
        raise GoalRejectedError(
            ErrorCode.INVALID_GOAL, 'multi_dof_trajectory has points: not supported'
        )


def check_stamp(stamp: Time, duration: float, clock: Clock) -> None:
    """Raise GoalRejectedError for a trajectory that has ended, or begins much later."""
    start = duration_in_s(stamp)
    if start == 0.0:
        return
    ahead = start - clock.now().nanoseconds * 1e-9
    if ahead + duration < 0.0:
        raise GoalRejectedError(
            ErrorCode.OLD_HEADER_TIMESTAMP,
            f'header.stamp: the trajectory ended {-ahead - duration:.3g} s ago',
        )
    if ahead > MAX_START_AHEAD_S:
        raise GoalRejectedError(
            ErrorCode.INVALID_GOAL,
            f'header.stamp is {ahead:.3g} s in the future: a start later than in '
            f'{MAX_START_AHEAD_S:g} s is not supported',
        )
