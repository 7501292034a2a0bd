# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""replace_goals = on_the_way with real processes: a new goal for an arm that moves."""

from collections.abc import Iterator

import numpy as np
import pytest
from support.cell import LASTS, START, Cell
from support.ros_peer import trajectory

FAR = [1.5, 0.0, 0.3, 0.1, -0.6, 0.1]
SIDE = [0.1, 0.3, 0.2, -0.2, -0.5, 0.3]


@pytest.fixture(scope='module')
def replacing_cell(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cell]:
    folder = tmp_path_factory.mktemp('cell')
    cell = Cell(folder, '--motion=smooth', replace_goals='on_the_way').ready()
    cell.peer.enable()
    yield cell
    cell.close()


@pytest.mark.invariant(5)
def test_invariant_5_a_goal_is_left_on_the_way_and_the_new_one_succeeds(
    replacing_cell: Cell,
) -> None:
    peer = replacing_cell.peer
    old = peer.goal(trajectory((0.0, START), (LASTS, FAR)))
    peer.wait_for_motion()
    new = peer.goal(trajectory((2.0, SIDE)))
    ended, code, text = old.result()
    assert (ended, code) == ('aborted', -1)
    assert 'the arm goes on to that one without a stop' in text
    ended, _, text = new.result()
    assert ended == 'succeeded', text
    assert np.abs(peer.assert_still() - SIDE).max() < 1e-6


@pytest.mark.slow
@pytest.mark.invariant(4)
def test_invariant_4_an_estop_after_the_change_stops_the_arm_for_good(
    replacing_cell: Cell,
) -> None:
    peer = replacing_cell.peer
    here = peer.assert_still().tolist()
    old = peer.goal(trajectory((0.0, here), (LASTS, FAR)))
    peer.wait_for_motion()
    new = peer.goal(trajectory((LASTS, SIDE)))
    assert 'without a stop' in old.result()[2]
    replacing_cell.pendant('estop', 'press')
    ended, _, text = new.result()
    assert ended == 'aborted'
    assert 'E-stop' in text
    stands = peer.wait_until_still()
    replacing_cell.pendant('estop', 'release')
    assert peer.call('reset_error')[0]
    peer.wait_for(lambda: peer.robot_status[-1].e_stopped.val == 0, 'E-stop reset')
    assert np.array_equal(peer.assert_still(), stands)
