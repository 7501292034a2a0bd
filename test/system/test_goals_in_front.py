# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""smooth_goals in front of somebody else's driver, which does as joint_trajectory_controller."""

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
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from support.jtc_like import ACTION, NAME, JtcLike, shares
from support.ros_peer import JOINTS, RosPeer, trajectory

from epson_driver.processes import processes
from epson_driver.robots import load_robot_model

LIMITS = load_robot_model('c3_a601s').limits
START = [0.0, 0.1, 0.2, 0.0, -0.5, 0.0]
FAR = [1.5, 0.5, -0.3, 0.4, -1.1, 0.6]

LEAD_S, LASTS_S = 1.0, 6.0
"""A stop begins so long ahead on a machine that may be busy, of a motion that takes longer."""

pytestmark = pytest.mark.slow


class Front:
    """One smooth_goals, the driver behind it, and who sends it goals."""

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
        """Have another node publish joint_states, fifty times a second."""
        node = self.peer.node
        publisher = node.create_publisher(JointState, 'joint_states', 10)
        message = JointState(name=names, position=positions)

        def publish() -> None:
            message.header.stamp = node.get_clock().now().to_msg()
            publisher.publish(message)

        node.create_timer(0.02, publish)

    def describe(self, velocity: float) -> None:
        """Have another node publish a robot description, latched, with this limit."""
        joint = (
            '<joint name="{}" type="revolute"><parent link="a"/><child link="b"/>'
            f'<limit lower="-3" upper="3" velocity="{velocity}" effort="1"/></joint>'
        )
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        publisher = self.peer.node.create_publisher(String, 'robot_description', latched)
        publisher.publish(String(data=f'<robot>{"".join(map(joint.format, JOINTS))}</robot>'))

    def close(self) -> None:
        self.peer.close()
        self.process.end()
        self.behind.close()

    def at(self) -> np.ndarray:
        """Return where the arm is commanded to be."""
        return self.behind.commanded[-1][1][0]

    def under_way(self) -> None:
        """Wait until the arm moves, with some speed."""
        self.peer.wait_for(lambda: np.abs(self.behind.commanded[-1][1][1]).max() > 0.1, 'a motion')

    def check(self) -> None:
        """Hold all that was commanded against the limits."""
        found = shares(list(self.behind.commanded), LIMITS)
        assert found['velocity'] <= 1.001, found
        assert found['acceleration'] <= 1.01, found
        assert found['jerk'] <= 1.8, found  # of quintics between points of the smooth motion
        assert found['jump'] <= 1.8, found


@pytest.fixture
def make(tmp_path: Path) -> Iterator[Any]:
    made: list[Front] = []

    def front(**parameters: Any) -> Front:
        made.append(Front(tmp_path, **parameters))
        return made[-1]

    yield front
    for each in made:
        each.close()


def test_a_plan_of_positions_becomes_a_motion_inside_the_limits(make: Any) -> None:
    front = make()
    middle = [0.5, 0.2, 0.0, 0.1, -0.7, 0.2]
    goal = front.peer.goal(trajectory((0.0, START), (0.7, middle), (1.2, FAR)))
    assert goal.result() == ('succeeded', 0, 'Goal reached')
    assert np.abs(front.at() - FAR).max() < 1e-9
    assert goal.feedback[-1].joint_names == JOINTS
    front.check()
    assert len(front.behind.taken) == 1


@pytest.mark.invariant(10)
@pytest.mark.parametrize('reports', [True, False], ids=['its own state', 'joint_states alone'])
def test_inv10_a_goal_begins_at_the_arm_beside_other_publishers(make: Any, reports: bool) -> None:
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
    assert len(front.behind.taken) == (7 if reports else 1)


@pytest.mark.invariant(2, 10)
def test_inv10_no_goal_is_faster_than_the_arm_beside_another_description(
    make: Any,
) -> None:
    front = make(limits_file="''", timing='time_optimal')
    front.describe(1.0)
    front.describe(1.0)  # the same again, as move_group does
    goal = trajectory((3.0, FAR))
    assert any(front.peer.goal(goal).result()[0] == 'succeeded' for _ in range(100))
    front.describe(50.0)
    front.peer.wait_for(lambda: 'robot_description gives' in front.process.log_text(), 'a word')
    back = front.peer.goal(trajectory((3.0, START))).result()
    assert back[:2] == ('aborted', -2)
    assert 'two values for joint_1, velocity: 1.0 and 50.0; stop the wrong publisher' in back[2]
    fastest = max(np.abs(state[1]).max() for _, state in front.behind.commanded)
    assert fastest <= 1.001


@pytest.mark.invariant(2, 3, 5)
def test_cancel_brakes_inside_the_limits_on_the_way(make: Any) -> None:
    front = make()
    goal = front.peer.goal(trajectory((0.0, START), (LASTS_S, FAR)))
    front.under_way()
    goal.cancel()
    ended, code, text = goal.result()
    assert (ended, code) == ('canceled', 0), text
    assert text == 'canceled; it braked; the arm stands'
    assert np.abs(front.at() - FAR).max() > 0.1
    assert front.behind.canceled == 0
    front.check()


@pytest.mark.invariant(2, 3, 5)
def test_a_newer_goal_begins_when_the_arm_has_braked(make: Any) -> None:
    front = make()
    first = front.peer.goal(trajectory((0.0, START), (LASTS_S, FAR)))
    front.under_way()
    second = front.peer.goal(trajectory((3.0, START)))
    ended, code, text = first.result()
    assert (ended, code) == ('aborted', -1)
    assert text == 'replaced by a newer goal; it braked; the arm stands'
    assert second.result()[0] == 'succeeded'
    assert np.abs(front.at() - START).max() < 1e-9
    front.check()


@pytest.mark.invariant(3, 9)
@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_the_end_of_the_process_brakes_the_arm(make: Any, number: signal.Signals) -> None:
    front = make()
    goal = front.peer.goal(trajectory((0.0, START), (LASTS_S, FAR)))
    front.under_way()
    assert front.process.end(number) == 0
    assert goal.result()[2] == 'smooth_goals ends; it braked; the arm stands'
    assert np.abs(front.at() - FAR).max() > 0.1
    front.check()


def cpu_time(process_id: int) -> float:
    """Return the CPU time of a process, s."""
    fields = (
        Path(f'/proc/{process_id}/stat').read_text(encoding='ascii').rpartition(')')[2].split()
    )
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


@pytest.mark.invariant(7, 9)
def test_inv7_inv9_planning_is_bounded_and_ends_with_the_process(make: Any) -> None:
    """docs/invariants.md, 7 and 9."""
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
    assert not front.behind.taken


def goal_from_here(front: Front, lasts: float = LASTS_S) -> Any:
    """Send the arm to the farther one of two poses."""
    here = front.at()
    far = max(START, FAR, key=lambda pose: np.abs(pose - here).max())
    return front.peer.goal(trajectory((0.0, here.tolist()), (lasts, far)))


@pytest.fixture(scope='module')
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Front]:
    front = Front(tmp_path_factory.mktemp('front'), reply_timeout=4.0, state_timeout=4.0)
    yield front
    front.close()


@pytest.fixture
def front(shared: Front) -> Iterator[Front]:
    """One front for tests that leave it as they found it, whatever its driver did."""
    del shared.behind.commanded[:-1]
    shared.behind.taken.clear()
    shared.behind.canceled = 0
    before = dict(vars(shared.behind))
    yield shared
    for name in ('refuses', 'scaling', 'cancels', 'answers_after', 'silent', 'ahead'):
        setattr(shared.behind, name, before[name])


@pytest.mark.invariant(5)
def test_tolerances_and_the_end_are_passed_on(front: Front) -> None:
    path = [JointTolerance(name='joint_1', position=0.05)]
    here = front.at().tolist()
    message = trajectory((0.0, here), (2.0, [*here[:5], here[5] + 0.3]))
    goal = front.peer.goal(
        message, path_tolerance=path, goal_time_tolerance=Duration(sec=1, nanosec=500_000_000)
    )
    front.under_way()
    front.behind.abort(-4, 'Aborted due to path tolerance violation')
    ended, code, text = goal.result()
    assert (ended, code) == ('aborted', -4), text
    assert 'Aborted due to path tolerance violation' in text
    (taken,) = front.behind.taken
    assert taken.path_tolerance == path
    given = taken.goal_time_tolerance.sec + taken.goal_time_tolerance.nanosec * 1e-9
    assert given == pytest.approx(1.5, abs=0.1)  # less what the smooth motion takes longer


@pytest.mark.invariant(5)
def test_a_goal_that_takes_longer_than_its_tolerance_is_refused_before_it_moves(
    front: Front,
) -> None:
    message = trajectory((0.0, front.at().tolist()), (0.2, (front.at() + 0.6).tolist()))
    goal = front.peer.goal(message, goal_time_tolerance=Duration(nanosec=50_000_000))
    ended, code, text = goal.result()
    assert (ended, code) == ('aborted', -5)
    assert 'planned are 0.200 s and goal_time_tolerance is 0.05 s' in text
    assert front.behind.taken == []


@pytest.mark.invariant(1, 5)
@pytest.mark.parametrize(
    ('change', 'code', 'said'),
    [
        ({'names': [*JOINTS[:5], 'joint_7']}, -2, 'joint_7: no position min limit is known'),
        ({'first': 0.1}, -1, '0.1 rad apart, the limit is 0.02 rad'),
        ({'last': 9.0}, -1, 'point 1, joint_6: position 9 rad is outside the limits'),
        ({'last': float('nan')}, -1, 'positions = nan rad is not finite'),
    ],
)
def test_what_cannot_be_done_is_refused_with_a_sentence(
    front: Front, change: dict[str, Any], code: int, said: str
) -> None:
    here = front.at().tolist()
    first = [here[0] + change.get('first', 0.0), *here[1:]]
    last = [*here[:5], change.get('last', here[5])]
    names = change.get('names', JOINTS)
    ended, got, text = front.peer.goal(trajectory((0.0, first), (2.0, last), names=names)).result()
    assert (ended, got) == ('aborted', code), text
    assert said in text
    assert front.behind.taken == []


@pytest.mark.invariant(5, 9)
def test_a_driver_that_refuses_or_answers_late_moves_nothing_later(front: Front) -> None:
    front.behind.refuses = True
    assert 'refused the smooth trajectory' in goal_from_here(front).result()[2]
    front.behind.refuses, front.behind.answers_after = False, 8.0
    text = goal_from_here(front).result()[2]
    assert 'did not answer within 4 s; the goal is canceled should it be taken yet' in text
    front.peer.wait_for(lambda: front.behind.canceled, 'the cancel of what was taken late')
    front.behind.answers_after = 0.0
    begin, end = front.behind.commanded[0][1][0], front.at()
    assert np.abs(end - begin).max() < 0.05


@pytest.mark.invariant(3, 5)
def test_the_stop_is_the_drivers_own_where_it_is_not_in_time(front: Front) -> None:
    front.behind.scaling = 0.5
    goal = goal_from_here(front)
    front.under_way()
    goal.cancel()
    ended, _, text = goal.result()
    assert ended == 'canceled'
    assert text == f'canceled; {ACTION} stopped it; the arm stands'
    assert front.behind.canceled == 1
    assert len(front.behind.taken) == 1  # no second trajectory, which would have jumped


@pytest.mark.invariant(3, 5)
def test_another_clock_behind_is_as_good_as_ours(front: Front) -> None:
    front.behind.ahead = 3_000_000_000
    front.peer.newer(60)
    goal = goal_from_here(front)
    front.under_way()
    goal.cancel()
    assert goal.result()[2] == 'canceled; it braked; the arm stands'


@pytest.mark.invariant(3, 5, 9)
def test_a_cancel_that_is_not_answered_is_said(front: Front) -> None:
    front.behind.scaling, front.behind.cancels = 0.5, False
    goal = goal_from_here(front, lasts=8.0)
    front.under_way()
    goal.cancel()
    ended, _, text = goal.result()
    assert ended == 'canceled'
    assert f'{ACTION} DID NOT ANSWER THE CANCEL; joint_' in text
    assert 'moves at' in text
    front.behind.cancels = True
    front.peer.wait_for(lambda: not np.any(front.behind.commanded[-1][1][1]), 'rest')


@pytest.mark.invariant(3, 6, 9)
def test_an_arm_that_is_not_seen_any_more_is_stopped(front: Front) -> None:
    goal = goal_from_here(front, lasts=20.0)
    front.under_way()
    front.behind.silent = True
    ended, _, text = goal.result()
    assert ended == 'aborted'
    assert f'no position of joint_1 on /{NAME}/controller_state in the last 4 s' in text
    front.peer.wait_for(lambda: not np.any(front.behind.commanded[-1][1][1]), 'rest')
    assert np.abs(front.at() - START).max() > 0.05
    assert np.abs(front.at() - FAR).max() > 0.05


@pytest.mark.invariant(3, 5)
def test_of_goals_in_a_row_the_newest_is_done(front: Front) -> None:
    here = front.at()
    goals = [
        front.peer.goal(trajectory((1.0, (here + offset).tolist())))
        for offset in (0.3, -0.2, 0.1, 0.05)
    ]
    results = [goal.result() for goal in goals]
    assert [ended for ended, _, _ in results] == ['aborted'] * 3 + ['succeeded'], results
    assert np.abs(front.at() - here - 0.05).max() < 1e-9
    front.check()


@pytest.mark.invariant(3, 5, 9)
def test_a_driver_that_is_gone_is_said(make: Any) -> None:
    front = make()
    goal = goal_from_here(front)
    front.under_way()
    front.behind.vanish()
    ended, _, text = goal.result()
    assert ended == 'aborted'
    gone = f'{ACTION} is not served any more; nothing can be sent to its driver; the arm stands'
    assert text == gone
    assert f'nobody serves the action {ACTION}' in goal_from_here(front).result()[2]


@pytest.mark.invariant(3)
def test_a_driver_that_nothing_is_known_of_stops_the_arm_itself(make: Any) -> None:
    front = make(stops='auto')
    front.behind.be_unknown()
    goal = goal_from_here(front)
    front.under_way()
    goal.cancel()
    assert goal.result()[2] == f'canceled; {ACTION} stopped it; the arm stands'
    assert len(front.behind.taken) == 1


@pytest.mark.invariant(3)
def test_a_killed_process_leaves_the_arm_at_the_end_of_its_goal(make: Any) -> None:
    front = make()
    goal_from_here(front, lasts=1.5)
    front.under_way()
    front.process.kill()
    front.peer.wait_for(lambda: np.abs(front.at() - FAR).max() < 1e-9, 'the end')
    front.check()
