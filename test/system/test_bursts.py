# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""More requests at once than any queue of ten takes: each of them is answered.

Invariants 5 and 9. The user's queues are deep here, too: answers that push each other out of those
are not the driver's (docs/ros_interface.md).
"""

import random
from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from action_msgs.msg import GoalStatus, GoalStatusArray
from control_msgs.action import FollowJointTrajectory
from epson_msgs.srv import ReadIo
from rclpy.action import ActionClient
from rclpy.qos import QoSProfile
from std_srvs.srv import Trigger
from support.cell import START, Cell
from support.examples import one_in
from support.ros_peer import PATIENCE, STATUS_NAMES, RosPeer, trajectory
from unique_identifier_msgs.msg import UUID

pytestmark = pytest.mark.invariant(5, 9)

DEEP = QoSProfile(depth=1000)


def at_once(peer: RosPeer, send: Callable[[], Any], count: int) -> list[Any]:
    """Send requests one right after the other, and return all answers."""
    futures = peer.in_executor(lambda: [send() for _ in range(count)])
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


@pytest.mark.parametrize('count', [40, pytest.param(200, marks=pytest.mark.slow)])
def test_each_of_many_goals_that_come_at_once_is_answered(
    shared_cell: Cell, action: Any, count: int
) -> None:
    peer = shared_cell.peer
    here = peer.position().tolist()
    other = START if abs(here[0] - START[0]) > 0.1 else [0.3, *START[1:]]
    goal = FollowJointTrajectory.Goal(trajectory=trajectory((0.0, here), (0.5, other)))
    handles = at_once(peer, lambda: action.send_goal_async(goal), count)
    assert all(handle.accepted for handle in handles)
    asked = iter(handles)
    answers = at_once(peer, lambda: next(asked).get_result_async(), count)
    ends = Counter(STATUS_NAMES[answer.status] for answer in answers)
    assert set(ends) <= {'aborted', 'succeeded'}
    assert ends.total() == count
    assert all(answer.result.error_string for answer in answers)


@pytest.mark.parametrize('count', [40, pytest.param(200, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    ('kind', 'name'),
    one_in(3, [(Trigger, 'enable'), (ReadIo, 'read_io'), (Trigger, 'stop')], several=True),
)
def test_each_of_many_calls_that_come_at_once_is_answered(
    shared_cell: Cell, kind: Any, name: str, count: int
) -> None:
    peer = shared_cell.peer
    with peer.client(kind, f'epson_driver/{name}', qos_profile=DEEP) as client:
        answers = at_once(peer, lambda: client.call_async(kind.Request()), count)
    assert len(answers) == count


ENDED = (GoalStatus.STATUS_SUCCEEDED, GoalStatus.STATUS_ABORTED)


@pytest.mark.parametrize('count', [40, pytest.param(200, marks=pytest.mark.slow)])
def test_answers_that_a_client_lacks_were_lost_in_its_own_queue(
    shared_cell: Cell, action: Any, count: int
) -> None:
    """Both take no answer until each of their goals has ended, as a third node sees it.

    They differ in nothing but their queues, ten answers deep by default: the driver sent all.
    """
    peer, observer = shared_cell.peer, RosPeer(shared_cell.domain)
    name = 'epson_driver/follow_joint_trajectory'
    usual = ActionClient(peer.node, FollowJointTrajectory, name)
    goal = FollowJointTrajectory.Goal(trajectory=trajectory((0.1, peer.position().tolist())))
    ended: set[bytes] = set()
    observer.node.create_subscription(
        GoalStatusArray,
        f'{name}/_action/status',
        lambda message: ended.update(
            bytes(each.goal_info.goal_id.uuid)
            for each in message.status_list
            if each.status in ENDED
        ),
        1,
    )
    try:
        assert usual.wait_for_server(PATIENCE)
        for client, kept in ((action, count), (usual, 10)):

            def burst(client: Any = client) -> list[Any]:
                sent = {random.randbytes(16) for _ in range(count)}
                ids = [UUID(uuid=list(each)) for each in sent]
                futures = [client.send_goal_async(goal, goal_uuid=each) for each in ids]
                observer.wait_for(lambda: sent <= ended, 'the end of each goal')
                return futures

            futures = peer.in_executor(burst)
            peer.wait_for(lambda f=futures, k=kept: sum(each.done() for each in f) >= k, 'answers')
            peer.call('stop')  # another turn, which would take one more
            assert sum(each.done() for each in futures) == kept
    finally:
        peer.in_executor(usual.destroy)
        observer.close()
