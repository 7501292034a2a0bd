# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Goals through real ROS 2 to a controller that moves smoothly, and what ends them."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from support.cell import LASTS, PROGRAMS, START, Cell, cell_with
from support.ros_peer import trajectory

from epson_driver.cli.trajectory_file import read_trajectory
from epson_driver.share import share_file

FAR = [1.5, 0.0, 0.3, 0.1, -0.6, 0.1]


@pytest.fixture(scope='module', params=PROGRAMS)
def smooth_cell(request: Any, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cell]:
    """One enabled cell whose arm stands at START after every test."""
    how = () if request.param == 'spel' else ('--motion=smooth',)
    cell = cell_with(tmp_path_factory.mktemp('cell'), request.param, *how).ready()
    cell.peer.enable()
    yield cell
    cell.close()


def go_back(cell: Cell) -> None:
    here = cell.peer.assert_still().tolist()
    ended, _, text = cell.peer.goal(trajectory((0.0, here), (1.0, START))).result()
    assert ended == 'succeeded', text
    assert np.abs(cell.peer.assert_still() - START).max() < 1e-6


def test_a_plan_is_executed_to_its_end(smooth_cell: Cell) -> None:
    peer = smooth_cell.peer
    plan = read_trajectory(share_file('config', 'trajectories', 'around_pillar_11_points.yaml'))
    assert peer.goal(trajectory((1.0, plan.positions[0].tolist()))).result()[0] == 'succeeded'
    points = zip(plan.times.tolist(), plan.positions.tolist(), strict=True)
    ended, _, text = peer.goal(trajectory(*points)).result()
    assert ended == 'succeeded', text
    assert np.abs(peer.assert_still() - plan.positions[-1]).max() < 1e-6
    go_back(smooth_cell)


def test_cancel_brings_the_arm_to_rest_first(smooth_cell: Cell) -> None:
    peer = smooth_cell.peer
    goal = peer.goal(trajectory((0.0, START), (LASTS, FAR)))
    peer.wait_for_motion()
    goal.cancel()
    ended, code, text = goal.result()
    assert (ended, code) == ('canceled', 0), text
    assert peer.assert_still()[0] < 1.4
    go_back(smooth_cell)


def test_replacement_stops_the_old_goal_and_runs_the_new_one(smooth_cell: Cell) -> None:
    peer = smooth_cell.peer
    old = peer.goal(trajectory((0.0, START), (LASTS, FAR)))
    peer.wait_for_motion()
    new = peer.goal(trajectory((2.0, START)))
    assert old.result()[0] == 'aborted'
    assert new.result()[0] == 'succeeded'
    assert np.abs(peer.assert_still() - START).max() < 1e-6


@pytest.mark.invariant(4)
def test_invariant_4_estop_in_mid_motion(smooth_cell: Cell) -> None:
    peer = smooth_cell.peer
    goal = peer.goal(trajectory((0.0, START), (LASTS, FAR)))
    peer.wait_for_motion()
    smooth_cell.pendant('estop', 'press')
    ended, _, text = goal.result()
    assert ended == 'aborted'
    assert 'E-stop' in text
    stands = peer.wait_until_still()
    assert stands[0] < 1.4
    smooth_cell.pendant('estop', 'release')
    assert peer.call('reset_error')[0]
    peer.wait_for(lambda: peer.robot_status[-1].e_stopped.val == 0, 'E-stop reset')
    peer.enable()
    assert np.array_equal(peer.assert_still(), stands)
    go_back(smooth_cell)
