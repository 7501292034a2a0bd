# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Converts ROS goal requests to goals for the driver's queue."""

from collections.abc import Callable, Sequence
from dataclasses import replace

from builtin_interfaces.msg import Time
from control_msgs.action import FollowJointTrajectory
from control_msgs.msg import JointTolerance
from rclpy.clock import Clock

from epson_driver.driver.goal.goal import Goal, Tolerances, untimed
from epson_driver.driver.outcome import ErrorCode, GoalRejectedError
from epson_driver.node.trajectory_messages import (
    duration_in_s,
    tolerances_from_messages,
    trajectory_from_message,
)
from epson_driver.setup.setup import Setup

MAX_START_OFFSET_S = 1.0
"""Maximum age and lead of a stamp, s. Other goals are rejected, because the arm would move
unexpectedly."""

UNSUPPORTED = ('multi_dof_trajectory', 'component_path_tolerance', 'component_goal_tolerance')
"""Fields for joints with several degrees of freedom. They must be empty."""

EMPTY = FollowJointTrajectory.Goal()


class GoalRequests:
    """Reads requests, using the current parameters. The queue checks the limits.

    `clock`: the node's. `loop_time`: the clock of the queue's loop, s.
    """

    def __init__(self, setup: Setup, clock: Clock, loop_time: Callable[[], float]) -> None:
        self._limits = setup.model.limits
        self._setup = setup
        self._clock = clock
        self._loop_time = loop_time

    def checked_goal(self, request: FollowJointTrajectory.Goal) -> Goal:
        """Return the goal of a request with checked names and stamps. Raises GoalRejectedError."""
        check_unsupported(request)
        trajectory = trajectory_from_message(request.trajectory, self._limits.names)
        if self._setup.values['timing'] == 'time_optimal':
            trajectory = untimed(trajectory, self._limits)
        stamp = request.trajectory.header.stamp
        start = start_time(stamp, trajectory.duration, self._clock, self._loop_time)
        usual = self._setup.goal(trajectory)
        path = self._tolerances(request.path_tolerance, 'path_tolerance', 'trajectory')
        goal = self._tolerances(request.goal_tolerance, 'goal_tolerance', 'goal')
        goal_time = duration_in_s(request.goal_time_tolerance)
        return replace(
            usual,
            goal_tolerance=goal.position,
            goal_time=max(goal_time, 0.0) if goal_time != 0.0 else usual.goal_time,
            goal_velocity=goal.velocity,
            path_tolerance=path if path.checked else None,
            start=start,
        )

    def _tolerances(self, given: Sequence[JointTolerance], field: str, kind: str) -> Tolerances:
        """Return a field's tolerances. The default is `constraints.<joint>.<kind>`."""
        usual = self._setup.tolerances(kind).position
        return tolerances_from_messages(given, field, self._limits.names, usual)


def check_unsupported(request: FollowJointTrajectory.Goal) -> None:
    """Raise GoalRejectedError for an unsupported field that is not empty."""
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
