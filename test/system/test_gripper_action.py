# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A gripper as a ROS user, or MoveIt, has it: the action `~/gripper_cmd`."""

import math
from typing import Any

import pytest
from action_msgs.msg import GoalStatus
from control_msgs.action import GripperCommand
from rclpy.action import ActionClient
from support.cell import Cell

OPEN, CLOSED = 0.04, 0.0
GRIPPER = {
    'gripper.outputs': [2, 3],
    'gripper.inputs': [4, 5],
    'gripper.stroke': OPEN,
    'gripper.time': 30.0,
}


class Gripper:
    """Its action client, and its jaws: what the inputs show is set by hand."""

    def __init__(self, cell: Cell) -> None:
        self._cell = cell
        self._peer = cell.peer
        self._client = ActionClient(cell.peer.node, GripperCommand, '/epson_driver/gripper_cmd')
        self._peer.wait_for(self._client.server_is_ready, 'the action server')

    def send(self, position: float) -> Any:
        """Send a goal; return its handle."""
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
            self._cell.pendant('io', 'in', str(index), 'on' if value else 'off')


def test_it_opens_closes_and_its_goals_end_as_moveit_expects(make_cell: Any) -> None:
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


@pytest.mark.slow
def test_what_stays_between_the_ends_is_held_when_closing_and_an_error_when_opening(
    make_cell: Any,
) -> None:
    cell: Cell = make_cell(**GRIPPER | {'gripper.time': 0.5}).ready()
    gripper = Gripper(cell)
    gripper.show(False, False)
    status, result = gripper.result(gripper.send(CLOSED))
    assert (status, result.stalled) == (GoalStatus.STATUS_SUCCEEDED, True)
    assert result.position == pytest.approx(OPEN / 2)
    status, result = gripper.result(gripper.send(OPEN))
    assert status == GoalStatus.STATUS_ABORTED
