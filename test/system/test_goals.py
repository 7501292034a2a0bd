# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Goals through ROS: results, cancel, replacement and stop."""

import socket
import struct
from collections.abc import Iterator
from contextlib import closing
from typing import Any

import numpy as np
import pytest
from support.cell import LASTS, PROGRAMS, START, Cell, cell_with
from support.ros_peer import JOINTS, trajectory

A = [0.2, 0.0, 0.3, 0.1, -0.6, 0.1]
FAR = [1.5, 0.0, 0.3, 0.1, -0.6, 0.1]


@pytest.fixture(scope='module', params=PROGRAMS)
def shared_cell(request: Any, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cell]:
    """One enabled cell for all tests."""
    with closing(cell_with(tmp_path_factory.mktemp('cell'), request.param)) as cell:
        cell.ready().peer.enable()
        yield cell


def there_and_back() -> Any:
    return trajectory((0.0, START), (0.3, A), (0.6, START))


@pytest.mark.quick
@pytest.mark.invariant(5)
def test_goal_is_executed_and_reported(shared_cell: Cell) -> None:
    peer = shared_cell.peer
    first = len(peer.joint_states)
    peer.controller_states.clear()
    goal = peer.goal(there_and_back())
    ended, code, text = goal.result()
    assert (ended, code) == ('succeeded', 0), text
    assert 'at the goal' in text
    # the arm passed A: a cyclic path must not succeed early (invariant 5)
    nearest = min(
        np.abs(np.array(state.position) - A).max() for state in peer.joint_states[first:]
    )
    assert nearest < 0.02
    assert np.abs(peer.assert_still() - START).max() < 1e-6
    assert goal.feedback
    for message in goal.feedback:
        assert list(message.joint_names) == JOINTS
        np.testing.assert_allclose(
            np.array(message.desired.positions) - message.actual.positions,
            message.error.positions,
        )
    assert peer.controller_states[0].joint_names == JOINTS


@pytest.mark.quick
@pytest.mark.invariant(8)
def test_inv8_measured_values_are_published_unchanged(shared_cell: Cell) -> None:
    if shared_cell.spel:
        pytest.skip('its only state client is the driver; test_state_server.py compares bits')
    state = shared_cell.peer.joint_states[-1]
    assert list(state.name) == JOINTS
    with socket.create_connection(('127.0.0.1', shared_cell.ports.state), 10) as measured:
        data = measured.recv(60, socket.MSG_WAITALL)
    assert struct.unpack_from('<4i', data) == (56, 10, 1, 0)
    assert list(state.position) == list(struct.unpack_from('<6f', data, 20))
    assert np.allclose(state.position, START, atol=1e-6)  # to a pulse of the encoders
    assert list(state.velocity) == [0.0] * 6
    assert state.header.stamp.sec > 0


@pytest.mark.quick
def test_trajectory_topic_moves_and_an_empty_trajectory_stops(shared_cell: Cell) -> None:
    peer = shared_cell.peer
    peer.trajectory_topic.publish(trajectory((0.0, START), (0.3, A)))
    peer.wait_for(
        lambda: np.abs(np.array(peer.joint_states[-1].position) - A).max() < 1e-6, 'arm at A'
    )
    peer.trajectory_topic.publish(trajectory((0.0, A), (LASTS, FAR)))
    peer.wait_for_motion()
    peer.trajectory_topic.publish(trajectory())
    position = peer.wait_until_still()
    assert 0.2 < position[0] < 1.4
    back = trajectory((0.0, position.tolist()), (0.5, START))
    assert peer.goal(back).result()[0] == 'succeeded'


@pytest.mark.quick
def test_cancel_brings_the_arm_to_rest_first(shared_cell: Cell) -> None:
    peer = shared_cell.peer
    goal = peer.goal(trajectory((0.0, START), (LASTS, FAR)))
    peer.wait_for_motion()
    goal.cancel()
    ended, code, text = goal.result()
    assert (ended, code) == ('canceled', 0), text
    position = peer.assert_still()
    assert position[0] < 1.4
    assert peer.goal(trajectory((0.0, position.tolist()), (0.5, START))).result()[0] == 'succeeded'


@pytest.mark.quick
def test_replacement_stops_the_old_goal_and_runs_the_new_one(shared_cell: Cell) -> None:
    peer = shared_cell.peer
    old = peer.goal(trajectory((0.0, START), (LASTS, FAR)))
    peer.wait_for_motion()
    new = peer.goal(trajectory((2.0, START)))
    ended, code, text = old.result()
    assert (ended, code) == ('aborted', -1)
    assert 'replaced by a new goal' in text
    assert 'at rest' in text
    assert new.result()[0] == 'succeeded'
    assert np.abs(peer.assert_still() - START).max() < 1e-6


@pytest.mark.quick
def test_stop_service_ends_the_goal_at_rest(shared_cell: Cell) -> None:
    peer = shared_cell.peer
    goal = peer.goal(trajectory((0.0, START), (LASTS, FAR)))
    peer.wait_for_motion()
    success, message = peer.call('stop')
    assert success
    assert 'stopped on request' in message
    assert goal.result()[:2] == ('aborted', -1)
    position = peer.assert_still()
    assert peer.goal(trajectory((0.0, position.tolist()), (0.5, START))).result()[0] == 'succeeded'
    assert peer.call('stop')[0]  # acknowledged without a running goal, too
