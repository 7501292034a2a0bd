# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`~/taught_points` of the real node: list, teach, go, forget, file, and tf."""

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from epson_msgs.srv import SetTool, TaughtPoints
from rclpy.qos import DurabilityPolicy, QoSProfile
from support.cell import Cell
from support.primitives import READY, Sequence, joint_move
from tf2_msgs.msg import TFMessage

from epson_driver.inputs.rc_files import header_fault, parsed
from epson_driver.robots import load_robot_model
from epson_driver.robots.kinematics import Kinematics

ARM = Kinematics(load_robot_model('c3_a601s'))
FAR = [2.5, *READY[1:]]
LIST, TEACH, GO, FORGET = range(4)


@pytest.fixture(scope='module')
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp('points') / 'robot1.pts'


@pytest.fixture(scope='module')
def cell(tmp_path_factory: pytest.TempPathFactory, file: Path) -> Iterator[Cell]:
    """One enabled cell with a points file that does not exist yet."""
    with closing(
        Cell(
            tmp_path_factory.mktemp('cell'),
            '--motion=smooth',
            frame_id='left_base_link',
            points_file=str(file),
        )
    ) as one:
        one.ready()
        one.peer.enable()
        yield one


def call_in_steps(cell: Cell, action: int, name: str = '', speed: float = 0.0) -> Iterator[Any]:
    """Send a request, and yield first None and then the reply."""
    request = TaughtPoints.Request(action=action, name=name, speed=speed)
    with cell.peer.client(TaughtPoints, 'epson_driver/taught_points') as client:
        future = cell.peer.in_executor(lambda: client.call_async(request))
        yield
        yield cell.peer.complete(future)


def ask(cell: Cell, action: int, name: str = '', speed: float = 0.0) -> Any:
    _, answer = call_in_steps(cell, action, name, speed)
    return answer


def move_to(cell: Cell, joints: list[float]) -> None:
    ended, _, text = Sequence(cell.peer, [joint_move(joints)]).result()
    assert ended == 'succeeded', text


def frames(cell: Cell, wanted: str) -> dict[str, Any]:
    """Return the frames that a late subscriber of `/tf_static` receives."""
    received: list[TFMessage] = []
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    subscription = cell.peer.in_executor(
        lambda: cell.peer.node.create_subscription(
            TFMessage, '/tf_static', received.append, latched
        )
    )
    try:
        cell.peer.wait_for(
            lambda: any(wanted in str(message) for message in received), f'{wanted} on /tf_static'
        )
    finally:
        cell.peer.in_executor(lambda: cell.peer.node.destroy_subscription(subscription))
    return {frame.child_frame_id: frame for message in received for frame in message.transforms}


def test_point_is_taught_saved_published_and_reached(cell: Cell, file: Path) -> None:
    assert ask(cell, LIST).message == f'0 points of {file}'
    move_to(cell, READY)
    taught = ask(cell, TEACH, 'pick')
    assert taught.success, taught.message
    pose = ARM.forward(np.array(READY))
    place = taught.poses[taught.names.index('pick')].position
    assert [place.x, place.y, place.z] == pytest.approx(pose[:3, 3], abs=1e-4)
    frame = frames(cell, 'left_pick')['left_pick']
    assert frame.header.frame_id == 'left_base_link'
    away = frame.transform.translation
    assert [away.x, away.y, away.z] == pytest.approx(pose[:3, 3], abs=1e-4)
    assert header_fault(file.read_bytes()) in (None, '')
    (block,) = parsed(file.name, file.read_text()).blocks('Point')
    assert block.text('sLabel') == 'pick'
    move_to(cell, [0.3, *READY[1:]])
    gone = ask(cell, GO, 'PICK', speed=0.5)
    assert gone.success, gone.message
    assert gone.message.startswith('point PICK: at the goal')
    assert cell.peer.assert_still() == pytest.approx(np.array(READY), abs=1e-3)


@pytest.mark.invariant(3, 4)
def test_stop_ends_the_move_to_a_point(cell: Cell) -> None:
    move_to(cell, READY)
    assert ask(cell, TEACH, 'home').success
    move_to(cell, FAR)
    move = call_in_steps(cell, GO, 'home', speed=0.01)
    next(move)
    cell.peer.wait_for_motion()
    busy = ask(cell, GO, 'home')
    assert not busy.success
    assert 'another motion runs or waits' in busy.message
    assert cell.peer.call('stop')[0]
    answer = next(move)
    assert not answer.success
    assert 'stop' in answer.message
    still = cell.peer.assert_still()
    assert still[0] > 0.1


@pytest.mark.parametrize(
    ('action', 'name', 'speed', 'expected'),
    [
        (GO, 'nowhere', 0.0, 'no point named nowhere: the points are'),
        (FORGET, 'nowhere', 0.0, 'no point named nowhere: the points are'),
        (GO, 'pick', 1.5, 'speed = 1.5: must be'),
        (GO, 'pick', float('nan'), 'speed = nan: must be'),
        (TEACH, '', 0.0, 'must be a word'),
        (TEACH, 'two words', 0.0, 'must be a word'),
        (TEACH, 'tool0', 0.0, 'must not be the name of a frame'),
        (9, 'pick', 0.0, 'action = 9: must be LIST (0)'),
    ],
)
def test_invalid_request_is_rejected_and_nothing_moves(
    cell: Cell, action: int, name: str, speed: float, expected: str
) -> None:
    before = cell.peer.assert_still()
    answer = ask(cell, action, name, speed)
    assert not answer.success
    assert expected in answer.message
    assert cell.peer.assert_still() == pytest.approx(before, abs=1e-4)


def test_tool_and_point_frames_must_not_share_a_name(cell: Cell) -> None:
    assert ask(cell, TEACH, 'shelf').success
    with cell.peer.client(SetTool, 'epson_driver/set_tool') as client:

        def set_tool(name: str) -> Any:
            request = SetTool.Request(name=name)
            return cell.peer.complete(cell.peer.in_executor(lambda: client.call_async(request)))

        answer = set_tool('shelf')
        assert not answer.success
        assert 'must not be the name of a taught point' in answer.message
        assert set_tool('gripper').success
    answer = ask(cell, TEACH, 'gripper')
    assert not answer.success
    assert 'must not be the name of a frame of the arm, its base or its tool' in answer.message
    assert ask(cell, FORGET, 'shelf').success


def test_forgotten_point_is_removed_and_the_rest_survive_a_restart(cell: Cell, file: Path) -> None:
    assert ask(cell, TEACH, 'extra').success
    gone = ask(cell, FORGET, 'extra')
    assert gone.success
    assert 'extra' not in gone.names
    names = ask(cell, LIST).names
    assert 'extra' not in file.read_text()
    assert cell.peer.call('disable')[0]
    refused = ask(cell, GO, names[0])
    assert not refused.success
    assert '~/enable' in refused.message
    cell.client.end()
    cell.restart_client()
    assert ask(cell, LIST).names == names
    assert f'left_{names[0]}' in frames(cell, f'left_{names[0]}')
