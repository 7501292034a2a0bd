# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Print joint positions and status once a second, until Ctrl-C. Needs a running client."""

import contextlib

import rclpy
from industrial_msgs.msg import RobotStatus
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from sensor_msgs.msg import JointState


class Watch(Node):
    def __init__(self) -> None:
        super().__init__('watch')
        self.joints: JointState | None = None
        self.status: RobotStatus | None = None
        self.create_subscription(
            JointState, 'joint_states', lambda m: setattr(self, 'joints', m), 10
        )
        self.create_subscription(
            RobotStatus, 'robot_status', lambda m: setattr(self, 'status', m), 10
        )
        self.create_timer(1.0, self.show)

    def show(self) -> None:
        if self.joints and self.status:
            angles = ' '.join(f'{angle:7.3f}' for angle in self.joints.position)
            stopped, ready = self.status.e_stopped.val, self.status.motion_possible.val
            print(f'{angles}  E-stop {stopped}  motion possible {ready}', flush=True)


rclpy.init()
with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
    rclpy.spin(Watch())
