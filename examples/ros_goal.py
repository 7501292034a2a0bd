# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Enable the arm and move it by FollowJointTrajectory. Needs a running client with remote_port."""

import rclpy
from control_msgs.action import FollowJointTrajectory
from rclpy.action import ActionClient
from rclpy.duration import Duration
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectoryPoint

rclpy.init()
node = Node('example')


def wait(future):
    rclpy.spin_until_future_complete(node, future)
    return future.result()


arrived = rclpy.Future()
node.create_subscription(JointState, 'joint_states', arrived.set_result, 1)
here = wait(arrived)
enable = node.create_client(Trigger, 'epson_driver/enable')
enable.wait_for_service()
print(wait(enable.call_async(Trigger.Request())).message)
goal = FollowJointTrajectory.Goal()
goal.trajectory.joint_names = here.name
for time, turn in ((1.0, 0.05), (2.0, 0.1), (4.0, 0.0)):
    positions = [here.position[0] + turn, *here.position[1:]]
    point = JointTrajectoryPoint(
        positions=positions, time_from_start=Duration(seconds=time).to_msg()
    )
    goal.trajectory.points.append(point)
action = ActionClient(node, FollowJointTrajectory, 'epson_driver/follow_joint_trajectory')
action.wait_for_server()
result = wait(wait(action.send_goal_async(goal)).get_result_async()).result
print(result.error_code, result.error_string)
