# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Ask MoveIt to plan and execute a motion. Needs moveit_planning_execution.launch.py."""

import rclpy
from moveit_msgs.action import MoveGroup
from moveit_msgs.msg import Constraints, JointConstraint
from rclpy.action import ActionClient
from rclpy.node import Node

JOINTS = [f'joint_{number}' for number in range(1, 7)]
TARGET = [0.3, 0.1, 0.2, 0.0, -0.5, 0.0]

rclpy.init()
node = Node('example')


def wait(future):
    rclpy.spin_until_future_complete(node, future)
    return future.result()


goal = MoveGroup.Goal()
goal.request.group_name = 'manipulator'
goal.request.max_velocity_scaling_factor = 0.1
goal.request.max_acceleration_scaling_factor = 0.1
goal.request.allowed_planning_time = 5.0
joints = [
    JointConstraint(
        joint_name=name, position=angle, tolerance_above=1e-4, tolerance_below=1e-4, weight=1.0
    )
    for name, angle in zip(JOINTS, TARGET, strict=True)
]
goal.request.goal_constraints = [Constraints(joint_constraints=joints)]
action = ActionClient(node, MoveGroup, 'move_action')
action.wait_for_server()
result = wait(wait(action.send_goal_async(goal)).get_result_async()).result
print('MoveIt error code', result.error_code.val)  # 1 is success
