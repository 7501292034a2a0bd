# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Goals with a paused controller and with speed scaling, through ROS and processes."""

from collections.abc import Iterator
from contextlib import closing
from typing import Any

import numpy as np
import pytest
from support.cell import START, Cell
from support.ros_peer import RosPeer, trajectory

A = [0.8, 0.0, 0.3, 0.1, -0.6, 0.1]
POINTS = 21


@pytest.fixture(scope='module')
def waiting_cell(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cell]:
    """One enabled cell. Its arm may be anywhere."""
    with closing(Cell(tmp_path_factory.mktemp('cell'), '--motion=smooth')) as cell:
        cell.ready().peer.enable()
        yield cell


def plan(seconds: float) -> Any:
    """Return a trajectory from START to A with POINTS points."""
    shares = np.linspace(0.0, 1.0, POINTS)
    # at rest at both ends, without velocity jumps
    smooth = shares**2 * (3.0 - 2.0 * shares)
    places = np.array(START) + smooth[:, None] * (np.array(A) - START)
    return trajectory(*zip((shares * seconds).tolist(), places.tolist(), strict=True))


def at_start(cell: Cell) -> RosPeer:
    peer = cell.peer
    here = peer.position()
    if not np.allclose(here, START, atol=1e-3):
        ended, _, text = peer.goal(trajectory((0.0, here.tolist()), (1.0, START))).result()
        assert ended == 'succeeded', text
    return peer


def seconds(duration: Any) -> float:
    whole: float = duration.sec + duration.nanosec * 1e-9
    return whole


def test_goal_waits_for_a_paused_controller(waiting_cell: Cell) -> None:
    peer = at_start(waiting_cell)
    goal = peer.goal(plan(8.0))
    peer.wait_for_motion()
    waiting_cell.pendant('pause')
    peer.wait_for(
        lambda: (
            peer.robot_status[-1].motion_possible.val == 0
            and peer.robot_status[-1].in_motion.val == 0
        ),
        'a paused controller',
    )
    peer.wait_for(
        lambda: peer.controller_states[-1].speed_scaling_factor == 0.0, 'a clock at rest'
    )
    seen = len(peer.controller_states)
    peer.wait_for(lambda: len(peer.controller_states) >= seen + 20, 'more states')
    states = peer.controller_states[seen:]
    assert len({seconds(state.reference.time_from_start) for state in states}) == 1
    assert not goal.done
    waiting_cell.pendant('continue')
    ended, code, text = goal.result()
    assert (ended, code) == ('succeeded', 0), text
    assert np.abs(peer.assert_still() - A).max() < 1e-3
    log = waiting_cell.client.log_text()
    assert 'the controller is paused: the motion waits' in log
    assert 'the controller is no longer paused' in log


def test_speed_scaling_pauses_and_slows_a_running_goal(
    waiting_cell: Cell,
) -> None:
    peer = at_start(waiting_cell)
    peer.wait_for(lambda: peer.speed_scaling, 'the latched factor')
    assert peer.speed_scaling[-1] == 1.0
    goal = peer.goal(plan(8.0), goal_tolerance=[])
    peer.wait_for_motion()
    success, message = peer.set_speed(0.0)
    assert success
    assert message == 'pausing: the arm brakes, then the motion waits'
    peer.wait_for(lambda: peer.speed_scaling[-1] == 0.0, 'a factor of 0')
    peer.wait_for(
        lambda: (
            len({seconds(s.reference.time_from_start) for s in peer.controller_states[-20:]}) == 1
        ),
        'a plan at rest',
    )
    stopped = peer.wait_until_still()
    assert stopped[0] < 0.75
    assert not goal.done
    assert peer.set_speed(0.5)[0]
    peer.wait_for_motion()
    peer.wait_for(lambda: peer.speed_scaling[-1] == 0.5, 'a factor of one half')
    ended, code, text = goal.result()
    assert (ended, code) == ('succeeded', 0), text
    assert np.abs(peer.assert_still() - A).max() < 1e-3
    success, message = peer.set_speed(1.5)
    assert not success
    assert 'from 0.01 to 1' in message
    assert peer.set_speed(1.0)[0]
