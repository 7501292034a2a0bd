# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""smooth_goals without ROS, in virtual time (processes: test/system/test_goals_in_front.py)."""

import asyncio
from contextvars import copy_context
from types import SimpleNamespace

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from builtin_interfaces.msg import Duration, Time
from control_msgs.action import FollowJointTrajectory
from control_msgs.msg import JointTolerance, JointTrajectoryControllerState
from sensor_msgs.msg import JointState
from support.event_loop import now, until

from epson_driver.driver.goal.planning_cancellation import PlanningCancellation
from epson_driver.driver.outcome import End, ErrorCode, GoalRejectedError, Outcome
from epson_driver.motion import Trajectory
from epson_driver.motion.interpolation import Interpolation
from epson_driver.node import downstream, smooth_goals
from epson_driver.node.downstream import ArmState, Downstream, Sent
from epson_driver.node.smooth_goals import TABLE, SmoothGoals
from epson_driver.node.trajectory_messages import (
    duration_in_s,
    trajectory_from_message,
    trajectory_message,
)
from epson_driver.robots import load_robot_model
from epson_driver.robots.limit_files import file_limits

LIMITS = load_robot_model('c3_a601s').limits
NAMES = LIMITS.names
START = [0.0, 0.1, 0.2, 0.0, -0.5, 0.0]
FAR = [1.5, 0.5, -0.3, 0.4, -1.1, 0.6]
CYCLE_S = 0.05
NS = 1_000_000_000
SUCCEEDED = Outcome(End.SUCCEEDED, ErrorCode.SUCCESSFUL, 'Goal reached')


def stamped(kind, seconds):
    sec, nanosec = divmod(round(seconds * NS), NS)
    return kind(sec=sec, nanosec=nanosec)


class Behind:
    """The downstream driver, whose arm follows its commands exactly."""

    name = '/behind/follow_joint_trajectory'
    no_server = f'no server for the action {name}'

    def __init__(self):
        self.available = self.keeps_stamps = self.tells = self.cancels = True
        self.refuses, self.silent, self.scaling = [], None, 1.0
        self.ahead = 0.0
        """Error of its clock, s."""
        self.taken, self.canceled = [], 0
        self.spline, self.begin, self.held = None, 0.0, None

    def elapsed(self):
        """Return the time of the trajectory at the driver's speed scaling, s."""
        return (now() - self.begin) * self.scaling

    def commanded(self):
        """Return positions and velocities now, shape (n,)."""
        if self.spline is None or self.held is not None:
            return np.array(START if self.held is None else self.held), np.zeros(len(NAMES))
        since, last = self.elapsed(), self.spline.times[-1]
        positions, velocities, _ = self.spline.at(min(max(since, 0.0), last))
        return positions, velocities * (since < last)

    def of(self, _limits, _oldest):
        if self.silent is not None:
            raise GoalRejectedError(ErrorCode.INVALID_GOAL, self.silent)
        return self.commanded()

    async def send(self, goal, on_feedback, _timeout):
        if not self.available:
            raise GoalRejectedError(ErrorCode.INVALID_GOAL, 'not available')
        if self.refuses:
            raise GoalRejectedError(ErrorCode.INVALID_GOAL, self.refuses.pop())
        before = self.commanded()[0]
        stamp = goal.trajectory.header.stamp
        self.begin = stamp.sec + stamp.nanosec / NS - self.ahead if stamp.sec else now()
        points = trajectory_from_message(goal.trajectory, NAMES)
        self.spline = Interpolation(
            points.times, points.positions, points.velocities, points.accelerations
        )
        assert np.abs(self.commanded()[0] - before).max() < 1e-6, 'the command has jumped'
        samples = map(self.spline.at, np.linspace(0.0, points.times[-1], 500))
        _, velocities, accelerations = map(np.array, zip(*samples, strict=True))
        assert np.abs(velocities / LIMITS.velocity).max() < 1.001
        assert np.abs(accelerations / LIMITS.acceleration).max() < 1.01
        self.taken.append(goal)
        return AcceptedGoal(self, on_feedback)


class AcceptedGoal:
    """A goal accepted by the downstream driver."""

    def __init__(self, behind, on_feedback):
        self._behind, self._on_feedback = behind, on_feedback
        self.result = asyncio.create_task(self._run())

    async def _run(self):
        behind, spline = self._behind, self._behind.spline
        while behind.spline is spline and behind.held is None:
            if behind.elapsed() > spline.times[-1]:
                return SUCCEEDED
            if behind.tells:
                feedback = FollowJointTrajectory.Feedback(joint_names=list(NAMES))
                feedback.header.stamp = stamped(Time, now() + behind.ahead)
                feedback.desired.time_from_start = stamped(Duration, behind.elapsed())
                feedback.desired.positions = behind.commanded()[0].tolist()
                self._on_feedback(feedback)
            await asyncio.sleep(CYCLE_S)
        return Outcome(End.ABORTED, ErrorCode.INVALID_GOAL, 'replaced or canceled')

    async def cancel(self, _timeout):
        self._behind.canceled += 1
        self._behind.held = self._behind.commanded()[0]
        return self._behind.cancels


class Front:
    """SmoothGoals with the downstream driver `Behind`, and its log."""

    def __init__(self, monkeypatch, **parameters):
        self.logged, self.failures = [], []
        self.behind = Behind()
        values = {row.name: row.default for row in TABLE}
        values |= {'limits_file': 'c3_a601s', 'period': 0.02} | parameters
        self.busy, self.group = False, None

        def logs(text):
            self.logged.append(text)

        logger = SimpleNamespace(info=logs, warning=logs, error=logs)
        node = SimpleNamespace(
            get_logger=lambda: logger,
            get_clock=lambda: SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=now() * NS)),
            create_subscription=self._subscribed,
        )
        for name, stand_in in {
            'declare_rows': lambda *_: values,
            'undeclared': lambda _: ['unknown parameter `leed`'],
            'context_of': lambda _: copy_context(),
            'ArmState': lambda *_: self.behind,
            'Downstream': lambda *_: self.behind,
            'LoopBridge': lambda *_: self,
            'GoalAction': lambda *_: self,
        }.items():
            monkeypatch.setattr(smooth_goals, name, stand_in)
        self.goals = SmoothGoals(node)

    def _subscribed(self, _kind, _topic, callback, *_arguments, **_more):
        self.describe = callback

    def to_loop(self, function, *arguments):
        function(*arguments)

    def failed(self, what, error):
        self.failures.append((what, error))

    def end(self):
        self.failures.append('ended')

    async def results_sent(self, is_busy, *, busy):
        assert (is_busy(), busy) == (False, False)

    async def goal(self, *points, ahead=None, **fields):
        """Send a goal. Return it, its feedback, and a future of its outcome.

        ahead: time from now to its stamp, s.
        """
        times, positions = zip(*points, strict=True)
        message = trajectory_message(Trajectory(NAMES, np.array(times), np.array(positions)))
        if ahead is not None:
            message.header.stamp = stamped(Time, now() + ahead)
        request = FollowJointTrajectory.Goal(trajectory=message, **fields)
        feedback, scope = [], PlanningCancellation()
        handle = SimpleNamespace(request=request, publish_feedback=feedback.append)
        ended = asyncio.get_running_loop().create_future()
        goal = await self.goals._prepare(handle, scope, ended.set_result)
        self.goals.submit(goal)
        return SimpleNamespace(goal=goal, feedback=feedback, ended=ended)

    async def until_moving(self):
        await until(lambda: np.abs(self.behind.commanded()[1]).max() > 0.1)
        await asyncio.sleep(3 * CYCLE_S)

    async def refused(self, *points, **fields):
        """Return the error of a goal that must not move the arm."""
        try:
            reason = (await (await self.goal(*points, **fields)).ended).text
        except GoalRejectedError as refusal:
            reason = str(refusal)
        assert self.behind.taken == []
        return reason


async def test_goal_becomes_a_smooth_motion_with_the_same_end(monkeypatch):
    front, path = Front(monkeypatch), [JointTolerance(name='joint_1', position=0.05)]
    assert 'unknown parameter `leed`' in front.logged
    points = (0.0, START), (0.7, np.mean([START, FAR], axis=0)), (1.2, FAR)
    sent = await front.goal(*points, path_tolerance=path, goal_time_tolerance=Duration(sec=2))
    assert await sent.ended == SUCCEEDED
    assert np.abs(front.behind.commanded()[0] - FAR).max() < 1e-9
    assert sent.feedback[-1].joint_names == list(NAMES)
    (taken,) = front.behind.taken
    assert all(len(point.accelerations) == 6 for point in taken.trajectory.points)
    assert taken.path_tolerance == path
    later = front.behind.spline.times[-1] - 1.2
    assert duration_in_s(taken.goal_time_tolerance) == pytest.approx(2.0 - later)


@pytest.mark.invariant(10)
async def test_inv10_time_optimal_motion_is_as_slow_as_the_plan_was_scaled(monkeypatch):
    front = Front(monkeypatch, timing='time_optimal')
    assert await (await front.goal((9.0, FAR))).ended == SUCCEEDED
    assert 6.0 < front.behind.spline.times[-1] < 9.5


@pytest.mark.invariant(2, 3, 5)
@pytest.mark.parametrize('ahead', [0.0, 3.0])
async def test_cancel_brakes_on_the_path_without_a_jump(monkeypatch, ahead):
    front = Front(monkeypatch)
    front.behind.ahead = ahead
    sent = await front.goal((0.0, START), (6.0, FAR))
    await front.until_moving()
    front.goals.cancel(sent.goal)
    outcome = await sent.ended
    assert outcome.end is End.CANCELED
    assert outcome.text == 'canceled, it braked, the arm is at rest'
    assert np.abs(front.behind.commanded()[0] - FAR).max() > 0.1
    assert (len(front.behind.taken), front.behind.canceled) == (2, 0)


@pytest.mark.invariant(3, 5)
async def test_newer_goal_starts_after_braking(monkeypatch):
    front = Front(monkeypatch, stops='brake')
    first = await front.goal((0.0, START), (6.0, FAR))
    await front.until_moving()
    second = await front.goal((3.0, START))
    outcome = await first.ended
    assert outcome.end is End.ABORTED
    assert outcome.text == 'replaced by a newer goal, it braked, the arm is at rest'
    assert await second.ended == SUCCEEDED
    assert np.abs(front.behind.commanded()[0] - START).max() < 1e-9


@pytest.mark.invariant(3, 5)
@pytest.mark.parametrize(
    ('parameters', 'behind', 'ending'),
    [
        ({'stops': 'cancel'}, {}, 'stopped it, the arm is at rest'),
        ({}, {'keeps_stamps': False}, 'stopped it, the arm is at rest'),
        ({}, {'tells': False}, 'stopped it, the arm is at rest'),
        ({}, {'refuses': ['no stop']}, 'stopped it, the arm is at rest'),
        ({}, {'scaling': 0.5}, 'stopped it, the arm is at rest'),
        ({}, {'cancels': False, 'tells': False}, 'DID NOT ANSWER THE CANCEL, the arm is at rest'),
    ],
)
async def test_goal_is_canceled_downstream_if_braking_is_impossible(
    monkeypatch, parameters, behind, ending
):
    front = Front(monkeypatch, **parameters)
    sent = await front.goal((0.0, START), (6.0, FAR))
    await front.until_moving()
    for name, value in behind.items():
        setattr(front.behind, name, value)
    await asyncio.sleep(1.0)
    front.goals.cancel(sent.goal)
    outcome = await sent.ended
    assert outcome.end is End.CANCELED
    assert outcome.text == f'canceled, {front.behind.name} {ending}'
    assert front.behind.canceled == 1
    assert any('was not smooth' in text for text in front.logged)


async def test_goal_waits_for_a_driver_that_is_discovered_after_it(monkeypatch):
    front = Front(monkeypatch)
    front.behind.available = False
    sent = await front.goal((0.0, START), (3.0, FAR))
    await asyncio.sleep(smooth_goals.REST_TIMEOUT_S / 2)
    assert not sent.ended.done()
    front.behind.available = True
    assert await sent.ended == SUCCEEDED
    front.behind.available = False
    assert (await (await front.goal((1.0, FAR))).ended).text == front.behind.no_server


@pytest.mark.invariant(5, 6)
async def test_arm_with_unknown_state_is_stopped(monkeypatch):
    front = Front(monkeypatch)
    sent = await front.goal((0.0, START), (6.0, FAR))
    await front.until_moving()
    front.behind.silent = 'joint_1 is unknown'
    expected = 'joint_1 is unknown, it braked, whether the arm is at rest is unknown'
    assert (await sent.ended).text == expected
    front.behind.silent = None
    again = await front.goal((6.0, FAR))
    await front.until_moving()
    front.behind.available = front.behind.tells = False
    await asyncio.sleep(1.0)
    assert 'has no server any more, its driver is not reachable' in (await again.ended).text


@pytest.mark.invariant(4, 5)
async def test_inv4_inv5_goal_waits_for_its_stamp_and_can_be_canceled(monkeypatch):
    """docs/invariants.md, 4 and 5."""
    front = Front(monkeypatch)
    start = now()
    sent = await front.goal((0.0, START), (1.2, FAR), ahead=0.9)
    await until(lambda: front.behind.taken)
    assert now() - start >= 0.9
    assert await sent.ended == SUCCEEDED
    waiting = await front.goal((1.2, START), ahead=0.9)
    await asyncio.sleep(0.5)
    front.goals.cancel(waiting.goal)
    assert (await waiting.ended).text == 'canceled'
    await asyncio.sleep(1.0)
    assert len(front.behind.taken) == 1
    late = await front.goal((1.2, START), ahead=-0.5)
    assert 's after its header.stamp' in (await late.ended).text
    with pytest.raises(GoalRejectedError, match='in the future'):
        await front.goal((1.2, FAR), ahead=1.5)


async def test_cancel_near_the_end_lets_the_goal_finish(monkeypatch):
    front = Front(monkeypatch)
    sent = await front.goal((0.0, START), (3.0, FAR))
    await front.until_moving()
    spline = front.behind.spline
    await until(lambda: now() - front.behind.begin > spline.times[-1] - 0.08)
    front.goals.cancel(sent.goal)
    assert (await sent.ended).text == 'canceled, it had ended, the arm is at rest'


@pytest.mark.invariant(1, 5)
async def test_invalid_goal_is_rejected_and_moves_nothing(monkeypatch):
    front = Front(monkeypatch)
    elsewhere = [*START[:5], 0.5]
    assert 'joint_6' in await front.refused((0.0, elsewhere), (1.0, FAR))
    assert 'joint_1' in await front.refused((1.0, [50.0, *START[1:]]))
    short = Duration(nanosec=1)
    assert 's within the limits, but the goal plans' in await front.refused(
        (0.0, START), (0.05, FAR), goal_time_tolerance=short
    )
    front.behind.silent = 'joint_1 is unknown'
    reason = await front.refused((1.0, FAR))
    assert reason == 'joint_1 is unknown: a goal must start with the arm at rest'
    front.behind.silent = None
    monkeypatch.setattr(front.behind, 'commanded', lambda: (np.array(START), np.full(6, 0.5)))
    assert 'joint_1 moves at 0.5 /s' in await front.refused((1.0, FAR))


async def test_limits_come_from_robot_description_and_missing_ones_are_assumed(monkeypatch):
    front = Front(monkeypatch, limits_file='')
    assert 'joint_1: no position min limit: ' in await front.refused((1.0, FAR))
    front.describe(SimpleNamespace(data='<robot'))
    assert any('robot_description is not used' in text for text in front.logged)
    joint = '<joint name="{}" type="revolute"><parent link="a"/><child link="b"/>' + (
        '<limit lower="-3" upper="3" velocity="2" effort="1"/></joint>'
    )
    whole = f'<robot>{"".join(map(joint.format, NAMES))}</robot>'
    front.describe(SimpleNamespace(data=whole))
    assert await (await front.goal((0.0, START), (3.0, FAR))).ended == SUCCEEDED
    assert sum('unknown limit, assuming' in text for text in front.logged) == 12


@pytest.mark.invariant(2, 10)
async def test_inv10_changed_limits_end_the_goal_and_reject_the_next(monkeypatch):
    front = Front(monkeypatch, limits_file='')
    joint = '<joint name="joint_1" type="revolute"><limit lower="-3" upper="3" {}/></joint>'

    def describe(limit, front=front):
        front.describe(SimpleNamespace(data=f'<robot>{joint.format(limit)}</robot>'))

    front.goals._filed = dict(zip(NAMES[1:], file_limits('c3_a601s').values(), strict=False))
    describe('velocity="2"')
    describe('velocity="2.0"')
    sent = await front.goal((0.0, START), (6.0, FAR))
    await front.until_moving()
    describe('velocity="50"')
    describe('velocity="60"')
    why = 'robot_description gives two values for joint_1, velocity: 2.0 and 50.0'
    assert (await sent.ended).text.startswith(why)
    with pytest.raises(GoalRejectedError, match=why):
        await front.goal((6.0, START))
    assert sum(why in text for text in front.logged) == 1
    filed = Front(monkeypatch)  # a file's limits stay
    describe('', filed)
    describe('velocity="9"', filed)
    assert await (await filed.goal((0.0, START), (3.0, FAR))).ended == SUCCEEDED


@pytest.mark.invariant(5)
async def test_shutdown_brakes_the_goal_and_rejects_new_ones(monkeypatch):
    front = Front(monkeypatch)
    sent = await front.goal((0.0, START), (6.0, FAR))
    await front.until_moving()
    await front.goals.shut_down()
    assert (await sent.ended).text == 'smooth_goals ends, it braked, the arm is at rest'
    assert (await (await front.goal((1.0, START))).ended).text == 'smooth_goals ends'
    front.goals.end()
    assert front.failures == ['ended']


@pytest.mark.invariant(9)
async def test_exception_while_forwarding_feedback_is_reported(monkeypatch):
    front = Front(monkeypatch)
    sent = await front.goal((0.0, START), (1.0, FAR))
    sent.goal.on_feedback = lambda _feedback: 1 / 0
    await sent.ended
    assert front.failures[0][0] == 'passing feedback on'


# --- the downstream driver's ROS interface ------------------------------------------------------


class Answer:
    """A completed future of rclpy."""

    def __init__(self, value=None, error=None):
        self._value, self._error = value, error

    def add_done_callback(self, callback):
        callback(self)

    def exception(self):
        return self._error

    def result(self):
        return self._value


@pytest.mark.invariant(10)
async def test_joint_states_are_used_only_if_the_driver_has_no_state_of_its_own():
    topics, publishers = {}, []
    node = SimpleNamespace(
        create_subscription=lambda _kind, topic, callback, *_, **__: topics.update(
            {topic: callback}
        ),
        count_publishers=publishers.count,
    )
    driver = SimpleNamespace(name='/jtc/follow_joint_trajectory', available=False)
    arm = ArmState(node, driver, None)

    def joint_1():
        return arm.of(LIMITS, 1.0)[0][0]

    async def refused_for(seconds):
        for _ in range(10):
            with pytest.raises(GoalRejectedError, match='no publisher of /jtc/controller_state'):
                joint_1()
            await asyncio.sleep(seconds / 10)
        topics['joint_states'](JointState(name=NAMES, position=[0.1] * 6))

    await refused_for(5.0)
    driver.available = True
    await refused_for(downstream.OWN_TOPIC_S)
    assert joint_1() == 0.1
    publishers.append('/jtc/controller_state')
    with pytest.raises(GoalRejectedError, match='no position of joint_1 on /jtc/controller_state'):
        joint_1()
    message = JointTrajectoryControllerState(joint_names=NAMES)
    message.feedback.positions = [0.2] * 6
    topics['/jtc/controller_state'](message)
    assert joint_1() == 0.2


QUERY = ('/jtc/query_state', ['some/type'])


def client(monkeypatch, *, ready=True, services=(QUERY,), **requests):
    """Return a Downstream whose action client handles requests by these functions."""
    action = SimpleNamespace(server_is_ready=lambda: ready, **requests)
    monkeypatch.setattr(downstream, 'ActionClient', lambda *_, **__: action)
    node = SimpleNamespace(
        resolve_topic_name=lambda name: f'/{name}',
        executor=SimpleNamespace(create_task=lambda work: work()),
        get_service_names_and_types=lambda: services,
    )
    return Downstream(node, 'jtc/follow', None)


async def test_missing_downstream_server_and_its_rejection_are_reported(monkeypatch):
    assert client(monkeypatch).keeps_stamps
    assert not client(monkeypatch, services=()).keeps_stamps
    with pytest.raises(GoalRejectedError, match='no server for the action /jtc/follow'):
        await client(monkeypatch, ready=False).send(None, None, 1.0)
    no = Answer(SimpleNamespace(accepted=False))
    with pytest.raises(GoalRejectedError, match='rejected the smooth trajectory'):
        await client(monkeypatch, send_goal_async=lambda *_: no).send(None, None, 1.0)
    broken = client(monkeypatch, send_goal_async=lambda *_: Answer(error=OSError('x')))
    with pytest.raises(OSError, match='x'):
        await broken.send(None, None, 1.0)
    with pytest.raises(ZeroDivisionError):
        await broken.request_result(lambda: 1 / 0)


async def test_goal_that_the_downstream_driver_accepts_late_is_canceled(monkeypatch, caplog):
    waiting, canceled = [], []
    late = SimpleNamespace(add_done_callback=waiting.append)
    behind = client(monkeypatch, send_goal_async=lambda *_: late)
    with pytest.raises(GoalRejectedError, match='did not reply within 1 s'):
        await behind.send(None, None, 1.0)

    def cancel():
        canceled.append(True)
        return Answer()

    waiting[0](Answer(SimpleNamespace(accepted=True, cancel_goal_async=cancel)))
    await until(lambda: canceled)
    await asyncio.sleep(0.1)
    assert 'accepted a goal too late' in caplog.text


@pytest.mark.parametrize(
    ('status', 'code', 'text', 'expected'),
    [
        (GoalStatus.STATUS_SUCCEEDED, 0, 'done', (End.SUCCEEDED, 0, 'done')),
        (GoalStatus.STATUS_CANCELED, 0, '', (End.ABORTED, 0, 'goal: without a reason')),
        (GoalStatus.STATUS_ABORTED, 77, 'x', (End.ABORTED, -1, 'goal: x (error code 77)')),
    ],
)
async def test_result_of_the_downstream_driver_is_forwarded(
    monkeypatch, status, code, text, expected
):
    result = SimpleNamespace(error_code=code, error_string=text)
    handle = SimpleNamespace(
        get_result_async=lambda: Answer(SimpleNamespace(status=status, result=result)),
        cancel_goal_async=Answer,
    )
    sent = Sent(client(monkeypatch), handle)
    assert await sent.cancel(1.0)
    outcome = await sent.result
    end, number, ending = expected
    assert (outcome.end, int(outcome.code)) == (end, number)
    assert outcome.text.endswith(ending)
    silent = SimpleNamespace(add_done_callback=lambda _callback: None)
    handle.cancel_goal_async = lambda: silent
    assert not await sent.cancel(1.0)
