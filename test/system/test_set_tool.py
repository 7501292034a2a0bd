# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`~/set_tool` of the real node: primitives move the TCP, and tf has its frame."""

from collections.abc import Callable, Iterator
from contextlib import closing
from typing import Any

import numpy as np
import pytest
from epson_msgs.srv import SetTool
from geometry_msgs.msg import Point, Pose, Quaternion
from rclpy.qos import DurabilityPolicy, QoSProfile
from support.cell import Cell
from support.primitives import READY, Sequence, joint_move, tool_move
from tf2_msgs.msg import TFMessage

from epson_driver.robots import load_robot_model
from epson_driver.robots.kinematics import Kinematics
from epson_driver.tool_motion.pose_path import distance_from
from epson_driver.tool_motion.tool_pose import pose_of_quaternion

MODEL = load_robot_model('c3_a601s')
AT_START = [0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 1.0]
GRIPPER = [0.03, -0.02, 0.12, 0.0, 0.0, 0.6, 0.8]
FRAME = 'left_base_link'
FAR = [2.5, *READY[1:]]
ACCURACY_M = 3e-4


@pytest.fixture(scope='module')
def cell(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cell]:
    """One enabled cell whose links have a prefix, with a tool from the start."""
    with closing(
        Cell(
            tmp_path_factory.mktemp('cell'), '--motion=smooth', frame_id=FRAME, tool__pose=AT_START
        )
    ) as one:
        one.ready()
        one.peer.enable()
        yield one


def arm_with(values: list[float]) -> Kinematics:
    return Kinematics(MODEL, pose_of_quaternion('pose', np.array(values)))


def set_tool(cell: Cell, values: list[float], **fields: Any) -> tuple[bool, str]:
    pose = Pose(
        position=Point(**dict(zip('xyz', values[:3], strict=True))),
        orientation=Quaternion(**dict(zip('xyzw', values[3:], strict=True))),
    )
    with cell.peer.client(SetTool, 'epson_driver/set_tool') as client:
        request = SetTool.Request(pose=pose, **fields)
        answer = cell.peer.complete(cell.peer.in_executor(lambda: client.call_async(request)))
    return answer.success, answer.message


def latest_frame(cell: Cell, condition: Callable[[Any], bool]) -> Any:
    """Return the only transform that a late subscriber of `/tf_static` receives last."""
    received: list[TFMessage] = []
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    subscription = cell.peer.in_executor(
        lambda: cell.peer.node.create_subscription(
            TFMessage, '/tf_static', received.append, latched
        )
    )
    try:
        cell.peer.wait_for(lambda: received and condition(received[-1]), 'the tool on /tf_static')
    finally:
        cell.peer.in_executor(lambda: cell.peer.node.destroy_subscription(subscription))
    (transform,) = received[-1].transforms
    return transform


def check_frame(cell: Cell, name: str, values: list[float]) -> None:
    transform = latest_frame(cell, lambda received: received.transforms[0].child_frame_id == name)
    assert transform.header.frame_id == 'left_tool0'
    place, turn = transform.transform.translation, transform.transform.rotation
    values_of_frame = [getattr(place, axis) for axis in 'xyz'] + [
        getattr(turn, axis) for axis in 'xyzw'
    ]
    assert values_of_frame == pytest.approx(values)


def check_line(cell: Cell, arm: Kinematics) -> None:
    """Move on a line, and check the tool's path by the joint states."""
    peer = cell.peer
    offset = (0.0, 0.06, 0.02)
    ended, _, text = Sequence(peer, [joint_move(READY)]).result()
    assert ended == 'succeeded', text
    peer.assert_still()
    first = len(peer.joint_states)
    move = tool_move(offset, arm=arm, frame=FRAME, velocity=0.1)
    ended, _, text = Sequence(peer, [move]).result()
    assert ended == 'succeeded', text
    home = arm.forward(np.array(READY))
    pose = arm.forward(peer.assert_still())
    np.testing.assert_allclose(pose[:3, 3], home[:3, 3] + offset, atol=1e-3)
    np.testing.assert_allclose(pose[:3, :3], home[:3, :3], atol=5e-3)
    line = np.array([home[:3, 3], home[:3, 3] + offset])
    places = [arm.forward(np.array(state.position))[:3, 3] for state in peer.joint_states[first:]]
    assert max(distance_from(place, line) for place in places) < ACCURACY_M


def test_primitives_move_the_tool_of_the_parameters_at_first(cell: Cell) -> None:
    check_frame(cell, 'left_tool', AT_START)
    check_line(cell, arm_with(AT_START))


def test_set_tool_moves_the_primitives_tcp_and_the_tf_frame(cell: Cell) -> None:
    done, text = set_tool(cell, GRIPPER, name='gripper', payload=0.5)
    assert done, text
    assert 'left_gripper' in text
    assert 'payload 0.5 kg: only noted, not sent to the controller' in text
    check_frame(cell, 'left_gripper', GRIPPER)
    check_line(cell, arm_with(GRIPPER))
