# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Motion primitives and the gripper's action, end to end."""

import math
from collections.abc import Iterator
from contextlib import closing
from typing import Any

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from control_msgs.action import ExecuteMotionPrimitiveSequence, GripperCommand
from control_msgs.msg import MotionArgument, MotionPrimitive
from rclpy.action import ActionClient
from support.cell import LASTS, Cell
from support.primitives import ARM, READY, Sequence, joint_move, tool_move

from epson_driver.tool_motion.pose_path import distance_from

FAR = [2.5, 0.2, 0.2, 0.0, -1.9, 0.0]
SLOW = 2.5 / LASTS  # rad/s
ACCURACY_M = 3e-4
FASTEST = math.radians(450.0)
INVALID_GOAL = ExecuteMotionPrimitiveSequence.Result.INVALID_GOAL


@pytest.fixture(scope='module')
def cell(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cell]:
    """One enabled cell whose controller does not stop at every point."""
    with closing(Cell(tmp_path_factory.mktemp('cell'), '--motion=smooth')) as one:
        one.ready()
        one.peer.enable()
        yield one


def to_ready(cell: Cell) -> None:
    ended, _, text = Sequence(cell.peer, [joint_move(READY)]).result()
    assert ended == 'succeeded', text


@pytest.mark.invariant(5)
def test_joint_move_line_and_arc_are_executed_with_feedback(cell: Cell) -> None:
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
    end = int(np.argmax(places[:, 1]))  # of the line and start of the arc
    start = int(np.argmin(np.linalg.norm(places[:end] - home, axis=1)))
    line = np.array([home, home + np.array([0.0, 0.08, 0.0])])
    assert places[end] == pytest.approx(line[1], abs=1e-3)
    assert max(distance_from(place, line) for place in places[start : end + 1]) < ACCURACY_M


def with_blend(motion: MotionPrimitive, radius: float) -> MotionPrimitive:
    motion.blend_radius = radius
    return motion


def test_blended_motions_round_the_corners_and_report_feedback(cell: Cell) -> None:
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
"""A sequence with a long planning time."""


@pytest.mark.invariant(4, 5)
@pytest.mark.parametrize('how', ['cancel', 'stop', 'disable'])
def test_sequence_ended_during_planning_never_moves(cell: Cell, how: str) -> None:
    to_ready(cell)
    sequence = Sequence(cell.peer, LONG)
    if how == 'cancel':
        sequence.cancel()
        assert sequence.result() == ('canceled', 0, 'canceled before it could start')
    else:
        assert cell.peer.call(how)[0]
        ended, code, text = sequence.result()
        assert (ended, code) == ('aborted', INVALID_GOAL)
        assert {'stop': 'stopped on request', 'disable': 'disabled on request'}[how] in text
        if how == 'disable':
            cell.peer.enable()
    assert np.abs(cell.peer.assert_still() - READY).max() < 1e-3
    assert sequence.indices == []
    to_ready(cell)


ODD_VALUES = (math.nan, math.inf, -math.inf, 0.0, -0.0, -1.0, -1e-300, 1e300)
ODD_NAMES = (
    '',
    'Velocity',
    'velocity ',
    'speed',
    'v' * 100_000,
    '\x1b[2J',
    'geschwindigkeit \u20ac',
)


@pytest.mark.invariant(1, 5)
def test_odd_arguments_are_rejected_and_the_fastest_move_respects_limits(
    cell: Cell,
) -> None:
    to_ready(cell)
    odd = [(name, value) for name in ('velocity', 'acceleration') for value in ODD_VALUES[:-1]]
    odd += [('move_time', value) for value in ODD_VALUES if value != 0.0]
    odd += [(name, 0.5) for name in ODD_NAMES]
    for move in (joint_move(FAR), tool_move((0.0, 0.05, 0.0))):
        for name, value in odd:
            argument = MotionArgument(argument_name=name, argument_value=value)
            move.additional_arguments = [argument]
            ended, code, text = Sequence(cell.peer, [move]).result()
            assert (ended, code) == ('aborted', INVALID_GOAL), (name[:20], value)
            assert name[:20].strip() in text or not name.isascii() or not name.isprintable()
            assert len(text) < 400
            assert text.isprintable()
    assert np.abs(cell.peer.assert_still() - READY).max() < 1e-3
    first = len(cell.peer.joint_states)
    there = [0.8, *READY[1:]]
    quick = joint_move(there, velocity=1000.0, acceleration=1e4)
    ended, code, text = Sequence(cell.peer, [quick, joint_move(READY)]).result()
    assert (ended, code) == ('succeeded', 0), text
    speeds = [abs(state.velocity[0]) for state in cell.peer.joint_states[first:]]
    assert max(speeds) <= 1.02 * FASTEST


@pytest.mark.invariant(3)
def test_cancel_stops_the_arm_during_a_sequence(cell: Cell) -> None:
    to_ready(cell)
    sequence = Sequence(cell.peer, [joint_move(FAR, velocity=SLOW), joint_move(READY)])
    sequence.wait_for_motion()
    sequence.cancel()
    ended, code, text = sequence.result()
    assert (ended, code) == ('canceled', 0), text
    assert not np.allclose(cell.peer.assert_still(), FAR, atol=1e-2)


OPEN, CLOSED = 0.04, 0.0

GRIPPER = {
    'gripper.outputs': [2, 3],
    'gripper.inputs': [4, 5],
    'gripper.stroke': OPEN,
    'gripper.time': 30.0,
}


class Gripper:
    """The gripper's action client, and its inputs, which the test sets."""

    def __init__(self, cell: Cell) -> None:
        self._cell = cell
        self._peer = cell.peer
        self._client = ActionClient(cell.peer.node, GripperCommand, '/epson_driver/gripper_cmd')
        self._peer.wait_for(self._client.server_is_ready, 'the action server')

    def send(self, position: float) -> Any:
        """Send a goal, and return its handle."""
        goal = GripperCommand.Goal()
        goal.command.position = position
        return self._peer.complete(
            self._peer.in_executor(lambda: self._client.send_goal_async(goal))
        )

    def result(self, handle: Any) -> tuple[int, GripperCommand.Result]:
        answer = self._peer.complete(self._peer.in_executor(handle.get_result_async))
        return answer.status, answer.result

    def show(self, opened: bool, closed: bool) -> None:
        for index, value in ((4, opened), (5, closed)):
            self._cell.pendant('io', 'DI', str(index), 'on' if value else 'off')


def test_gripper_goals_end_like_moveit_expects(make_cell: Any) -> None:
    cell: Cell = make_cell(**GRIPPER).ready()
    gripper = Gripper(cell)
    gripper.show(False, True)
    opening = gripper.send(OPEN)
    assert opening.accepted
    gripper.show(True, False)
    status, result = gripper.result(opening)
    assert status == GoalStatus.STATUS_SUCCEEDED
    assert (result.position, result.reached_goal, result.stalled) == (OPEN, True, False)

    closing = gripper.send(CLOSED)
    gripper.show(False, True)
    status, result = gripper.result(closing)
    assert (status, result.position) == (GoalStatus.STATUS_SUCCEEDED, CLOSED)

    assert not gripper.send(math.nan).accepted

    canceled = gripper.send(OPEN)
    cell.peer.complete(cell.peer.in_executor(canceled.cancel_goal_async))
    status, result = gripper.result(canceled)
    assert status == GoalStatus.STATUS_CANCELED
    assert math.isnan(result.position)

    replaced, newer = gripper.send(OPEN), gripper.send(CLOSED)
    assert gripper.result(newer)[0] == GoalStatus.STATUS_SUCCEEDED
    assert gripper.result(replaced)[0] == GoalStatus.STATUS_ABORTED
