# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Goals smoothed by the driver, end to end."""

from collections.abc import Iterator
from contextlib import closing
from typing import Any

import numpy as np
import pytest
from support.cell import LASTS, START, Cell, cell_with
from support.ros_peer import trajectory

from epson_driver.motion.closest_samples import closest_sample_indices
from epson_driver.share import share_path
from epson_driver.trajectory_file import read_trajectory

FAR = [1.5, 0.0, 0.3, 0.1, -0.6, 0.1]


@pytest.fixture(scope='module')
def smooth_cell(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cell]:
    """One enabled cell with the SPEL+ program, whose arm is at START after every test."""
    with closing(cell_with(tmp_path_factory.mktemp('cell'), 'spel')) as cell:
        cell.ready().peer.enable()
        yield cell


def go_back(cell: Cell) -> None:
    here = cell.peer.assert_still().tolist()
    ended, _, text = cell.peer.goal(trajectory((0.0, here), (1.0, START))).result()
    assert ended == 'succeeded', text
    assert np.abs(cell.peer.assert_still() - START).max() < 1e-6


def test_smoothed_plan_is_executed_to_its_end(smooth_cell: Cell) -> None:
    peer = smooth_cell.peer
    plan = read_trajectory(share_path('config', 'trajectories', 'around_pillar_11_points.yaml'))
    assert peer.goal(trajectory((1.0, plan.positions[0].tolist()))).result()[0] == 'succeeded'
    points = zip(plan.times.tolist(), plan.positions.tolist(), strict=True)
    ended, _, text = peer.goal(trajectory(*points)).result()
    assert ended == 'succeeded', text
    assert np.abs(peer.assert_still() - plan.positions[-1]).max() < 1e-6
    go_back(smooth_cell)


@pytest.mark.invariant(4)
def test_inv4_estop_stops_a_smoothed_goal_and_enable_moves_nothing(smooth_cell: Cell) -> None:
    peer = smooth_cell.peer
    goal = peer.goal(trajectory((0.0, START), (LASTS, FAR)))
    peer.wait_for_motion()
    smooth_cell.pendant('estop', 'press')
    ended, _, text = goal.result()
    assert ended == 'aborted'
    assert 'E-stop' in text
    stopped = peer.wait_until_still()
    assert stopped[0] < 1.4
    smooth_cell.pendant('estop', 'release')
    assert peer.call('reset_error')[0]
    peer.wait_for(lambda: peer.robot_status[-1].e_stopped.val == 0, 'E-stop reset')
    peer.enable()
    assert np.array_equal(peer.assert_still(), stopped)
    go_back(smooth_cell)


POINTS = [
    START,
    [0.3, 0.2, 0.2, 0.1, -0.6, 0.1],
    [0.6, 0.2, 0.4, 0.2, -0.7, 0.2],
    [0.8, 0.0, 0.5, 0.2, -0.6, 0.3],
]


def test_plan_without_times_becomes_a_time_optimal_motion(make_cell: Any) -> None:
    cell = make_cell(smoothing='resample', resample_period=0.05, timing='time_optimal').ready()
    peer = cell.peer
    peer.enable()
    first = len(peer.joint_states)
    goal = peer.goal(trajectory(*((0.0, point) for point in POINTS)))
    ended, code, text = goal.result()
    assert (ended, code) == ('succeeded', 0), text
    assert np.abs(peer.assert_still() - POINTS[-1]).max() < 1e-6
    states = peer.joint_states[first:]
    path = np.array([state.position for state in states])
    nearest = closest_sample_indices(np.array(POINTS), path)
    # straight moves between points deviate by a · 0.05² / 8, with a up to 100 rad/s²
    assert np.abs(path[nearest] - POINTS).max() < 0.04
    desired = [state.reference.time_from_start for state in peer.controller_states]
    assert max(time.sec + time.nanosec * 1e-9 for time in desired) < 2.0
    # cancel during the move back
    goal = peer.goal(trajectory((0.0, POINTS[-1]), (0.0, POINTS[-2]), (0.0, START)))
    peer.wait_for_motion()
    goal.cancel()
    ended, code, text = goal.result()
    assert (ended, code) == ('canceled', 0), text
    position = peer.assert_still()
    ended, code, text = peer.goal(trajectory((0.0, [9.0] * 6))).result()
    assert (ended, code) == ('aborted', -1)
    assert 'joint_1: position 9 rad is outside the limits' in text
    assert np.array_equal(peer.assert_still(), position)
