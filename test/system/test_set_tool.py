# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`~/set_tool` of the real node: primitives move the TCP, tf has its frame, bad ones fail."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from epson_msgs.srv import SetTool
from geometry_msgs.msg import Point, Pose, Quaternion
from rclpy.qos import DurabilityPolicy, QoSProfile
from support.cell import LASTS, Cell
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
    one = Cell(
        tmp_path_factory.mktemp('cell'), '--motion=smooth', frame_id=FRAME, tool__pose=AT_START
    )
    try:
        one.ready()
        one.peer.enable()
        yield one
    finally:
        one.close()


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


def latest_frame(cell: Cell, wanted: Callable[[Any], bool]) -> Any:
    """Return what who comes late hears of `/tf_static`: the only transform of the last message."""
    heard: list[TFMessage] = []
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    subscription = cell.peer.in_executor(
        lambda: cell.peer.node.create_subscription(TFMessage, '/tf_static', heard.append, latched)
    )
    try:
        cell.peer.wait_for(lambda: heard and wanted(heard[-1]), 'the tool on /tf_static')
    finally:
        cell.peer.in_executor(lambda: cell.peer.node.destroy_subscription(subscription))
    (transform,) = heard[-1].transforms
    return transform


def check_frame(cell: Cell, name: str, values: list[float]) -> None:
    transform = latest_frame(cell, lambda heard: heard.transforms[0].child_frame_id == name)
    assert transform.header.frame_id == 'left_tool0'
    place, turn = transform.transform.translation, transform.transform.rotation
    found = [getattr(place, axis) for axis in 'xyz'] + [getattr(turn, axis) for axis in 'xyzw']
    assert found == pytest.approx(values)


def check_line(cell: Cell, arm: Kinematics) -> None:
    """Have a line driven, and look where the tool was by the joint states that came back."""
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
    places = [arm.forward(np.array(each.position))[:3, 3] for each in peer.joint_states[first:]]
    assert max(distance_from(place, line) for place in places) < ACCURACY_M


@pytest.mark.slow
def test_at_first_primitives_move_the_tool_of_the_parameters(cell: Cell) -> None:
    check_frame(cell, 'left_tool', AT_START)
    check_line(cell, arm_with(AT_START))


def test_primitives_move_the_tool_that_was_set_and_tf_has_it(cell: Cell) -> None:
    done, text = set_tool(cell, GRIPPER, name='gripper', payload=0.5)
    assert done, text
    assert 'left_gripper' in text
    assert 'payload 0.5 kg: a note, which the controller is not told' in text
    check_frame(cell, 'left_gripper', GRIPPER)
    check_line(cell, arm_with(GRIPPER))


@pytest.mark.slow
def test_a_tool_is_refused_while_a_sequence_runs_and_the_sequence_goes_on(cell: Cell) -> None:
    assert set_tool(cell, AT_START)[0]
    ended, _, text = Sequence(cell.peer, [joint_move(READY)]).result()
    assert ended == 'succeeded', text
    sequence = Sequence(cell.peer, [joint_move(FAR, velocity=2.5 / LASTS)])
    sequence.wait_for_motion()
    done, text = set_tool(cell, GRIPPER)
    assert not done
    assert 'a sequence of motion primitives is planned, or runs' in text
    check_frame(cell, 'left_tool', AT_START)
    sequence.cancel()
    ended, _, text = sequence.result()
    assert ended == 'canceled', text
    assert set_tool(cell, GRIPPER)[0]
    check_frame(cell, 'left_tool', GRIPPER)


@pytest.mark.slow
def test_a_bad_tool_is_refused_and_the_one_before_stays(cell: Cell) -> None:
    assert set_tool(cell, AT_START, name='good')[0]
    for values, fields, told in (
        ([float('nan'), *AT_START[1:]], {}, 'pose'),
        ([*AT_START[:3], 0.0, 0.0, 0.0, 0.0], {}, 'has length 0: must be 1'),
        ([0.0, 0.0, 120.0, *AT_START[3:]], {}, 'at most 10 m'),
        (AT_START, {'name': 'link_3'}, "name = 'link_3'"),
        (AT_START, {'payload': -1.0}, 'payload = -1.0'),
    ):
        done, text = set_tool(cell, values, **fields)
        assert not done
        assert told in text
    check_frame(cell, 'left_good', AT_START)
    assert cell.peer.diagnostics, 'the node is alive'
    assert cell.peer.call('enable')[0]
