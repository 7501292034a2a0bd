# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The node with the profile `remote`, without a program in the controller."""

from typing import Any

import numpy as np
import pytest
from support.cell import START
from support.primitives import READY, Sequence, joint_move, tool_move
from support.ros_peer import trajectory

REMOTE = '--controller=remote'


@pytest.fixture
def cell(make_cell: Any) -> Any:
    cell = make_cell(REMOTE, controller='remote').ready()
    cell.peer.enable()
    return cell


@pytest.mark.invariant(6)
def test_remote_profile_moves_stops_and_rejects_plans(cell: Any) -> None:
    peer = cell.peer
    there = [0.4, *START[1:]]
    ended, _, text = peer.goal(trajectory((0.0, START), (1.0, there))).result()
    assert ended == 'succeeded', text
    np.testing.assert_allclose(peer.position(), there, atol=1e-4)

    plan = trajectory((0.0, there), (1.0, [0.3, *START[1:]]), (2.0, START))
    ended, code, text = peer.goal(plan).result()
    assert (ended, code) == ('aborted', -1)
    assert 'a plan of 3 points: over Remote Ethernet alone' in text
    np.testing.assert_allclose(peer.assert_still(5), there, atol=1e-4)
    success, text = peer.set_speed(0.5)
    assert not success
    assert 'cannot change the speed during a motion' in text

    motions = [
        joint_move(READY),
        tool_move((0.0, 0.0, 0.04)),
        tool_move((0.0, 0.04, 0.04), (0.02, 0.02, 0.04)),
        joint_move(START, velocity=1.0),
    ]
    status, code, text = Sequence(peer, motions).result()
    assert (status, code) == ('succeeded', 0), text
    np.testing.assert_allclose(peer.position(), START, atol=1e-4)

    goal = peer.goal(trajectory((60.0, [1.5, *START[1:]])))
    peer.wait_for(lambda: peer.robot_status[-1].in_motion.val == 1, 'motion')
    states, statuses = len(peer.joint_states), len(peer.robot_status)
    peer.wait_for(lambda: len(peer.robot_status) > statuses + 5, 'status in motion')
    assert len(peer.joint_states) == states
    success, text = peer.call('stop')
    assert success, text
    assert goal.result()[0] == 'aborted'
    stopped = peer.assert_still(5)
    assert START[0] - 0.01 < stopped[0] < 1.4


@pytest.mark.invariant(4)
def test_estop_ends_the_motion_and_enable_alone_moves_nothing(cell: Any) -> None:
    peer = cell.peer
    goal = peer.goal(trajectory((60.0, [1.5, *START[1:]])))
    peer.wait_for(lambda: peer.robot_status[-1].in_motion.val == 1, 'motion')
    cell.pendant('estop', 'press')
    ended, _, text = goal.result()
    assert ended == 'aborted'
    assert 'E-stop' in text or 'error' in text
    cell.pendant('estop', 'release')
    success, text = peer.call('reset_error')
    assert success, text
    before = peer.wait_until_still()
    peer.enable()
    np.testing.assert_allclose(peer.assert_still(5), before, atol=1e-6)
    ended, _, text = peer.goal(trajectory((5.0, START))).result()
    assert ended == 'succeeded', text
