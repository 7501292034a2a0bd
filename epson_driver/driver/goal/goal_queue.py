# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Handles goals from submission to outcome. One goal runs, and one may wait.

A new goal waits while the driver stops the running goal, and starts when the arm is at rest, which
may be later than the end of the previous goal. A goal with a start time in the future already
counts as the running goal, in the state PREPARING. All of this code runs in the driver's loop.
"""

import asyncio
import contextlib
import logging
from collections.abc import Callable, Coroutine, Iterator
from dataclasses import dataclass
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
from epson_driver.driver.goal.planning_scope import PlanningScope, PlanningScopes
from epson_driver.driver.goal.reference import SpeedScaling
from epson_driver.driver.goal.timing_monitor import Timing, TimingMonitor
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

REPLACED = 'replaced by a newer goal before it could start'

FRESH_POSE_TIMEOUT_S = 0.2
"""Maximum wait of a goal for fresh joints, s. If the machine was busy, new ones are about to
arrive or already wait in the socket."""

_log = logging.getLogger(__name__)


@dataclass(eq=False)
class GoalHandle:
    """A goal in the queue.

    * `on_end`: called once, with the outcome.
    * `on_feedback`: called with each joint sample.
    * `task`: waits for fresh joints, for the smooth motion or for the start time, if needed.
    * `plan`: set if the goal was planned from a specific start position. Such a goal is rejected
      while another goal runs, and after its planning was cancelled.
    """

    goal: Goal
    on_end: Callable[[Outcome], None]
    on_feedback: Callable[[GoalExecution, JointSample], None]
    execution: GoalExecution | None = None
    outcome: Outcome | None = None
    task: asyncio.Task[None] | None = None
    plan: PlanningScope | None = None

    def continue_in_task(self, work: Coroutine[Any, Any, None]) -> None:
        """Run `work` in a task, which `cancel_task` cancels."""
        self.task = asyncio.create_task(work)
        self.task.add_done_callback(report_task_error)

    def cancel_task(self) -> None:
        """Cancel the task, if any."""
        if self.task is not None:
            self.task.cancel()


class GoalQueue:
    """Executes one goal at a time.

    `on_broken_off(outcome, unanswered)` is called after a goal whose end requires that the arm is
    enabled again. `unanswered`: a reply is missing. `start_tolerance` (rad) and `settings` may be
    changed at any time. Changed settings also apply to the running goal.
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
        self.unsmoothed = 0
        """Number of goals that failed because no smooth motion within the limits exists."""
        self.last_timing: Timing | None = None
        """Planned and actual duration of the last goal that succeeded."""
        self.other_speed = 0
        """Number of goals that were executed at another speed than planned."""
        self.stops: list[str] = []
        """Reasons of the stops in progress. New goals are rejected while there are any."""
        self._robot = robot
        self._why_not = why_not
        self._stopper = stopper
        self._settings = settings
        stopper.stopped_velocity = settings.stopped_velocity
        self._changed = changed
        self._on_broken_off = on_broken_off
        smoothing = configuration.smoothing
        self.smoother = SmoothingProcess(limits, smoothing) if smoothing.wanted else None
        self._running: GoalHandle | None = None
        self._waiting: GoalHandle | None = None
        self.plans = PlanningScopes()
        """Goals that are still being planned. Submitting a goal cancels them."""

    @property
    def settings(self) -> GoalSettings:
        """Tolerances and timeouts of goal executions."""
        return self._settings

    @settings.setter
    def settings(self, settings: GoalSettings) -> None:
        self._settings = settings
        self._stopper.stopped_velocity = settings.stopped_velocity
        if self.execution is not None:
            self.execution.settings = settings

    @property
    def why_no_stream(self) -> str:
        """Reason for refusing setpoint streams if the controller ignores their speed, or ''."""
        required = self._settings.require_planned_speed
        return self._timing_monitor.why_no_stream() if required else ''

    @property
    def busy(self) -> bool:
        """True while a goal runs."""
        return self._running is not None

    @property
    def idle(self) -> bool:
        """True while no goal runs or waits."""
        return self._running is None and self._waiting is None

    @property
    def execution(self) -> GoalExecution | None:
        """The execution of the running goal, or None if no goal runs."""
        return None if self._running is None else self._running.execution

    @contextlib.contextmanager
    def stopping(self, why: str) -> Iterator[None]:
        """End waiting goals, and reject goals submitted during the `with` block.

        Such goals may have been requested before the stop.
        """
        self.stops.append(why)
        self.end_waiting(why)
        try:
            yield
        finally:
            self.stops.remove(why)

    def make_ready(self) -> None:
        """Start the smoothing process, so that the first goal does not wait for it."""
        if self.smoother is not None:
            self.smoother.make_ready()

    async def close(self) -> None:
        """Close the smoothing process. No goal may run."""
        if self.smoother is not None:
            await self.smoother.close()

    def submit(self, handle: GoalHandle) -> None:
        """Execute a goal after stopping the running one, which ends as aborted.

        An invalid goal is aborted immediately, and the running goal continues.

        If the last joint state is stale, the goal waits briefly for a newer one, which may still
        be unread because the loop was not scheduled for a while.
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
        """Submit a goal when fresh joints are available, or after FRESH_POSE_TIMEOUT_S."""
        now = await wait_for_fresh_state(self._robot.stale, self._changed, FRESH_POSE_TIMEOUT_S)
        if handle is self._waiting:
            self._waiting = handle.task = None
            self._submit(handle, now)

    def _submit(self, handle: GoalHandle, now: float) -> None:
        """Start a goal, or queue it until the arm has stopped.

        All checks use the time `now`, because this process may be delayed between two of them.
        """
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
        """Queue a goal until joints arrive or the arm stops. End a previously queued goal."""
        replaced, self._waiting = self._waiting, handle
        if replaced is not None:
            self._end_unstarted(replaced, REPLACED)

    def cancel(self, handle: GoalHandle) -> None:
        """Stop the goal's motion. The goal ends as canceled when the arm is at rest."""
        if handle is self._waiting:
            self._end_unstarted(handle, 'canceled before it could start', End.CANCELED)
        elif handle is self._running and handle.execution is not None:
            handle.execution.cancel(_now())

    def end_waiting(self, why: str) -> None:
        """End the goals that wait for their start or their plan."""
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
        """Start the waiting goal after the arm has stopped, unless the goal waits for joints."""
        following = self._waiting
        if self._running is None and following is not None and following.task is None:
            self._waiting = None
            self._start(following, _now())

    def fault(self, why: str) -> None:
        """Abort the running and the waiting goals immediately."""
        self.end_waiting(why)
        if (execution := self.execution) is not None:
            execution.fault(f'{why} ({execution.where})')

    def withdraw(self) -> None:
        """Notify the running goal that the controller rejected a point acknowledged before."""
        if self.execution is not None:
            self.execution.on_unsolicited_failure(_now())

    async def stop(self, why: str, timeout: float) -> Outcome | None:
        """Stop the running goal and return its outcome.

        Returns None if no goal runs, or if it has not ended after `timeout` s.
        """
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
        """Pass new joints to the running goal. Resume a paused goal if nothing prevents it."""
        handle = self._running
        if handle is not None and (execution := handle.execution) is not None:
            execution.on_state(self._robot, now)
            if self.scaling.target and execution.state is GoalState.PAUSED:
                self._resume(handle, execution, now)
            if not execution.ended:
                handle.on_feedback(execution, sample)

    def on_status(self, now: float) -> None:
        """Pass a new STATUS to the running goal, and log when the controller pauses it."""
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
        """Purpose to check a new goal for: GOAL during a motion without joint data, else READY."""
        moves = self._running is not None and self._robot.joints_unavailable
        return Purpose.GOAL if moves else Purpose.READY

    def check(self, purpose: Purpose, now: float) -> None:
        """Raise GoalRejectedError if anything inhibits `purpose` at `now` (loop time, s)."""
        if (inhibit := self._why_not(purpose, now)) is not None:
            text = inhibit.text_with_remedy
            raise GoalRejectedError(ErrorCode.INVALID_GOAL, text, inhibit.remedy)

    def ready_sample(self, now: float, purpose: Purpose = Purpose.READY) -> JointSample:
        """Return the newest joints. Raises GoalRejectedError if anything inhibits `purpose`."""
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
        if self.scaling.target:
            self._prepare(handle, handle.execution, sample)
        else:
            handle.execution.pause(now)

    def set_speed(self, factor: float) -> str:
        """Set the speed scaling (0 pauses), and return a text that describes its effect.

        Raises ValueError if the factor is out of range or not supported by the controller.
        """
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
        """Smooth a goal's motion if smoothing is configured, and execute it at its start time."""
        if self.smoother is None and execution.goal.start <= _now():
            with execution.ended_by_rejection():
                self._execute(execution, execution.goal.trajectory, sample)
        else:
            handle.continue_in_task(self._execute_later(execution, sample))

    async def _execute_later(self, execution: GoalExecution, sample: JointSample) -> None:
        """Smooth a goal's motion, wait for its start time, and execute it.

        Does nothing if the goal was stopped before. The goal ends by a fault if the arm is no
        longer at rest at the start position.
        """
        motion = execution.goal.trajectory
        if self.smoother is not None:
            try:
                motion = await self.smoother.prepared(motion, sample.positions)
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
                self._execute(execution, motion, self._start_sample(motion, now))

    def _start_sample(self, trajectory: Trajectory, now: float) -> JointSample:
        """Return the newest joints. Raises GoalRejectedError if the trajectory cannot start."""
        sample = self.ready_sample(now, Purpose.START)
        check_start(trajectory, sample.positions, self._limits, self.start_tolerance)
        return sample

    def _execute(
        self, execution: GoalExecution, trajectory: Trajectory, sample: JointSample
    ) -> None:
        """Send the first point. Raises GoalRejectedError if the trajectory is not supported."""
        if (message := execution.goal.message) is not None:
            prepared = PreparedTrajectory(trajectory, [message])
        else:
            if self._settings.require_planned_speed and not execution.resumed:
                self._timing_monitor.check(trajectory, sample.positions, self.scaling.target)
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
            self.end_waiting(f'the goal before it did not stop the arm: {outcome.text}')
        elif outcome.end is End.SUCCEEDED:
            self._stopper.goal_reached()
        if self._stopper.over:
            self.on_rest()


def _now() -> float:
    return asyncio.get_running_loop().time()
