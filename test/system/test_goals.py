# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Goals through ROS, replaced ones among them."""

import socket
import struct
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from control_msgs.msg import JointTolerance
from rclpy.duration import Duration
from rclpy.time import Time as RosTime
from std_msgs.msg import Header
from support.cell import LASTS, PROGRAMS, START, Cell, cell_with
from support.ros_peer import JOINTS, trajectory
from trajectory_msgs.msg import MultiDOFJointTrajectory, MultiDOFJointTrajectoryPoint

from epson_driver.share import share_file
from epson_driver.trajectory_file import read_trajectory

A = [0.2, 0.0, 0.3, 0.1, -0.6, 0.1]
FAR = [1.5, 0.0, 0.3, 0.1, -0.6, 0.1]


@pytest.fixture(scope='module', params=PROGRAMS)
def shared_cell(request: Any, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cell]:
    """One enabled cell for all of them."""
    one = cell_with(tmp_path_factory.mktemp('cell'), request.param)
    try:
        one.ready()
        one.peer.enable()
        yield one
    finally:
        one.close()


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
    # it was at A on the way: a cyclic path must not succeed early (invariant 5)
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
def test_joint_names_in_any_order(shared_cell: Cell) -> None:
    order = [3, 0, 5, 1, 4, 2]
    message = trajectory(
        (0.0, [START[i] for i in order]),
        (0.4, [A[i] for i in order]),
        names=[JOINTS[i] for i in order],
    )
    assert shared_cell.peer.goal(message).result()[0] == 'succeeded'
    assert np.abs(shared_cell.peer.position() - A).max() < 1e-6
    back = trajectory((0.0, A), (0.4, START))
    assert shared_cell.peer.goal(back).result()[0] == 'succeeded'


@pytest.mark.quick
@pytest.mark.invariant(8)
def test_invariant_8_measured_values_reach_ros_unchanged(shared_cell: Cell) -> None:
    if shared_cell.spel:
        pytest.skip('it has one state client, the driver: test_state_server.py compares bits')
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
def test_trajectory_topic_executes_and_an_empty_one_stops(shared_cell: Cell) -> None:
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


def test_single_point_goal_without_a_start(shared_cell: Cell) -> None:
    """What rqt_joint_trajectory_controller sends: one point, some time ahead."""
    peer = shared_cell.peer
    assert peer.goal(trajectory((0.5, A))).result()[0] == 'succeeded'
    assert peer.goal(trajectory((0.5, START))).result()[0] == 'succeeded'


def changed(joint: int, value: float) -> list[float]:
    return [value if index == joint else old for index, old in enumerate(A)]


def with_velocities(message: Any, point: int, velocities: list[float]) -> Any:
    for each in message.points:
        each.velocities = [0.0] * 6
    message.points[point].velocities = velocities
    return message


def stamped(message: Any, sec: int) -> Any:
    message.header = Header(stamp=Time(sec=sec))
    return message


NAN = float('nan')
BAD_GOALS: dict[str, tuple[Any, int, tuple[str, ...]]] = {
    'empty': (trajectory(), -1, ('no points',)),
    'unknown joint': (
        trajectory((0.0, START), names=[*JOINTS[:5], 'elbow']),
        -2,
        ("'elbow'", 'joint_6'),
    ),
    'missing joint': (trajectory((0.0, START[:5]), names=JOINTS[:5]), -2, ('joint_6',)),
    'joint named twice': (
        trajectory((0.0, START), names=[*JOINTS[:5], 'joint_1']),
        -2,
        ('joint_1', 'twice'),
    ),
    'positions missing': (
        trajectory((0.0, START), (0.5, A[:4])),
        -1,
        ('point 1', '4 positions', '6 joints'),
    ),
    'not a number': (
        trajectory((0.0, START), (0.5, changed(3, NAN))),
        -1,
        ('point 1', 'joint_4', 'nan', 'not finite'),
    ),
    'infinite': (
        trajectory((0.0, START), (0.5, changed(2, float('inf')))),
        -1,
        ('point 1', 'joint_3', 'inf'),
    ),
    'outside position limits': (
        trajectory((0.0, START), (5.0, changed(1, 1.2))),
        -1,
        ('point 1', 'joint_2', '1.2', '1.13446'),
    ),
    'over-speed between points': (
        trajectory((0.0, START), (0.1, changed(0, 1.0))),
        -1,
        ('points 0 to 1', 'joint_1', '10 rad/s', '7.85'),
    ),
    'over-speed in a point': (
        with_velocities(trajectory((0.0, START), (0.5, A), (1.0, START)), 1, [0, 0, 9.5, 0, 0, 0]),
        -1,
        ('point 1', 'joint_3', '9.5', '8.97'),
    ),
    'moving at the end': (
        with_velocities(trajectory((0.0, START), (0.5, A)), 1, [0.5, 0, 0, 0, 0, 0]),
        -1,
        ('point 1', 'joint_1', '0.5', 'allow_nonzero_velocity_at_trajectory_end'),
    ),
    'times not increasing': (
        trajectory((0.0, START), (0.5, A), (0.5, START)),
        -1,
        ('point 2', '0.5 s', 'strictly increase'),
    ),
    'starts elsewhere': (
        trajectory((0.0, A), (0.5, START)),
        -1,
        ('joint_1', 'starts at 0.2', 'is at 0', '0.02'),
    ),
    'cannot get to the start in time': (
        trajectory((0.05, changed(0, 1.0)), (1.0, START)),
        -1,
        ('joint_1', '20 rad/s', '7.85'),
    ),
    'old stamp': (stamped(there_and_back(), 1000), -3, ('header.stamp', 'ago', '0.6 s')),
    'far future stamp': (stamped(there_and_back(), 2_000_000_000), -1, ('header.stamp', 'future')),
}


@pytest.mark.parametrize('name', BAD_GOALS)
def test_bad_goal_is_refused_with_its_reason_and_nothing_moves(
    shared_cell: Cell, name: str
) -> None:
    message, code, words = BAD_GOALS[name]
    peer = shared_cell.peer
    before = peer.position()
    ended, error_code, text = peer.goal(message).result()
    assert (ended, error_code) == ('aborted', code), text
    for word in words:
        assert word in text
    assert np.array_equal(peer.assert_still(), before)


def test_goal_starts_at_its_stamp(shared_cell: Cell) -> None:
    peer = shared_cell.peer
    message, start = there_and_back(), peer.node.get_clock().now() + Duration(seconds=0.8)
    message.header.stamp = start.to_msg()
    first = len(peer.joint_states)
    ended, _, text = peer.goal(message).result()
    assert ended == 'succeeded', text
    moved = [state for state in peer.joint_states[first:] if abs(state.position[0]) > 1e-3]
    assert RosTime.from_msg(moved[0].header.stamp) > start


def test_bad_fields_beside_the_trajectory(shared_cell: Cell) -> None:
    peer = shared_cell.peer
    multi = MultiDOFJointTrajectory(points=[MultiDOFJointTrajectoryPoint()])
    ended, code, text = peer.goal(there_and_back(), multi_dof_trajectory=multi).result()
    assert (ended, code) == ('aborted', -1)
    assert 'multi_dof_trajectory' in text
    tolerance = JointTolerance(name='elbow', position=0.1)
    ended, code, text = peer.goal(there_and_back(), goal_tolerance=[tolerance]).result()
    assert (ended, code) == ('aborted', -2)
    assert 'elbow' in text


def test_good_goal_works_after_all_the_bad_ones(shared_cell: Cell) -> None:
    assert shared_cell.peer.goal(there_and_back()).result()[0] == 'succeeded'


def test_goal_time_tolerance_ends_a_late_goal(shared_cell: Cell) -> None:
    """Point to point cannot keep a fast plan: asked to, the goal says so, and the arm stops."""
    from builtin_interfaces.msg import Duration

    peer = shared_cell.peer
    plan = read_trajectory(share_file('config', 'trajectories', 'around_pillar_fast_100ms.yaml'))
    to_start = plan.positions[0].tolist()
    assert peer.goal(trajectory((1.0, to_start))).result()[0] == 'succeeded'
    points = zip(plan.times.tolist(), plan.positions.tolist(), strict=True)
    late = peer.goal(trajectory(*points), goal_time_tolerance=Duration(nanosec=10_000_000))
    ended, code, text = late.result()
    assert (ended, code) == ('aborted', -5), text
    assert 'goal_time' in text
    position = peer.wait_until_still()
    assert np.abs(position - plan.positions[-1]).max() > 0.1
    assert peer.goal(trajectory((1.0, START))).result()[0] == 'succeeded'


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
    assert 'stands' in text
    assert new.result()[0] == 'succeeded'
    assert np.abs(peer.assert_still() - START).max() < 1e-6


def test_invalid_replacement_leaves_the_running_goal_alone(shared_cell: Cell) -> None:
    peer = shared_cell.peer
    goal = peer.goal(trajectory((0.0, START), (3.0, A)))
    peer.wait_for_motion()
    assert peer.goal(trajectory((0.0, [NAN] * 6))).result()[1] == -1
    assert goal.result()[0] == 'succeeded'
    assert peer.goal(trajectory((0.5, START))).result()[0] == 'succeeded'


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
    assert peer.call('stop')[0]  # nothing runs: acknowledged all the same
