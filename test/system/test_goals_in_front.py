# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""smooth_goals with a downstream driver that behaves like joint_trajectory_controller."""

import os
import resource
import signal
from collections.abc import Iterator
from pathlib import Path
from resource import RUSAGE_CHILDREN
from typing import Any

import numpy as np
import pytest
from builtin_interfaces.msg import Duration
from control_msgs.msg import JointTolerance
from sensor_msgs.msg import JointState
from support.jtc_like import ACTION, JtcLike, limit_usage
from support.ros_peer import JOINTS, RosPeer, trajectory

from epson_driver.processes import processes
from epson_driver.robots import load_robot_model

LIMITS = load_robot_model('c3_a601s').limits
START = [0.0, 0.1, 0.2, 0.0, -0.5, 0.0]
FAR = [1.5, 0.5, -0.3, 0.4, -1.1, 0.6]

LEAD_S, LASTS_S = 1.0, 6.0
"""Lead of a stop on a busy machine, and the duration of a goal, s."""


class Front:
    """One smooth_goals, the downstream driver, and a peer that sends goals."""

    def __init__(self, folder: Path, *, reports: bool = True, **parameters: Any) -> None:
        self.domain = processes.free_ros_domain()
        self.behind = JtcLike(self.domain, LIMITS.names, START, reports=reports)
        values = {
            'action': ACTION,
            'state_timeout': 10.0,
            'reply_timeout': 10.0,
            'limits_file': 'c3_a601s',
            'lead': LEAD_S,
        } | parameters
        words = [word for name, value in values.items() for word in ('-p', f'{name}:={value}')]
        self.process = processes.Process(
            'smooth_goals',
            ['--ros-args', *words],
            folder / 'smooth_goals.log',
            processes.ros_environment(self.domain),
        )
        self.peer = RosPeer(self.domain, node='smooth_goals')
        assert self.peer.action.wait_for_server(120.0)
        self.peer.wait_for(lambda: self.peer.joint_states, 'joint_states')

    def stranger(self, names: list[str], positions: list[float]) -> None:
        """Publish joint_states from another node at 50 Hz."""
        node = self.peer.node
        publisher = node.create_publisher(JointState, 'joint_states', 10)
        message = JointState(name=names, position=positions)

        def publish() -> None:
            message.header.stamp = node.get_clock().now().to_msg()
            publisher.publish(message)

        node.create_timer(0.02, publish)

    def close(self) -> None:
        self.peer.close()
        self.process.end()
        self.behind.close()

    def position(self) -> np.ndarray:
        """Return the commanded position."""
        return self.behind.commanded[-1][1][0]

    def until_moving(self) -> None:
        """Wait until the arm moves at some speed."""
        self.peer.wait_for(lambda: np.abs(self.behind.commanded[-1][1][1]).max() > 0.1, 'a motion')

    def check(self) -> None:
        """Check all commands against the limits."""
        result = limit_usage(list(self.behind.commanded), LIMITS)
        assert result['velocity'] <= 1.001, result
        assert result['acceleration'] <= 1.01, result
        assert result['jerk'] <= 1.8, result  # quintics between the points of the smooth motion
        assert result['jump'] <= 1.8, result


@pytest.fixture
def make(tmp_path: Path) -> Iterator[Any]:
    fronts: list[Front] = []

    def front(**parameters: Any) -> Front:
        fronts.append(Front(tmp_path, **parameters))
        return fronts[-1]

    yield front
    for front_ in fronts:
        front_.close()


def test_plan_of_positions_becomes_a_motion_within_the_limits(make: Any) -> None:
    front = make()
    middle = [0.5, 0.2, 0.0, 0.1, -0.7, 0.2]
    goal = front.peer.goal(trajectory((0.0, START), (0.7, middle), (1.2, FAR)))
    assert goal.result() == ('succeeded', 0, 'Goal reached')
    assert np.abs(front.position() - FAR).max() < 1e-9
    assert goal.feedback[-1].joint_names == JOINTS
    front.check()
    assert len(front.behind.accepted) == 1


@pytest.mark.invariant(10)
@pytest.mark.parametrize('reports', [True, False], ids=['its own state', 'joint_states alone'])
def test_inv10_goal_starts_at_the_arm_despite_other_publishers(make: Any, reports: bool) -> None:
    front = make(reports=reports)
    front.stranger(['finger_joint'], [0.01])
    assert front.peer.goal(trajectory((1.0, FAR))).result()[0] == 'succeeded'
    front.stranger(JOINTS[::-1], [1.0] * 6)
    for number in range(6):
        ended, _, text = front.peer.goal(trajectory((1.0, FAR if number % 2 else START))).result()
        if reports:
            assert ended == 'succeeded', text
        else:
            assert ended == 'aborted'
            assert 'jumps on joint_states' in text
            assert 'two publishers' in text
    front.check()
    assert len(front.behind.accepted) == (7 if reports else 1)


@pytest.mark.invariant(3, 9)
def test_end_of_the_process_brakes_the_arm(make: Any) -> None:
    front = make()
    goal = front.peer.goal(trajectory((0.0, START), (LASTS_S, FAR)))
    front.until_moving()
    assert front.process.end(signal.SIGTERM) == 0
    assert goal.result()[2] == 'smooth_goals ends, it braked, the arm is at rest'
    assert np.abs(front.position() - FAR).max() > 0.1
    front.check()


def cpu_time(process_id: int) -> float:
    """Return the CPU time of a process, s."""
    fields = (
        Path(f'/proc/{process_id}/stat').read_text(encoding='ascii').rpartition(')')[2].split()
    )
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


@pytest.mark.invariant(7, 9)
def test_inv7_inv9_planning_is_bounded_and_ends_with_the_process(make: Any) -> None:

    front = make()
    for seconds, limit in ((1e9, '86400 s'), (3600.0, '600 s')):
        text = front.peer.goal(trajectory((0.0, START), (seconds, FAR))).result()[2]
        assert 'point 1: time_from_start' in text
        assert limit in text
    angles = np.linspace(0.0, 500.0, 4000)
    waves = START + 0.3 * np.sin(np.outer(angles, np.arange(1, 7)) / 5)
    points = zip((angles * 1.19).tolist(), waves.tolist(), strict=True)
    goal, before = front.peer.goal(trajectory(*points)), cpu_time(front.process.process_id)
    front.peer.wait_for(
        lambda: cpu_time(front.process.process_id) > before + 2.0, 'the longest planning'
    )
    used, children = cpu_time(front.process.process_id), resource.getrusage(RUSAGE_CHILDREN)
    assert front.process.end(signal.SIGTERM) == 0
    ended = resource.getrusage(RUSAGE_CHILDREN)
    total = ended.ru_utime + ended.ru_stime - children.ru_utime - children.ru_stime
    assert total - used < 2.0
    assert goal.result()[2] == 'smooth_goals ends'
    assert not front.behind.accepted


def goal_from_here(front: Front) -> Any:
    """Send a goal to the farther of two poses."""
    here = front.position()
    far = max(START, FAR, key=lambda pose: np.abs(pose - here).max())
    return front.peer.goal(trajectory((0.0, here.tolist()), (LASTS_S, far)))


@pytest.mark.invariant(5)
def test_tolerances_and_result_are_passed_on(make: Any) -> None:
    front, path = make(), [JointTolerance(name='joint_1', position=0.05)]
    here = front.position().tolist()
    message = trajectory((0.0, here), (2.0, [*here[:5], here[5] + 0.3]))
    goal = front.peer.goal(
        message, path_tolerance=path, goal_time_tolerance=Duration(sec=1, nanosec=500_000_000)
    )
    front.until_moving()
    front.behind.abort(-4, 'Aborted due to path tolerance violation')
    ended, code, text = goal.result()
    assert (ended, code) == ('aborted', -4), text
    assert 'Aborted due to path tolerance violation' in text
    (accepted,) = front.behind.accepted
    assert accepted.path_tolerance == path
    passed = accepted.goal_time_tolerance.sec + accepted.goal_time_tolerance.nanosec * 1e-9
    assert passed == pytest.approx(1.5, abs=0.1)  # minus the smooth motion's extra time


@pytest.mark.invariant(3, 5)
def test_newest_of_several_goals_succeeds_with_another_downstream_clock(make: Any) -> None:
    front = make()
    front.behind.ahead = 3_000_000_000
    del front.behind.commanded[:]
    front.peer.newer(60)
    here = front.position()
    goals = [
        front.peer.goal(trajectory((1.0, (here + offset).tolist())))
        for offset in (0.3, -0.2, 0.1, 0.05)
    ]
    results = [goal.result() for goal in goals]
    assert [ended for ended, _, _ in results] == ['aborted'] * 3 + ['succeeded'], results
    assert np.abs(front.position() - here - 0.05).max() < 1e-9
    front.check()
    goal = goal_from_here(front)
    front.until_moving()
    goal.cancel()
    assert goal.result()[2] == 'canceled, it braked, the arm is at rest'
    front.check()
