# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The driver answers each request of a burst larger than a queue of ten (invariants 5 and 9).

The user's queues are deep here, too, because a full queue of the user drops replies
(docs/ros_interface.md).
"""

from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from control_msgs.action import FollowJointTrajectory
from epson_msgs.srv import ReadIo
from rclpy.action import ActionClient
from rclpy.qos import QoSProfile
from std_srvs.srv import Trigger
from support.cell import START, Cell
from support.ros_peer import PATIENCE, STATUS_NAMES, RosPeer, trajectory

pytestmark = pytest.mark.invariant(5, 9)

COUNT = 60
DEEP = QoSProfile(depth=1000)


def send_burst(peer: RosPeer, send: Callable[[], Any]) -> list[Any]:
    """Send requests one after another, and return all replies."""
    futures = peer.in_executor(lambda: [send() for _ in range(COUNT)])
    return [peer.complete(future) for future in futures]


@pytest.fixture(scope='module')
def action(shared_cell: Cell) -> Iterator[Any]:
    client = ActionClient(
        shared_cell.peer.node,
        FollowJointTrajectory,
        'epson_driver/follow_joint_trajectory',
        goal_service_qos_profile=DEEP,
        result_service_qos_profile=DEEP,
        cancel_service_qos_profile=DEEP,
    )
    assert client.wait_for_server(PATIENCE)
    yield client
    shared_cell.peer.in_executor(client.destroy)


def test_every_goal_of_a_burst_is_answered(shared_cell: Cell, action: Any) -> None:
    peer = shared_cell.peer
    here = peer.position().tolist()
    other = START if abs(here[0] - START[0]) > 0.1 else [0.3, *START[1:]]
    goal = FollowJointTrajectory.Goal(trajectory=trajectory((0.0, here), (0.5, other)))
    handles = send_burst(peer, lambda: action.send_goal_async(goal))
    assert all(handle.accepted for handle in handles)
    pending = iter(handles)
    answers = send_burst(peer, lambda: next(pending).get_result_async())
    ends = Counter(STATUS_NAMES[answer.status] for answer in answers)
    assert set(ends) <= {'aborted', 'succeeded'}
    assert ends.total() == COUNT
    assert all(answer.result.error_string for answer in answers)


@pytest.mark.parametrize(
    ('kind', 'name'),
    [(Trigger, 'enable'), (ReadIo, 'read_io'), (Trigger, 'stop')],
)
def test_every_service_call_of_a_burst_is_answered(
    shared_cell: Cell, kind: Any, name: str
) -> None:
    peer = shared_cell.peer
    with peer.client(kind, f'epson_driver/{name}', qos_profile=DEEP) as client:
        answers = send_burst(peer, lambda: client.call_async(kind.Request()))
    assert len(answers) == COUNT
