# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""From the request of a goal, as it comes from ROS, to a goal for the driver's queue."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
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

MAX_START_OFFSET_S = 1.0
"""A stamp further ahead, or in the past, is rejected: the arm would move unexpectedly, s."""

UNSUPPORTED = ('multi_dof_trajectory', 'component_path_tolerance', 'component_goal_tolerance')
"""Fields of joints with several degrees of freedom: they must be empty."""

EMPTY = FollowJointTrajectory.Goal()


class GoalRequests:
    """Reads requests, with the parameters that hold at that moment. The queue checks limits.

    `parameters`: the node's values by name, which may change. `clock`: the node's. `loop_time`:
    the clock of the queue's loop, s.
    """

    def __init__(
        self,
        limits: JointLimits,
        parameters: Mapping[str, Any],
        clock: Clock,
        loop_time: Callable[[], float],
    ) -> None:
        self._limits = limits
        self._parameters = parameters
        self._clock = clock
        self._loop_time = loop_time

    def checked_goal(self, request: FollowJointTrajectory.Goal) -> Goal:
        """Return the goal of a request, names and stamps checked. Raises GoalRejectedError."""
        values = self._parameters
        check_unsupported(request)
        trajectory = trajectory_from_message(request.trajectory, self._limits.names)
        if values['timing'] == 'time_optimal':
            trajectory = untimed(trajectory, self._limits)
        stamp = request.trajectory.header.stamp
        start = start_time(stamp, trajectory.duration, self._clock, self._loop_time)
        goal_time = duration_in_s(request.goal_time_tolerance)
        goal = self._goal(trajectory, request.path_tolerance, request.goal_tolerance, goal_time)
        return replace(goal, start=start)

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


def check_unsupported(request: FollowJointTrajectory.Goal) -> None:
    """Raise GoalRejectedError for a field that the driver cannot honour."""
    for field in UNSUPPORTED:
        if getattr(request, field) != getattr(EMPTY, field):
            raise GoalRejectedError(
                ErrorCode.INVALID_GOAL,
                f'{field} must be empty: joints with several degrees of freedom are not supported',
            )


def start_time(
    stamp: Time, duration: float, clock: Clock, loop_time: Callable[[], float]
) -> float:
    """Return the start of a trajectory of `duration` s by the loop's clock, s, 0 for immediately.

    Raises GoalRejectedError for a stamp too far ahead, or too old.
    """
    if stamp == Time():
        return 0.0
    ahead: float = (stamp.sec * 10**9 + stamp.nanosec - clock.now().nanoseconds) * 1e-9
    oldest = min(duration, MAX_START_OFFSET_S)
    if -ahead > oldest:
        raise GoalRejectedError(
            ErrorCode.OLD_HEADER_TIMESTAMP,
            f'header.stamp is {-ahead:.3g} s ago: must be at most {oldest:.3g} s, by the clock of '
            'the driver (0 starts immediately)',
        )
    if ahead > MAX_START_OFFSET_S:
        raise GoalRejectedError(
            ErrorCode.INVALID_GOAL,
            f'header.stamp is {ahead:.3g} s in the future: must be at most '
            f'{MAX_START_OFFSET_S:g} s, by the clock of the driver',
        )
    return loop_time() + ahead
