# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`~/execute_motion_primitive_sequence` from a ROS client: joint moves, lines and arcs."""

from collections.abc import Iterator

import numpy as np
import pytest
from control_msgs.action import ExecuteMotionPrimitiveSequence
from control_msgs.msg import MotionPrimitive
from support.cell import LASTS, START, Cell
from support.primitives import ARM, READY, Sequence, joint_move, tool_move
from support.ros_peer import trajectory

from epson_driver.motion.cartesian import distance_from

pytest.importorskip('py_opw_kinematics')

FAR = [2.5, 0.2, 0.2, 0.0, -1.9, 0.0]
SLOW = 2.5 / LASTS  # rad/s
ACCURACY_M = 3e-4
INVALID_GOAL = ExecuteMotionPrimitiveSequence.Result.INVALID_GOAL


@pytest.fixture(scope='module')
def cell(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cell]:
    """One enabled cell with a controller that does not rest at every point."""
    one = Cell(tmp_path_factory.mktemp('cell'), '--motion=smooth')
    try:
        one.ready()
        one.peer.enable()
        yield one
    finally:
        one.close()


def to_ready(cell: Cell) -> None:
    ended, _, text = Sequence(cell.peer, [joint_move(READY)]).result()
    assert ended == 'succeeded', text


@pytest.mark.invariant(5)
def test_a_joint_move_a_line_and_an_arc_are_executed_with_feedback(cell: Cell) -> None:
    peer = cell.peer
    first = len(peer.joint_states)
    sequence = Sequence(
        peer,
        [
            joint_move(READY, velocity=1.0),
            tool_move((0.0, 0.08, 0.0), velocity=0.1),
            tool_move((0.0, 0.0, 0.0), (0.03, 0.04, 0.0), velocity=0.1),
        ],
    )
    ended, code, text = sequence.result()
    assert (ended, code) == ('succeeded', 0), text
    assert 'at the goal' in text
    assert np.abs(peer.assert_still() - READY).max() < 1e-3
    assert sequence.indices == sorted(sequence.indices)
    assert set(sequence.indices) == {0, 1, 2}
    states = peer.joint_states[first:]
    places = np.array([ARM.forward(np.array(state.position))[:3, 3] for state in states])
    home = ARM.forward(np.array(READY))[:3, 3]
    end = int(np.argmax(places[:, 1]))  # of the line, where the arc begins
    begin = int(np.argmin(np.linalg.norm(places[:end] - home, axis=1)))
    line = np.array([home, home + np.array([0.0, 0.08, 0.0])])
    assert places[end] == pytest.approx(line[1], abs=1e-3)
    assert max(distance_from(place, line) for place in places[begin : end + 1]) < ACCURACY_M


def with_blend(motion: MotionPrimitive, radius: float) -> MotionPrimitive:
    motion.blend_radius = radius
    return motion


@pytest.mark.slow
def test_blended_motions_cut_the_corner_without_a_rest_and_feedback_follows(cell: Cell) -> None:
    to_ready(cell)
    peer = cell.peer
    first = len(peer.joint_states)
    side = (0.0, 0.08, 0.0)
    sequence = Sequence(
        peer,
        [
            with_blend(tool_move(side, velocity=0.1), 0.02),
            with_blend(tool_move((-0.05, 0.08, 0.0), velocity=0.1), 0.01),
            tool_move((-0.05, 0.0, 0.02), velocity=0.1),
            with_blend(joint_move([0.3, 0.2, 0.1, 0.0, -1.7, 0.0]), 0.03),
            joint_move(READY),
        ],
    )
    ended, code, text = sequence.result()
    assert (ended, code) == ('succeeded', 0), text
    assert np.abs(peer.assert_still() - READY).max() < 1e-3
    assert sequence.indices == sorted(sequence.indices)
    assert set(sequence.indices) == {0, 1, 2, 3, 4}
    states = [np.array(state.position) for state in peer.joint_states[first:]]
    places = np.array([ARM.forward(joints)[:3, 3] for joints in states])
    home = ARM.forward(np.array(READY))[:3, 3]
    for corner, radius in ((side, 0.02), ((-0.05, 0.08, 0.0), 0.01)):
        nearest = np.linalg.norm(places - home - corner, axis=1).min()
        assert 0.1 * radius < nearest < radius


LONG = [tool_move((0.0, 0.08 * (1 - n % 2), 0.0), velocity=0.1) for n in range(256)]
"""A sequence that takes a while to plan."""


@pytest.mark.slow
@pytest.mark.invariant(4, 5)
@pytest.mark.parametrize('how', ['cancel', 'stop', 'disable'])
def test_a_sequence_that_is_ended_while_it_is_planned_is_answered_and_never_moves(
    cell: Cell, how: str
) -> None:
    to_ready(cell)
    sequence = Sequence(cell.peer, LONG)
    if how == 'cancel':
        sequence.cancel()
        assert sequence.result() == ('canceled', 0, 'canceled before it could start')
    else:
        assert cell.peer.call(how)[0]
        ended, code, text = sequence.result()
        assert (ended, code) == ('aborted', INVALID_GOAL)
        assert {'stop': 'stopped by ~/stop', 'disable': 'disabled by ~/disable'}[how] in text
        if how == 'disable':
            cell.peer.enable()
    assert np.abs(cell.peer.assert_still() - READY).max() < 1e-3
    assert sequence.indices == []
    to_ready(cell)


@pytest.mark.slow
def test_what_cannot_be_is_refused_as_a_whole_and_nothing_moves(cell: Cell) -> None:
    to_ready(cell)
    blended = tool_move((0.0, 0.05, 0.0))
    blended.blend_radius = 0.01
    for bad, words in (
        ([joint_move(FAR), tool_move((2.0, 0.0, 0.0))], 'motions[1], LINEAR_CARTESIAN: '),
        ([blended], 'blend_radius = 0.01 m: must be 0, as nothing follows'),
        ([blended, joint_move(FAR)], 'motions[0], LINEAR_CARTESIAN: blend_radius = 0.01 m'),
        ([joint_move([45.0, -30.0, 20.0, 0.0, 10.0, 0.0])], 'look like degrees'),
        ([], 'trajectory has 0 motions'),
    ):
        ended, code, text = Sequence(cell.peer, bad).result()
        assert (ended, code) == ('aborted', INVALID_GOAL)
        assert words in text
    assert np.abs(cell.peer.assert_still() - READY).max() < 1e-3


@pytest.mark.slow
@pytest.mark.invariant(3)
def test_cancel_brings_the_arm_to_rest_in_the_middle_of_a_sequence(cell: Cell) -> None:
    to_ready(cell)
    sequence = Sequence(cell.peer, [joint_move(FAR, velocity=SLOW), joint_move(READY)])
    sequence.wait_for_motion()
    sequence.cancel()
    ended, code, text = sequence.result()
    assert (ended, code) == ('canceled', 0), text
    assert not np.allclose(cell.peer.assert_still(), FAR, atol=1e-2)


@pytest.mark.slow
def test_a_sequence_while_a_goal_runs_is_refused_and_a_trajectory_replaces_a_sequence(
    cell: Cell,
) -> None:
    to_ready(cell)
    running = Sequence(cell.peer, [joint_move(FAR, velocity=SLOW)])
    running.wait_for_motion()
    ended, code, text = Sequence(cell.peer, [joint_move(READY)]).result()
    assert (ended, code) == ('aborted', INVALID_GOAL)
    assert 'another goal runs' in text
    here = cell.peer.position().tolist()
    cell.peer.goal(trajectory((0.5, here))).result()
    ended, code, text = running.result()
    assert (ended, code) == ('aborted', INVALID_GOAL)
    assert 'replaced by a new goal' in text


@pytest.mark.slow
@pytest.mark.invariant(4)
def test_inv4_an_estop_ends_a_sequence_and_the_gate_stays_closed(cell: Cell) -> None:
    to_ready(cell)
    sequence = Sequence(cell.peer, [joint_move(FAR, velocity=SLOW), joint_move(READY)])
    sequence.wait_for_motion()
    cell.pendant('estop', 'press')
    ended, code, text = sequence.result()
    assert (ended, code) == ('aborted', INVALID_GOAL)
    assert 'E-stop' in text
    cell.peer.wait_for(lambda: cell.peer.robot_status[-1].in_motion.val == 0, 'rest')
    cell.pendant('estop', 'release')
    cell.pendant('reset')
    stood = cell.peer.assert_still()
    ended, _, text = Sequence(cell.peer, [joint_move(START)]).result()
    assert ended == 'aborted'
    assert 'not enabled' in text
    assert np.allclose(cell.peer.assert_still(), stood, atol=1e-6)
    cell.peer.enable()
