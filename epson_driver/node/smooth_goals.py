# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A node that smooths FollowJointTrajectory goals and forwards them to another driver.

The other driver is called the downstream driver. It may be any driver with this action.

1. A goal starts at the arm's position, which is read from the downstream driver's
   `controller_state`, or from `joint_states` if the driver has no such topic. The smooth motion is
   planned as a whole and sent as one trajectory.
2. Feedback, result and tolerances are forwarded. If the smooth motion takes longer than planned,
   the difference is subtracted from goal_time_tolerance.
3. A goal is abandoned if it is canceled, if a newer goal arrives, or when this process ends. The
   newer goal starts when the arm is at rest.
4. A joint_trajectory_controller replaces its trajectory immediately. If the new trajectory has a
   header.stamp in the past, it continues at the point that is due now. With such a downstream
   driver, a second trajectory stops a goal smoothly. It has the start time of the first
   trajectory, which is known from feedback. Up to a time slightly ahead it equals the first
   trajectory, and then it brakes within the limits. If it is accepted before that time, the
   commanded position does not jump.
5. With any other driver, or if feedback does not show the start time, the goal is canceled, and
   the downstream driver determines how the arm stops.
6. The first trajectory has no stamp, so a goal that is accepted late starts late.
"""

import asyncio
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from math import ceil
from typing import Any

import numpy as np
from builtin_interfaces.msg import Duration, Time
from control_msgs.action import FollowJointTrajectory
from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node
from std_msgs.msg import String

from epson_driver.driver.goal.goal import check_start, late_start, listed, untimed
from epson_driver.driver.goal.planning_cancellation import PlanningCancellation, PlanningEndedError
from epson_driver.driver.outcome import End, ErrorCode, GoalRejectedError, Outcome
from epson_driver.driver.smoothing import ON_SPLINE
from epson_driver.driver.tasks import report_error
from epson_driver.inputs import InputError
from epson_driver.motion import Array, JointLimits, Trajectory, problems
from epson_driver.motion.interpolation import Interpolation
from epson_driver.motion.plan_share import plan_share
from epson_driver.motion.smoothed import MAX_STEP_S, retimed, time_optimal
from epson_driver.node import messages
from epson_driver.node.downstream import ArmState, Downstream, Sent
from epson_driver.node.loop_bridge import CANCELED, LATCHED, GoalAction, LoopBridge, OnEnd
from epson_driver.node.parameters import declare_rows, undeclared
from epson_driver.node.ros_process import context_of
from epson_driver.node.stoppable import StoppableMotion
from epson_driver.node.trajectory_messages import (
    check_unsupported,
    duration_in_s,
    duration_message,
    invalid_goal,
    start_time,
    trajectory_from_message,
    trajectory_message,
)
from epson_driver.robots.limit_files import Rows, file_limits, limits_of, urdf_limits
from epson_driver.setup.table import PLAN_SCALING, Row

TABLE = (
    Row(
        'action',
        'follow_joint_trajectory',
        'Action of the downstream driver, such as '
        '/joint_trajectory_controller/follow_joint_trajectory.',
    ),
    Row(
        'limits_file',
        '',
        "Joint limits that override the URDF on robot_description: MoveIt's joint_limits.yaml, or "
        'a robot model of this package (empty: the URDF only).',
    ),
    Row(
        'acceleration_ratio',
        5.0,
        'Default of unknown acceleration limits, as a multiple of the velocity limit [1/s].',
        0.1,
        1000.0,
    ),
    Row(
        'jerk_ratio',
        10.0,
        'Default of unknown jerk limits, as a multiple of the acceleration limit [1/s].',
        0.1,
        1000.0,
    ),
    Row(
        'timing',
        'as_planned',
        'Timing of trajectories. as_planned: the times of the points, or later where the limits '
        'require it. time_optimal: as fast as the limits allow.',
        choices=('as_planned', 'time_optimal'),
    ),
    PLAN_SCALING,
    Row(
        'period',
        0.008,
        'Maximum time between forwarded points [s]. Where the jerk changes, more points are sent.',
        0.001,
        1.0,
    ),
    Row(
        'stops',
        'auto',
        'Stop of a running goal. brake: a stop within the limits, sent as another trajectory, '
        'for joint_trajectory_controller and drivers that replace trajectories like it. cancel: '
        'the stop of the downstream driver. auto: brake if the action has the query_state '
        'service of joint_trajectory_controller.',
        choices=('auto', 'brake', 'cancel'),
    ),
    Row(
        'lead',
        0.1,
        'With brake: time from sending a stop to its start, longer than the message delay [s].',
        0.02,
        1.0,
    ),
    Row(
        'start_tolerance',
        0.02,
        'Maximum distance of each joint from the arm to the start of a trajectory [rad, m].',
        0.0,
        1.0,
    ),
    Row(
        'stopped_velocity_tolerance',
        0.02,
        'Velocity below which a joint counts as stopped [rad/s, m/s].',
        1e-6,
        10.0,
    ),
    Row(
        'state_timeout',
        1.0,
        'Joint state timeout, after which a goal is stopped [s].',
        0.2,
        60.0,
    ),
    Row('reply_timeout', 2.0, 'Reply timeout of the downstream driver [s].', 0.05, 60.0),
)

DEFAULT_NAME = 'smooth_goals'

NS_PER_S = 1_000_000_000

REST_TIMEOUT_S = 2.0
"""Maximum time for which a goal waits for the driver, its state and the arm's standstill, s."""

WATCH_PERIOD_S = 0.1

MAX_FEEDBACK_AGE_S = 0.5
"""Maximum age of feedback that shows the progress of the motion, s."""

FEEDBACKS = 2
"""Number of feedback messages after which the start time is known."""

FEEDBACK_TIMEOUT_S = 0.25
"""Maximum time for which a stop waits for FEEDBACKS messages, s. 20 messages arrive per second."""

OFF_S, OFF = 1e-3, 1e-4
"""Maximum deviations of feedback from the sent motion. OFF_S applies to the start time, s. OFF,
plus the distance that the joint moves in OFF_S at full speed, applies to the commanded position,
rad or m."""

SHUT_DOWN_TIMEOUT_S = 6.0


@dataclass(eq=False)
class ForwardedGoal:
    """A goal from ROS that is forwarded to the downstream driver.

    * start: earliest start time on the loop's clock, s, or 0 to start immediately.
    * planned: the received plan, if `trajectory` has other times, as in Goal.
    * why: the outcome of an abandoned goal, else None.
    """

    request: FollowJointTrajectory.Goal
    trajectory: Trajectory
    limits: JointLimits
    start: float
    on_feedback: Callable[[FollowJointTrajectory.Feedback], None]
    on_end: OnEnd
    scope: PlanningCancellation
    planned: Trajectory | None = None
    abandoned: asyncio.Event = field(default_factory=asyncio.Event)
    why: Outcome | None = None

    def abandon(self, why: Outcome) -> None:
        self.why = self.why or why
        self.scope.end(why.text)
        self.abandoned.set()


@dataclass(eq=False)
class SentMotion:
    """The motion that was sent for a goal, and its progress according to feedback.

    * start: start of the motion, ns on the downstream driver's clock.
    * stamp: time of the last feedback, ns on the same clock.
    * arrival: arrival of that feedback, s on the loop's clock.
    * follows: whether the commanded position in that feedback matches the motion.
    """

    goal: ForwardedGoal
    motion: StoppableMotion
    points: Trajectory
    start: int = 0
    stamp: int = 0
    arrival: float = -np.inf
    follows: bool = False
    feedbacks: int = 0
    known: asyncio.Event = field(default_factory=asyncio.Event)

    def __post_init__(self) -> None:
        """Prepare the interpolation that joint_trajectory_controller uses between the points."""
        sent = self.points
        self.spline = Interpolation(
            sent.times, sent.positions, sent.velocities, sent.accelerations
        )

    def update(self, stamp: int, passed: int, names: list[str], desired: Array) -> None:
        """Process feedback.

        * stamp: time of the feedback, ns on the downstream driver's clock.
        * passed: time since the start of the motion, ns, according to the feedback.
        * desired: commanded positions of the joints `names`, rad or m.
        """
        limits, start = self.goal.limits, stamp - passed
        if {*names} != {*limits.names} or len(names) != len(desired):
            return
        time = min(max(passed / NS_PER_S, 0.0), self.points.duration)
        commanded = desired[[names.index(name) for name in limits.names]]
        off = np.abs(commanded - self.spline.at(time)[0])
        same = abs(start - self.start) <= OFF_S * NS_PER_S
        self.follows = bool(same and np.all(off <= OFF_S * limits.velocity + OFF))
        self.start, self.stamp, self.arrival = start, stamp, asyncio.get_running_loop().time()
        self.feedbacks += 1
        if self.feedbacks >= FEEDBACKS:
            self.known.set()
        self.motion.follow(time)

    def passed(self) -> float | None:
        """Return the elapsed time of the motion, s, or None if it is unknown.

        The result is too small by the transmission time of the feedback.
        """
        age = asyncio.get_running_loop().time() - self.arrival
        if not self.follows or age > MAX_FEEDBACK_AGE_S:
            return None
        return (self.stamp - self.start) / NS_PER_S + age


class SmoothGoals:
    """Connects an rclpy node with the downstream driver. Must be created in the event loop."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._logger = node.get_logger()
        self._loop = asyncio.get_running_loop()
        self._context = context_of(self._logger)
        self._parameters = values = declare_rows(node, TABLE)
        for sentence in undeclared(node):
            self._logger.warning(sentence)
        self._described: Rows = {}
        self._contradicted: dict[str, str] = {}
        """Why the limits of a joint are unknown (two robot descriptions differ), by joint name."""
        self._filed = file_limits(values['limits_file']) if values['limits_file'] else {}
        self._assumed: set[str] = set()
        self._goals: list[ForwardedGoal] = []
        self._last: asyncio.Task[None] | None = None
        self._ending: Outcome | None = None
        self._bridge = LoopBridge(node, self._context, self._abandon_all, 'stopping all goals')
        group = self._bridge.group
        node.create_subscription(
            String, 'robot_description', self._on_description, LATCHED, callback_group=group
        )
        self._downstream = Downstream(node, values['action'], group)
        self._arm = ArmState(node, self._downstream, group)
        self._action = GoalAction(
            self._bridge,
            self,
            FollowJointTrajectory,
            '~/follow_joint_trajectory',
            self._prepare,
            messages.result,
        )
        self._logger.info(f'smooth goals are sent to {self._downstream.name}')

    # --- the process ------------------------------------------------------------------------

    async def run(self) -> None:
        await asyncio.Event().wait()

    async def shut_down(self) -> None:
        busy = self._action.busy
        self._abandon_all('smooth_goals ends')
        self._ending = _aborted('smooth_goals ends')
        if self._last is not None:
            await asyncio.wait({self._last}, timeout=SHUT_DOWN_TIMEOUT_S)
        await self._bridge.results_sent(lambda: self._action.busy, busy=busy)

    def end(self) -> None:
        self._bridge.end()

    # --- from ROS: these run in the executor's thread ---------------------------------------

    def _on_description(self, message: String) -> None:
        try:
            described = urdf_limits(message.data)
        except InputError as error:
            self._logger.error(f'robot_description is not used: {error}')
            return
        for name, row in described.items():
            known, filed = self._described.setdefault(name, row), self._filed.get(name, {})
            for key in sorted({*known, *row} - {*filed}):
                if known.get(key) != row.get(key) and name not in self._contradicted:
                    self._contradicted[name] = why = (
                        f'robot_description gives two values for {name}, {key}: '
                        f'{known.get(key)} and {row.get(key)}. Stop the wrong publisher, then '
                        'restart smooth_goals'
                    )
                    self._logger.error(why)
                    self._bridge.to_loop(self._abandon_all, why)

    async def _prepare(
        self, ros_handle: ServerGoalHandle, scope: PlanningCancellation, on_end: OnEnd
    ) -> ForwardedGoal:
        request = ros_handle.request
        check_unsupported(request)
        trajectory = trajectory_from_message(request.trajectory, request.trajectory.joint_names)
        names = trajectory.joint_names
        if why := next(filter(None, map(self._contradicted.get, names)), None):
            raise GoalRejectedError(ErrorCode.INVALID_JOINTS, why)
        rows = {name: self._described.get(name, {}) | self._filed.get(name, {}) for name in names}
        ratios = (self._parameters['acceleration_ratio'], self._parameters['jerk_ratio'])
        try:
            limits, assumed = limits_of(names, rows, ratios)
        except InputError as error:
            raise GoalRejectedError(ErrorCode.INVALID_JOINTS, str(error)) from error
        for sentence in assumed:
            if sentence not in self._assumed:
                self._logger.warning(f'unknown limit, assuming {sentence}')
        self._assumed |= {*assumed}
        planned = None
        if self._parameters['timing'] == 'time_optimal':
            planned = trajectory if self._parameters['plan_scaling'] else None
            trajectory = untimed(trajectory, limits)
        positions = limits.settled(trajectory.positions)
        trajectory = Trajectory(names, trajectory.times, positions)
        if result := list(problems(trajectory, limits, too_fast=False)):
            raise invalid_goal(listed(result))
        stamp, clock = request.trajectory.header.stamp, self._node.get_clock()
        start = start_time(stamp, trajectory.duration, clock, self._loop.time)
        on_feedback = ros_handle.publish_feedback
        return ForwardedGoal(
            request, trajectory, limits, start, on_feedback, on_end, scope, planned
        )

    def _on_feedback(
        self, sent_motion: SentMotion, feedback: FollowJointTrajectory.Feedback
    ) -> None:
        try:
            sent_motion.goal.on_feedback(feedback)
            self._bridge.to_loop(
                sent_motion.update,
                _ns(feedback.header.stamp),
                _ns(feedback.desired.time_from_start),
                list(feedback.joint_names),
                np.array(feedback.desired.positions),
            )
        except Exception as error:  # noqa: BLE001 - it is logged, and stops the arm
            self._bridge.failed('passing feedback on', error)

    # --- in the loop's thread ---------------------------------------------------------------

    def cancel(self, goal: ForwardedGoal) -> None:
        goal.abandon(replace(CANCELED, text='canceled'))

    def _abandon_all(self, why: str) -> None:
        for goal in self._goals:
            goal.abandon(_aborted(why))

    def submit(self, goal: ForwardedGoal) -> None:
        if goal.scope.why is not None or self._ending is not None:
            goal.on_end(self._ending or CANCELED)
            return
        self._abandon_all('replaced by a newer goal')
        self._goals.append(goal)
        work = self._execute(goal, self._last)
        self._last = self._loop.create_task(work, context=self._context)

    async def _execute(self, goal: ForwardedGoal, before: 'asyncio.Task[None] | None') -> None:
        outcome = _aborted('internal error of smooth_goals, see its log')
        try:
            if before is not None:
                await asyncio.wait({before})
            outcome = goal.why or await self._outcome(goal)
        except GoalRejectedError as error:
            outcome = error.outcome
        except PlanningEndedError:
            outcome = goal.why or CANCELED
        except Exception as error:  # noqa: BLE001 - it is reported, and ends the process
            report_error('executing a goal failed', error)
        finally:
            self._goals.remove(goal)
            goal.on_end(outcome)

    async def _outcome(self, goal: ForwardedGoal) -> Outcome:
        age = self._parameters['state_timeout']
        if (
            problem := await self._wait_until_solved(partial(self._cannot_start, goal))
        ) is not None:
            raise invalid_goal(problem)
        start = goal.limits.settled(self._arm.of(goal.limits, age)[0])
        tolerance = self._parameters['start_tolerance']
        check_start(goal.trajectory, start, goal.limits, tolerance)
        try:
            motion, points, remark = await goal.scope.in_thread(
                partial(self._planned, goal, start)
            )
        except ValueError as error:
            raise invalid_goal(str(error)) from error
        with suppress(TimeoutError):
            await asyncio.wait_for(goal.abandoned.wait(), max(goal.start - self._loop.time(), 0.0))
        goal.scope.check()
        moved = np.abs(self._arm.of(goal.limits, age)[0] - start).max()
        if moved > tolerance:
            raise invalid_goal(f'the arm moved by {moved:.3g} while the goal was planned')
        sent_motion = SentMotion(goal, motion, points)
        request = _request(goal.request, _goal_time(goal, motion.motion.duration))
        late = late_start(goal.start, self._loop.time())
        sent = await self._send(sent_motion, sent_motion.points, request)
        end = await self._watched(sent_motion, sent, duration_in_s(request.goal_time_tolerance))
        return replace(end, text=end.text + late + remark)

    @property
    def _brakes(self) -> bool:
        stops = self._parameters['stops']
        return bool(stops == 'brake' or (stops == 'auto' and self._downstream.keeps_stamps))

    def _planned(
        self, goal: ForwardedGoal, start: Array, checkpoint: Callable[[], None]
    ) -> tuple[StoppableMotion, Trajectory, str]:
        """Return the smooth motion from rest at `start`, shape (n,), its points, and a remark."""
        planned = goal.trajectory
        times, positions = planned.times, planned.positions.copy()
        if times[0] > 0.0 or len(times) == 1:
            times = np.concatenate([[0.0], np.maximum(times, MAX_STEP_S)])
            positions = np.vstack([start, positions])
        positions[0] = start
        whole = Trajectory(planned.joint_names, times, positions)
        limits = goal.limits
        if goal.planned is not None:
            limits = limits.scaled(*plan_share(goal.planned, start, limits))
        remark = ''
        if self._parameters['timing'] == 'time_optimal':
            found = time_optimal(whole, limits, checkpoint=checkpoint)
            remark = ON_SPLINE if found is None else ''
            whole = found or retimed(whole, limits)
        motion = StoppableMotion(whole, limits, checkpoint)
        return motion, motion.points(self._parameters['period']), remark

    async def _send(
        self, sent_motion: SentMotion, points: Trajectory, request: FollowJointTrajectory.Goal
    ) -> Sent:
        request.trajectory.joint_names = list(points.joint_names)
        request.trajectory.points = trajectory_message(points).points
        timeout = self._parameters['reply_timeout']
        return await self._downstream.send(
            request, partial(self._on_feedback, sent_motion), timeout
        )

    async def _watched(self, sent_motion: SentMotion, sent: Sent, goal_time: float) -> Outcome:
        goal = sent_motion.goal
        abandoned = self._loop.create_task(goal.abandoned.wait())
        lost = self._loop.create_task(self._lost(sent_motion, goal_time))
        try:
            either: set[asyncio.Task[Any]] = {sent.result, abandoned, lost}
            await asyncio.wait(either, return_when=asyncio.FIRST_COMPLETED)
            if sent.result.done():
                return sent.result.result()
            why = goal.why or _aborted(lost.result())
            stopped = await self._stopped(sent_motion, sent, why.text)
            return replace(why, text=f'{why.text}, {stopped}')
        except Exception:
            await sent.cancel(self._parameters['reply_timeout'])
            raise
        finally:
            for task in (abandoned, lost, sent.result):
                task.cancel()

    async def _lost(self, sent_motion: SentMotion, goal_time: float) -> str:
        values = self._parameters
        timeout = sent_motion.points.duration + goal_time + values['reply_timeout']
        latest = self._loop.time() + timeout
        while self._downstream.available:
            try:
                self._arm.of(sent_motion.goal.limits, values['state_timeout'])
            except GoalRejectedError as error:
                return str(error)
            if goal_time > 0.0 and self._loop.time() > latest:
                return f'{self._downstream.name} gave no result within {timeout:.3g} s'
            await asyncio.sleep(WATCH_PERIOD_S)
        return f'{self._downstream.name} has no server any more'

    async def _stopped(self, sent_motion: SentMotion, sent: Sent, why: str) -> str:
        how = await self._braked(sent_motion, sent)
        if how is None:
            how = f'{self._downstream.name} stopped it'
            if not self._downstream.available:
                how = 'its driver is not reachable'
            elif not await sent.cancel(self._parameters['reply_timeout']):
                how = f'{self._downstream.name} DID NOT ANSWER THE CANCEL'
            self._logger.warning(f'the stop of a goal was not smooth: {how}')
        problem = await self._wait_until_solved(partial(self._not_at_rest, sent_motion.goal))
        if problem == why:  # no state of the arm, before and after
            problem = 'whether the arm is at rest is unknown'
        return f'{how}, {problem or "the arm is at rest"}'

    async def _braked(self, sent_motion: SentMotion, sent: Sent) -> str | None:
        """Stop the arm with a second trajectory.

        Return a text that describes this stop, or None if the stop fails.
        """
        if not self._brakes:
            return None
        with suppress(TimeoutError):  # the motion may have just started
            await asyncio.wait_for(sent_motion.known.wait(), FEEDBACK_TIMEOUT_S)
        if (passed := sent_motion.passed()) is None:
            return None
        values, sent_at = self._parameters, self._loop.time()
        stop_time = ceil((passed + values['lead']) / MAX_STEP_S) * MAX_STEP_S
        timeout = values['reply_timeout'] + 2.0 * values['lead']
        if stop_time >= sent_motion.points.duration:  # the motion ends as early without a stop
            done, _ = await asyncio.wait({sent.result}, timeout=timeout)
            return 'it had ended' if done else None
        try:
            start = passed - 2.0 * values['period']
            rest = sent_motion.motion.stopped(stop_time, values['period'], start)
        except ValueError as error:
            self._logger.error(f'no smooth stop: {error}')
            return None
        request = FollowJointTrajectory.Goal(
            path_tolerance=sent_motion.goal.request.path_tolerance
        )
        sec, nanosec = divmod(sent_motion.start, NS_PER_S)
        request.trajectory.header.stamp = Time(sec=sec, nanosec=nanosec)
        try:
            braking = await self._send(sent_motion, rest, request)
        except GoalRejectedError as error:
            self._logger.error(f'no smooth stop: {error}')
            return None
        if self._loop.time() - sent_at > stop_time - passed:
            self._logger.error('a stop was accepted late: the commanded position may have jumped')
        timeout += rest.duration - passed
        done, _ = await asyncio.wait({braking.result}, timeout=timeout)
        if not done:
            await braking.cancel(values['reply_timeout'])
            return 'its stop did not end, and was canceled'
        ended = braking.result.result()
        return 'it braked' if ended.end is End.SUCCEEDED else f'while it braked, {ended.text}'

    def _cannot_start(self, goal: ForwardedGoal) -> str | None:
        """Return why a goal cannot start now, or None.

        The goal may arrive before the driver is found.
        """
        if not self._downstream.available:
            return self._downstream.no_server
        problem = self._not_at_rest(goal)
        return problem and f'{problem}: a goal must start with the arm at rest'

    def _not_at_rest(self, goal: ForwardedGoal) -> str | None:
        values, names = self._parameters, goal.limits.names
        try:
            _, velocities = self._arm.of(goal.limits, values['state_timeout'])
        except GoalRejectedError as error:
            return str(error)
        fast = np.flatnonzero(~(np.abs(velocities) <= values['stopped_velocity_tolerance']))
        return f'{names[fast[0]]} moves at {velocities[fast[0]]:.3g} /s' if len(fast) else None

    async def _wait_until_solved(self, problem: Callable[[], str | None]) -> str | None:
        """Return None as soon as there is no `problem`, or the problem after REST_TIMEOUT_S."""
        latest = self._loop.time() + REST_TIMEOUT_S
        while True:
            text = problem()
            if text is None or self._loop.time() > latest:
                return text
            await asyncio.sleep(WATCH_PERIOD_S / 5)


def _ns(time: Time | Duration) -> int:
    return int(time.sec * NS_PER_S + time.nanosec)


def _aborted(text: str) -> Outcome:
    return Outcome(End.ABORTED, ErrorCode.INVALID_GOAL, text)


def _goal_time(goal: ForwardedGoal, duration: float) -> float:
    """Return goal_time_tolerance minus the delay of the smooth motion's end, s.

    duration: duration of the smooth motion, s. Raises GoalRejectedError if its end is too late.
    """
    tolerance = duration_in_s(goal.request.goal_time_tolerance)
    late = max(duration - goal.trajectory.duration, 0.0)
    if 0.0 < tolerance <= late:
        raise GoalRejectedError(
            ErrorCode.GOAL_TOLERANCE_VIOLATED,
            f'the smooth motion takes {duration:.3f} s within the limits, but the goal plans '
            f'{goal.trajectory.duration:.3f} s with goal_time_tolerance = {tolerance:g} s',
        )
    return tolerance - late if tolerance > 0.0 else tolerance


def _request(goal: FollowJointTrajectory.Goal, goal_time: float) -> FollowJointTrajectory.Goal:
    copied = {
        name: getattr(goal, name)
        for name in goal.get_fields_and_field_types()
        if name.endswith('tolerance')
    }
    return FollowJointTrajectory.Goal(
        **copied | {'goal_time_tolerance': duration_message(goal_time)}
    )
