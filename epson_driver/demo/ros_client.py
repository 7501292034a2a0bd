# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A ROS node that uses the driver like an application: enable, send a goal, record states."""

import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import rclpy
from action_msgs.msg import GoalStatus
from control_msgs.action import FollowJointTrajectory
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.action import ActionClient
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.signals import SignalHandlerOptions
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import Trigger

from epson_driver.motion import Trajectory
from epson_driver.node.ros_process import udp_by_default
from epson_driver.node.trajectory_messages import trajectory_message
from epson_driver.processes.processes import RunError
from epson_driver.report.measure import Recording

READY_TIMEOUT_S = 30.0  # timeout of every wait except for the motion itself, s


class RosClient:
    """A ROS node that uses the driver.

    `check` is called during waits. It may raise an exception to end the wait.
    """

    def __init__(self, joint_names: tuple[str, ...], check: Callable[[], None]) -> None:
        with udp_by_default():
            rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
            self._node = rclpy.create_node('demo')
        self._joint_names = joint_names
        self._check = check
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._states: list[Any] = []
        self._diagnostics: Any = None
        self._link_state = ''
        self._recording = False
        self._enable = self._node.create_client(Trigger, 'epson_driver/enable')
        self._action = ActionClient(
            self._node, FollowJointTrajectory, 'epson_driver/follow_joint_trajectory'
        )
        self._node.create_subscription(JointState, 'joint_states', self._on_state, 200)
        self._node.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, 10)
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._node.create_subscription(
            String, 'epson_driver/link_state', self._on_link_state, latched
        )

    def close(self) -> None:
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.shutdown()

    def enable(self) -> None:
        self._recording = True
        self._wait(self._enable.service_is_ready, 'no ~/enable service')
        self._wait(lambda: self._link_state == 'connected', 'no links to the controller')
        self._wait(lambda: self._states, 'no joint_states')
        self._wait(self._action.server_is_ready, 'no action server')
        answer = self._complete(self._enable.call_async(Trigger.Request()))
        if not answer.success:
            raise RunError(f'~/enable: {answer.message}')
        self._states.clear()

    def execute(self, trajectory: Trajectory, console: Console) -> tuple[str, bool]:
        total = len(trajectory.times)
        columns = (
            TextColumn('{task.description}'),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
        )
        with Progress(*columns, console=console) as progress:
            bar = progress.add_task('waypoints', total=total)
            text, succeeded = self.follow(
                trajectory, lambda reached: progress.update(bar, completed=reached)
            )
            if succeeded:
                progress.update(bar, completed=total)
        return text, succeeded

    def follow(
        self, trajectory: Trajectory, on_progress: Callable[[int], object]
    ) -> tuple[str, bool]:
        """Send the goal and return the result's text and whether it succeeded.

        The recording ends with the first joint state measured after the result, because the result
        may arrive before earlier joint states.
        """
        goal = FollowJointTrajectory.Goal(trajectory=trajectory_message(trajectory))
        self._wait(self._action.server_is_ready, 'no action server')
        self._states.clear()
        self._recording = True

        def on_feedback(message: Any) -> None:
            passed = message.feedback.desired.time_from_start
            seconds = passed.sec + passed.nanosec * 1e-9
            on_progress(int(np.searchsorted(trajectory.times, seconds - 1e-6)))

        handle = self._complete(self._action.send_goal_async(goal, on_feedback))
        answer = self._complete(handle.get_result_async(), timeout=math.inf)
        succeeded: bool = answer.status == GoalStatus.STATUS_SUCCEEDED
        if succeeded:
            ended = self._node.get_clock().now().nanoseconds * 1e-9
            self._wait(
                lambda: self._states and _stamp(self._states[-1]) >= ended,
                'no joint_states after the goal',
            )
        self._recording = False
        return answer.result.error_string, succeeded

    def reply_latencies(self) -> dict[str, str]:
        self._diagnostics = None
        self._wait(lambda: self._diagnostics, 'no diagnostics')
        link = next(s for s in self._diagnostics.status if s.name.endswith('motion link'))
        return {value.key: value.value for value in link.values}

    def recording(self) -> Recording:
        """Return the joint states received during the last goal.

        The joints are in the order of `joint_names`.
        """
        if not self._states:
            raise RunError('no joint states received during the goal')
        return Recording(
            np.array([_stamp(state) for state in self._states]),
            np.array([s.position for s in self._states]),
            np.array([s.velocity for s in self._states]),
        )

    def _on_state(self, message: Any) -> None:
        if self._recording and tuple(message.name) == self._joint_names:  # not another arm's
            self._states.append(message)

    def _on_link_state(self, message: Any) -> None:
        self._link_state = message.data

    def _on_diagnostics(self, message: Any) -> None:
        self._diagnostics = message

    def _wait(
        self, ready: Callable[[], Any], otherwise: str, timeout: float | None = None
    ) -> None:
        timeout = READY_TIMEOUT_S if timeout is None else timeout
        until = time.monotonic() + timeout
        while not ready():
            if time.monotonic() > until:
                raise RunError(f'{otherwise} within {timeout:g} s')
            self._check()
            self._executor.spin_once(timeout_sec=0.05)

    def _complete(self, future: Any, timeout: float | None = None) -> Any:
        self._wait(future.done, 'no answer', timeout)
        return future.result()


def _stamp(message: Any) -> float:
    stamp = message.header.stamp
    seconds: float = stamp.sec + stamp.nanosec * 1e-9
    return seconds
