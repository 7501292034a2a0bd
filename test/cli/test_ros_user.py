# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What the demo's ROS user records of a goal."""

import threading

import numpy as np
import pytest
import rclpy
from control_msgs.action import FollowJointTrajectory
from rclpy.action import ActionServer
from rclpy.executors import MultiThreadedExecutor
from rclpy.task import Future
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from epson_driver.cli import ros_user
from epson_driver.cli.processes import RunError, free_ros_domain, ros_environment
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


@pytest.fixture
def alone(monkeypatch):
    """Return a user of a driver that is not there."""
    for name, value in ros_environment(free_ros_domain()).items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(ros_user, 'READY_TIMEOUT_S', 0.05)
    found = RosUser(NAMES, lambda: None)
    yield found
    found.close()


def test_without_a_driver_each_request_says_what_is_missing(alone):
    with pytest.raises(RunError, match=r'no ~/enable service within 0\.05 s'):
        alone.enable()
    with pytest.raises(RunError, match=r'no ~/write_io service within 0\.05 s'):
        alone.write_output(3, 1)
    with pytest.raises(RunError, match='no joint states came while the goal ran'):
        alone.recording()
    with pytest.raises(RunError, match=r'no answer within 0\.1 s'):
        alone._complete(Future(), 0.1)


def test_what_the_driver_refuses_is_said_in_its_words(alone, monkeypatch):
    monkeypatch.setattr(alone, '_wait', lambda *_: None)
    refused = Trigger.Response(success=False, message='the E-stop is pressed')
    monkeypatch.setattr(alone, '_complete', lambda *_: refused)
    with pytest.raises(RunError, match=r'^~/enable: the E-stop is pressed$'):
        alone.enable()
    with pytest.raises(RunError, match=r'^~/write_io: the E-stop is pressed$'):
        alone.write_output(3, 1)
