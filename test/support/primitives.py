# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Sequences of motion primitives, sent like by a ROS client."""

from typing import Any

import numpy as np
from control_msgs.action import ExecuteMotionPrimitiveSequence
from control_msgs.msg import MotionArgument, MotionPrimitive, MotionPrimitiveSequence
from geometry_msgs.msg import PoseStamped
from rclpy.action import ActionClient

from epson_driver.robots import load_robot_model
from epson_driver.robots.kinematics import Kinematics
from support.ros_peer import PATIENCE, STATUS_NAMES

ARM = Kinematics(load_robot_model('c3_a601s'))
READY = [0.0, 0.2, 0.2, 0.0, -1.9, 0.0]


class Sequence:
    """A sequence that was sent, with its feedback and its result."""

    def __init__(self, peer: Any, motions: list[MotionPrimitive]) -> None:
        self.indices: list[int] = []
        self._peer = peer
        if not hasattr(peer, 'primitives'):
            peer.primitives = ActionClient(
                peer.node,
                ExecuteMotionPrimitiveSequence,
                'epson_driver/execute_motion_primitive_sequence',
            )
            assert peer.primitives.wait_for_server(PATIENCE)
        goal = ExecuteMotionPrimitiveSequence.Goal(
            trajectory=MotionPrimitiveSequence(motions=motions)
        )
        future = peer.in_executor(
            lambda: peer.primitives.send_goal_async(
                goal, lambda message: self.indices.append(message.feedback.current_primitive_index)
            )
        )
        self.handle = peer.complete(future)
        assert self.handle.accepted
        self._result = peer.in_executor(self.handle.get_result_async)

    def cancel(self) -> None:
        self._peer.complete(self._peer.in_executor(self.handle.cancel_goal_async))

    def wait_for_motion(self) -> None:
        """Wait until the joints move, and fail with the result if the sequence has ended."""
        peer = self._peer
        start = peer.position()
        peer.wait_for(
            lambda: (
                self._result.done()
                or np.abs(np.array(peer.joint_states[-1].position) - start).max() > 0.01
            ),
            'motion',
        )
        assert not self._result.done(), self.result()

    def result(self) -> tuple[str, int, str]:
        answer = self._peer.complete(self._result)
        return (
            STATUS_NAMES[answer.status],
            answer.result.error_code,
            answer.result.error_string,
        )


def joint_move(positions: list[float], **arguments: float) -> MotionPrimitive:
    return MotionPrimitive(
        type=MotionPrimitive.LINEAR_JOINT,
        joint_positions=positions,
        additional_arguments=[
            MotionArgument(argument_name=name, argument_value=value)
            for name, value in arguments.items()
        ],
    )


def tool_move(
    *offsets: tuple[float, float, float],
    arm: Kinematics = ARM,
    frame: str = 'base_link',
    **arguments: float,
) -> MotionPrimitive:
    """Return a line, or an arc for two offsets, to positions relative to the tool at READY."""
    pose = arm.forward(np.array(READY))
    message = joint_move([], **arguments)
    message.type = (
        MotionPrimitive.CIRCULAR_CARTESIAN
        if len(offsets) > 1
        else MotionPrimitive.LINEAR_CARTESIAN
    )
    for offset in offsets:
        stamped = PoseStamped()
        stamped.header.frame_id = frame
        position, orientation = stamped.pose.position, stamped.pose.orientation
        position.x, position.y, position.z = (pose[:3, 3] + offset).tolist()
        w = np.sqrt(max(1.0 + np.trace(pose[:3, :3]), 1e-12)) / 2.0
        if w > 1e-3:
            orientation.x = (pose[2, 1] - pose[1, 2]) / (4.0 * w)
            orientation.y = (pose[0, 2] - pose[2, 0]) / (4.0 * w)
            orientation.z = (pose[1, 0] - pose[0, 1]) / (4.0 * w)
            orientation.w = float(w)
        else:  # half a turn
            axis = np.sqrt(np.maximum((np.diag(pose[:3, :3]) + 1.0) / 2.0, 0.0))
            first = int(np.argmax(axis))
            axis *= np.sign(pose[first, :3] + (np.arange(3) == first))
            orientation.x, orientation.y, orientation.z = axis.tolist()
            orientation.w = 0.0
        message.poses.append(stamped)
    return message
