# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The node of the example programs, which moves joint 1."""

import time

import rclpy
from action_msgs.msg import GoalStatus
from builtin_interfaces.msg import Duration
from control_msgs.action import FollowJointTrajectory
from rclpy.action import ActionClient
from rclpy.executors import SingleThreadedExecutor
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

STEP_RAD = 0.6
DURATION_S = 4
PATIENCE_S = 60.0


class Mover:
    """Moves joint 1 by STEP_RAD from its first position."""

    def __init__(self):
        rclpy.init()
        self._node = rclpy.create_node('mover')
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._states = []
        self._node.create_subscription(JointState, 'joint_states', self._states.append, 10)
        self._action = ActionClient(
            self._node, FollowJointTrajectory, 'epson_driver/follow_joint_trajectory'
        )
        self.wait(lambda: self._states and self._action.server_is_ready(), 'no driver')
        self._target = list(self._states[-1].position)
        self._target[0] += STEP_RAD

    def wait(self, condition, otherwise, seconds=PATIENCE_S):
        until = time.monotonic() + seconds
        while not condition():
            if time.monotonic() > until:
                raise RuntimeError(otherwise)
            self._executor.spin_once(timeout_sec=0.1)

    def move(self):
        """Move to the target. Return '' on success, otherwise the reason."""
        here = self._states[-1]
        self._states.clear()
        points = [
            JointTrajectoryPoint(positions=list(here.position)),
            JointTrajectoryPoint(positions=self._target, time_from_start=Duration(sec=DURATION_S)),
        ]
        goal = FollowJointTrajectory.Goal(
            trajectory=JointTrajectory(joint_names=here.name, points=points)
        )
        accepted = self._action.send_goal_async(goal)
        self.wait(accepted.done, 'the driver did not answer')
        result = accepted.result().get_result_async()
        self.wait(result.done, 'the goal did not end')
        answer = result.result()
        if answer.status == GoalStatus.STATUS_SUCCEEDED:
            return ''
        return answer.result.error_string

    def call(self, name):
        """Call a service of the driver. Return its success."""
        client = self._node.create_client(Trigger, f'epson_driver/{name}')
        answer = client.call_async(Trigger.Request())
        self.wait(answer.done, f'{name} was not answered')
        return answer.result().success

    def rest(self, seconds):
        """Wait for some time, while messages are received."""
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            self._executor.spin_once(timeout_sec=0.1)
