# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Goals of 10 to 100,000 points: what grows with their length before the first point is sent.

In one process, without sockets: the stages from the bytes of the action's request to the first
message, one by one. `message`: rclpy makes objects of the bytes, before the goal is accepted.
`arrays`: these become a trajectory. `checks`: every point against every limit. `first`: from the
checked goal to its first message. `memory`: the most that the last two held at once, beyond the
goal itself.
"""

import time
import tracemalloc
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from builtin_interfaces.msg import Duration
from control_msgs.action import FollowJointTrajectory
from rclpy.serialization import deserialize_message, serialize_message
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from epson_driver.driver.delivery.delivery import DeliveryRules
from epson_driver.driver.delivery.streaming import Streaming
from epson_driver.driver.goal.goal import Goal, GoalSettings, checked_goal
from epson_driver.driver.goal.goal_execution import GoalExecution
from epson_driver.driver.state.joint_mapping import unmapped
from epson_driver.link import Link
from epson_driver.motion import JointLimits
from epson_driver.node.trajectory_messages import trajectory_from_message
from epson_driver.robots import load_robot_model
from epson_driver.simple_message import Message

LENGTHS = (10, 100, 1_000, 10_000, 100_000)
POINT_PERIOD_S = 0.004
ANGLE_RAD = 0.1
NS_PER_S = 1_000_000_000


@dataclass(frozen=True)
class GoalLength:
    """CPU times in s, memory in bytes."""

    points: int
    message: float
    arrays: float
    checks: float
    first: float
    memory: int


def slow_wave(points: int, start: float = 0.0) -> JointTrajectory:
    """Return a trajectory that begins and ends at rest, joint 1 to and fro from `start`, rad."""
    limits = load_robot_model('c3_a601s').limits
    message = JointTrajectory(joint_names=list(limits.names))
    swing = 2 * np.pi / max(1.0, (points - 1) * POINT_PERIOD_S / 4)
    for index in range(points):
        at = index * POINT_PERIOD_S
        angle = start + ANGLE_RAD * (1.0 - float(np.cos(swing * at))) / 2
        sec, nanosec = divmod(round(at * NS_PER_S), NS_PER_S)
        point = JointTrajectoryPoint(
            positions=[angle] + [start] * 5, time_from_start=Duration(sec=sec, nanosec=nanosec)
        )
        message.points.append(point)
    return message


def timed(work: Callable[[], Any], rounds: int) -> tuple[float, Any]:
    """Return the CPU time of the best of some rounds, s, and what the work returned."""
    times, result = [], None
    for _ in range(rounds):
        begin = time.thread_time()
        result = work()
        times.append(time.thread_time() - begin)
    return min(times), result


def measure_one(points: int, limits: JointLimits, rounds: int) -> GoalLength:
    """Measure goals of one length."""
    request = FollowJointTrajectory.Goal(trajectory=slow_wave(points))
    data = serialize_message(request)
    message, request = timed(lambda: deserialize_message(data, type(request)), min(rounds, 3))
    arrays, trajectory = timed(
        lambda: trajectory_from_message(request.trajectory, limits.names), rounds
    )
    joints = len(limits.names)
    goal = Goal(trajectory, np.full(joints, 0.01), 0.0)
    checks, _ = timed(lambda: checked_goal(goal, limits), rounds)
    link = Link('none', '127.0.0.1', 1, on_packet=lambda _: None, on_state=lambda *_: None)
    delivery = Streaming(link, limits, unmapped(joints), DeliveryRules())
    sent: list[Message] = []

    def begin() -> None:
        sent.clear()
        execution = GoalExecution(
            goal, GoalSettings(), lambda point, _: sent.append(point), lambda _: None, 0.0
        )
        prepared = delivery.prepare(trajectory, trajectory.positions[0])
        execution.start(
            prepared.trajectory, prepared.messages, 0.0, trajectory.positions[0], prepared.delay
        )
        if len(sent) != 1:
            raise AssertionError('no first point')

    first, _ = timed(begin, 10 * rounds)  # so short that a few would be noise
    tracemalloc.start()
    checked_goal(goal, limits)
    begin()
    memory = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return GoalLength(points, message, arrays, checks, first, memory)


def measure(*, quick: bool) -> list[GoalLength]:
    """Measure all lengths."""
    limits = load_robot_model('c3_a601s').limits
    return [measure_one(points, limits, 3 if quick else 7) for points in LENGTHS]


def main() -> None:
    """Print a row for each length."""
    print('points   rclpy message     to arrays        checks   first point     memory')
    for row in measure(quick=True):
        times = (row.message, row.arrays, row.checks, row.first)
        print(
            f'{row.points:6}'
            + ''.join(f'   {value * 1e6:8.0f} us' for value in times)
            + f'   {row.memory / 1e3:8.1f} kB'
        )


if __name__ == '__main__':
    main()
