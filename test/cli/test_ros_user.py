# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What the demo's ROS user records of a goal."""

import threading

import numpy as np
import rclpy
from control_msgs.action import FollowJointTrajectory
from rclpy.action import ActionServer
from rclpy.executors import MultiThreadedExecutor
from sensor_msgs.msg import JointState

from epson_driver.cli.processes import free_ros_domain
from epson_driver.cli.ros_user import RosUser
from epson_driver.motion import Trajectory

NAMES = ('joint_1', 'joint_2')


class LateStates:
    """A driver whose joint states come later than the result of the goal, as DDS allows it."""

    def __init__(self, context):
        self.over = threading.Event()
        self.later = threading.Thread(target=self._later)
        self.node = rclpy.create_node('epson_driver', context=context)
        self.publisher = self.node.create_publisher(JointState, 'joint_states', 200)
        self.server = ActionServer(
            self.node, FollowJointTrajectory, 'epson_driver/follow_joint_trajectory', self._execute
        )

    def publish(self, position):
        state = JointState(name=NAMES, position=[position, 0.0], velocity=[0.0, 0.0])
        state.header.stamp = self.node.get_clock().now().to_msg()
        self.publisher.publish(state)

    def _execute(self, handle):
        self.publish(0.1)
        handle.succeed()
        self.later.start()
        return FollowJointTrajectory.Result()

    def _later(self):
        while not self.over.wait(0.01):
            self.publish(0.5)


def test_the_recording_shows_how_the_arm_stands_after_the_goal(monkeypatch):
    """A result may overtake joint states: the place was 'missed' by what had not come yet."""
    domain = free_ros_domain()
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    monkeypatch.setenv('ROS_DOMAIN_ID', str(domain))
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=domain)
    driver = LateStates(context)
    executor = MultiThreadedExecutor(context=context)
    executor.add_node(driver.node)
    thread = threading.Thread(target=executor.spin)
    thread.start()
    user = RosUser(NAMES, lambda: None)
    try:
        plan = Trajectory(NAMES, np.array([1.0]), np.array([[0.5, 0.0]]))
        _, succeeded = user.follow(plan, lambda _: None)
        assert succeeded
        assert user.recording().positions[-1].tolist() == [0.5, 0.0]
    finally:
        driver.over.set()
        if driver.later.ident is not None:
            driver.later.join()
        user.close()
        executor.shutdown()
        thread.join()
        driver.server.destroy()
        driver.node.destroy_node()
        context.try_shutdown()
