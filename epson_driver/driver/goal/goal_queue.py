# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Handles goals from submission to outcome. One goal runs, and one may wait.

A new goal waits while the driver stops the running goal. It starts when the arm is at rest, which
may be later than the end of the previous goal. A goal with a start time in the future is already
the running goal, in the state PREPARING. All of this code runs in the driver's event loop.
"""

import asyncio
import contextlib
import logging
from collections.abc import Callable, Coroutine, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from epson_driver.driver.configuration import Configuration
from epson_driver.driver.delivery.delivery import PreparedTrajectory
from epson_driver.driver.goal.goal import (
    Goal,
    GoalSettings,
    check_limits,
    check_start,
    checked_goal,
)
from epson_driver.driver.goal.goal_execution import GoalExecution
from epson_driver.driver.goal.goal_states import AT_REST, GoalState
from epson_driver.driver.goal.planning_cancellation import (
    PlanningCancellation,
    PlanningCancellations,
)
from epson_driver.driver.goal.reference import MIN_FACTOR, SpeedScaling, Timing, TimingMonitor
from epson_driver.driver.inhibit import Cause, Inhibit, Purpose
from epson_driver.driver.outcome import End, ErrorCode, GoalRejectedError, Outcome
from epson_driver.driver.smoothing import SmoothingError, SmoothingProcess
from epson_driver.driver.state.robot_state import JointSample, RobotState
from epson_driver.driver.stopping.stopper import Stopper
from epson_driver.driver.tasks import (
    Notification,
    report_task_error,
    wait_for_fresh_state,
)
from epson_driver.motion import Trajectory
from epson_driver.motion.plan_share import plan_share

REPLACED = 'replaced by a newer goal before it could start'

FRESH_POSE_TIMEOUT_S = 0.2
"""Maximum time for which a goal waits for a fresh joint state, s. If the machine was busy, a new
joint state is about to arrive, or already waits in the socket."""

_log = logging.getLogger(__name__)


@dataclass(eq=False)
class GoalHandle:
    """A submitted goal, its execution and, when it has ended, its outcome."""

    goal: Goal
    on_end: Callable[[Outcome], None]  # called once, with the outcome
    on_feedback: Callable[[GoalExecution, JointSample], None]  # called with each joint sample
    execution: GoalExecution | None = None
    outcome: Outcome | None = None
    task: asyncio.Task[None] | None = None  # waits for joints, smoothing or the start time
    plan: PlanningCancellation | None = (
        None  # planned from a start position: rejected while a goal runs
    )

    def continue_in_task(self, work: Coroutine[Any, Any, None]) -> None:
        self.task = asyncio.create_task(work)
        self.task.add_done_callback(report_task_error)

    def cancel_task(self) -> None:
        if self.task is not None:
            self.task.cancel()


class GoalQueue:
    """Executes one goal at a time. `start_tolerance`, rad, and `settings` may change at any time.

    `on_broken_off(outcome, unanswered)` is called if the arm must be enabled again after a goal.
    `unanswered`: the controller has not replied to a message.
    """

    def __init__(
        self,
        configuration: Configuration,
        robot: RobotState,
        why_not: Callable[[Purpose, float], Inhibit | None],
        stopper: Stopper,
        settings: GoalSettings,
        changed: Notification,
        on_broken_off: Callable[[Outcome, bool], None],
    ) -> None:
        self._limits = limits = configuration.limits
        self._timing_monitor = TimingMonitor(configuration.delivery, limits)
        self.start_tolerance = 0.02
        self.scaling = SpeedScaling(by_velocity=self._timing_monitor.by_velocity)
        self.scaling.actual = stopper.delivery.scale(lambda: self.scaling.target or MIN_FACTOR)
        self.unsmoothed = 0  # goals without a smooth motion within the limits
        self.last_timing: Timing | None = None  # of the last goal that succeeded
        self.other_speed = 0  # number of goals that were executed at another speed than planned
        self.stops: list[str] = []  # reasons of stops in progress: no goal is accepted
        self._robot = robot
        self._why_not = why_not
        self._stopper = stopper
        self._settings = settings
        stopper.stopped_velocity = settings.stopped_velocity
        self._changed = changed
        self._on_broken_off = on_broken_off
        self._smooths = configuration.smoothing.wanted
        self.smoother = SmoothingProcess(limits, configuration.smoothing)
        self._running: GoalHandle | None = None
        self._waiting: GoalHandle | None = None
        self.plans = PlanningCancellations()  # goals in planning: submitting a goal cancels them

    @property
    def settings(self) -> GoalSettings:
        return self._settings

    @settings.setter
    def settings(self, settings: GoalSettings) -> None:
        self._settings = settings
        self._stopper.stopped_velocity = settings.stopped_velocity
        if self.execution is not None:
            self.execution.settings = settings

    @property
    def why_no_stream(self) -> str:
        required = self._settings.require_planned_speed
        return self._timing_monitor.why_no_stream() if required else ''

    @property
    def busy(self) -> bool:
        return self._running is not None

    @property
    def idle(self) -> bool:
        return self._running is None and self._waiting is None

    @property
    def execution(self) -> GoalExecution | None:
        return None if self._running is None else self._running.execution

    @contextlib.contextmanager
    def stopping(self, why: str) -> Iterator[None]:
        """End waiting goals, and reject goals submitted during the `with` block."""
        self.stops.append(why)
        self.end_waiting(why)
        try:
            yield
        finally:
            self.stops.remove(why)

    def make_ready(self) -> None:
        if self._smooths:
            self.smoother.make_ready()

    async def close(self) -> None:
        """Close the smoothing process. Must not be called while a goal runs."""
        await self.smoother.close()

    def submit(self, handle: GoalHandle) -> None:
        """Execute a goal after stopping the running goal. Abort an invalid goal immediately.

        If the last joint state is stale, the goal waits briefly, as a newer one may be unread.
        """
        try:
            if handle.plan is not None and handle.plan.why is not None:
                raise GoalRejectedError(ErrorCode.INVALID_GOAL, handle.plan.why)
            if self.stops:
                raise GoalRejectedError(ErrorCode.INVALID_GOAL, self.stops[0])
            if handle.plan is not None:
                self.check(Purpose.ALONE, _now())
            handle.goal = checked_goal(handle.goal, self._limits)
        except GoalRejectedError as rejection:
            handle.on_end(rejection.outcome)
            return
        self.plans.end(REPLACED)
        now = _now()
        inhibit = self._why_not(self._purpose, now)
        if inhibit is not None and inhibit.cause is Cause.NO_POSE and self._robot.stale(now):
            handle.continue_in_task(self._submit_later(handle))
            self._wait(handle)
        else:
            self._submit(handle, now)

    async def _submit_later(self, handle: GoalHandle) -> None:
        now = await wait_for_fresh_state(self._robot.stale, self._changed, FRESH_POSE_TIMEOUT_S)
        if handle is self._waiting:
            self._waiting = handle.task = None
            self._submit(handle, now)

    def _submit(self, handle: GoalHandle, now: float) -> None:
        """Start a goal, or queue it until the arm has stopped. `now`: time of all checks, s."""
        try:
            self.check(self._purpose, now)
            if self._running is None and not self._stopper.over:
                self.check(Purpose.START, now)
        except GoalRejectedError as rejection:
            handle.on_end(rejection.outcome)
            return
        if self._running is None and self._stopper.over:
            self._start(handle, now)
            return
        self._wait(handle)
        if self.execution is not None:
            self.execution.stop('replaced by a new goal', _now())

    def _wait(self, handle: GoalHandle) -> None:
        """Queue a goal until joints arrive or the arm stops. End the goal that waited before."""
        replaced, self._waiting = self._waiting, handle
        if replaced is not None:
            self._end_unstarted(replaced, REPLACED)

    def cancel(self, handle: GoalHandle) -> None:
        if handle is self._waiting:
            self._end_unstarted(handle, 'canceled before it could start', End.CANCELED)
        elif handle is self._running and handle.execution is not None:
            handle.execution.cancel(_now())

    def end_waiting(self, why: str) -> None:
        self.plans.end(why)
        if self._waiting is not None:
            self._end_unstarted(self._waiting, why)

    def _end_unstarted(self, handle: GoalHandle, why: str, end: End = End.ABORTED) -> None:
        if handle is self._waiting:
            self._waiting = None
        handle.cancel_task()
        code = ErrorCode.SUCCESSFUL if end is End.CANCELED else ErrorCode.INVALID_GOAL
        handle.on_end(Outcome(end, code, why))

    def on_rest(self) -> None:
        """Start the waiting goal, because the arm has now stopped.

        A goal that still waits for a joint state is not started.
        """
        following = self._waiting
        if self._running is None and following is not None and following.task is None:
            self._waiting = None
            self._start(following, _now())

    def fault(self, why: str) -> None:
        self.end_waiting(why)
        if (execution := self.execution) is not None:
            execution.fault(f'{why} ({execution.where})')

    def withdraw(self) -> None:
        if self.execution is not None:
            self.execution.on_unsolicited_failure(_now())

    async def stop(self, why: str, timeout: float) -> Outcome | None:
        """Stop the running goal. Return its outcome, or None if it has none in `timeout` s."""
        handle = self._running
        if handle is None or handle.execution is None:
            return None
        handle.execution.stop(why, _now())
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(timeout):
                while handle.outcome is None:
                    await self._changed.wait()
        return handle.outcome

    def on_joints(self, sample: JointSample, now: float) -> None:
        handle = self._running
        if handle is not None and (execution := handle.execution) is not None:
            execution.on_state(self._robot, now)
            if self.scaling.target and execution.state is GoalState.PAUSED:
                self._resume(handle, execution, now)
            if not execution.ended:
                handle.on_feedback(execution, sample)

    def on_status(self, now: float) -> None:
        execution = self.execution
        if execution is None:
            return
        was_paused = execution.paused
        execution.on_state(self._robot, now)
        if execution.paused and not was_paused:
            _log.info('the controller is paused: the motion waits %s', execution.where)
        elif was_paused and not execution.paused and not execution.ended:
            _log.info('the controller is no longer paused: the motion resumes %s', execution.where)

    @property
    def _purpose(self) -> Purpose:
        """Purpose for the check of a new goal.

        It is GOAL while the controller reports no joints because of a motion, and READY otherwise.
        """
        moves = self._running is not None and self._robot.joints_unavailable
        return Purpose.GOAL if moves else Purpose.READY

    def check(self, purpose: Purpose, now: float) -> None:
        if (inhibit := self._why_not(purpose, now)) is not None:
            text = inhibit.text_with_remedy
            raise GoalRejectedError(ErrorCode.INVALID_GOAL, text, inhibit.remedy)

    def ready_sample(self, now: float, purpose: Purpose = Purpose.READY) -> JointSample:
        self.check(purpose, now)
        sample = self._robot.sample
        assert sample is not None  # noqa: S101 - for the type checker: otherwise there is no pose
        return sample

    def _start(self, handle: GoalHandle, now: float) -> None:
        try:
            sample = self._start_sample(handle.goal.trajectory, now)
        except GoalRejectedError as rejection:
            handle.on_end(rejection.outcome)
            return
        self._running = handle
        handle.execution = GoalExecution(
            handle.goal,
            self._settings,
            self._stopper.post,
            partial(self._on_end, handle),
            now,
            self.scaling,
            self._timing_monitor,
        )
        if (planned := handle.goal.planned) is not None:
            share = plan_share(planned, sample.positions, self._limits)
            handle.execution.plan_share = share
        if self.scaling.target:
            self._prepare(handle, handle.execution, sample)
        else:
            handle.execution.pause(now)

    def set_speed(self, factor: float) -> str:
        """Set the speed scaling (0 pauses), and return a sentence that describes the effect."""
        running = None if self.execution is None else self.execution.goal.trajectory
        self._timing_monitor.check_factor(factor, running)
        now = _now()
        inhibit = self._why_not(Purpose.GOAL, now)
        streams = inhibit is not None and inhibit.cause is Cause.STREAM
        self.scaling.set(factor, now, ramp=self.busy or streams)
        handle = self._running
        if factor or handle is None or handle.execution is None:
            return f'motions run at {factor:g} of their speed' if factor else 'motions are paused'
        handle.execution.pause(now)
        handle.cancel_task()
        if handle.execution.state is GoalState.PAUSED:
            return 'motions are paused'
        return 'pausing: the arm brakes, then the motion waits'

    def _resume(self, handle: GoalHandle, execution: GoalExecution, now: float) -> None:
        if self._why_not(Purpose.RESUME, now) is not None:
            return
        with execution.ended_by_rejection():
            sample = self.ready_sample(now, Purpose.START)
            execution.resume(sample, self._limits, self.start_tolerance)
            check_limits(execution.goal.trajectory, self._limits, may_end_moving=True)
            self.scaling.start_from_rest(now)
            self._prepare(handle, execution, sample)

    def _prepare(self, handle: GoalHandle, execution: GoalExecution, sample: JointSample) -> None:
        if not self._smooths and execution.goal.start <= _now():
            with execution.ended_by_rejection():
                self._execute(execution, execution.goal.trajectory, sample)
        else:
            handle.continue_in_task(self._execute_later(execution, sample))

    async def _execute_later(self, execution: GoalExecution, sample: JointSample) -> None:
        """Smooth a goal's motion, wait for its start time, and execute it if still allowed."""
        trajectory = execution.goal.trajectory
        if self._smooths:
            try:
                trajectory, remark = await self.smoother.prepared(
                    trajectory, sample.positions, execution.plan_share
                )
                execution.goal = replace(execution.goal, remark=remark)
            except SmoothingError as error:
                self.unsmoothed += 1
                if execution.state is GoalState.PREPARING:
                    execution.fault(str(error), ErrorCode.INVALID_GOAL)
                return
            finally:
                self.smoother.make_ready()
        await asyncio.sleep(max(execution.goal.start - _now(), 0.0))
        now = await wait_for_fresh_state(self._robot.stale, self._changed, FRESH_POSE_TIMEOUT_S)
        if execution.state is GoalState.PREPARING:
            with execution.ended_by_rejection():
                sample = self._start_sample(trajectory, now)
                self._execute(execution, trajectory, sample)

    def _start_sample(self, trajectory: Trajectory, now: float) -> JointSample:
        sample = self.ready_sample(now, Purpose.START)
        check_start(trajectory, sample.positions, self._limits, self.start_tolerance)
        return sample

    def _execute(
        self, execution: GoalExecution, trajectory: Trajectory, sample: JointSample
    ) -> None:
        if (message := execution.goal.message) is not None:
            prepared = PreparedTrajectory(trajectory, [message])
        else:
            prepared = self._stopper.delivery.prepare(trajectory, sample.positions)
        execution.start(prepared, _now(), sample.positions)

    def _on_end(self, handle: GoalHandle, outcome: Outcome) -> None:
        if handle is self._running:
            self._running = None
        handle.outcome = outcome
        aftermath = AT_REST if handle.execution is None else handle.execution.aftermath
        if handle.execution is not None and handle.execution.timing is not None:
            self.last_timing = handle.execution.timing
            self.other_speed += self.last_timing.deviates
        if aftermath.broken_off:
            self._on_broken_off(outcome, aftermath.unanswered)
        handle.cancel_task()
        self._changed.notify_all()
        handle.on_end(outcome)
        if not aftermath.at_rest:
            self.end_waiting(f'the previous goal did not stop the arm: {outcome.text}')
        elif outcome.end is End.SUCCEEDED:
            self._stopper.goal_reached()
        if self._stopper.over:
            self.on_rest()


def _now() -> float:
    return asyncio.get_running_loop().time()
