# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The running goal and the one that waits for it: from submission to outcome.

A new goal replaces the running one, which is stopped; it starts when the arm stands. Or, where
that is wanted, it goes on from where the running one is left on its way (handover.py). One that
comes after a goal that ended at once starts when the stop of that one is over. Everything here
runs in the driver's loop.
"""

import asyncio
import logging
from collections.abc import Callable
from dataclasses import dataclass, replace

from epson_driver.driver.goal.goal import Goal
from epson_driver.driver.goal.goal_checks import check_goal, check_start
from epson_driver.driver.goal.goal_execution import GoalExecution
from epson_driver.driver.goal.goal_plan import GoalPlans
from epson_driver.driver.goal.goal_settings import GoalSettings
from epson_driver.driver.goal.goal_states import AT_REST, GoalState
from epson_driver.driver.goal.handover import Handover, from_rest, joined, numbered
from epson_driver.driver.goal.pace import Pace, Timing
from epson_driver.driver.goal.replacing import Replacing
from epson_driver.driver.goal.speed_scaling import SpeedScaling
from epson_driver.driver.outcome import End, ErrorCode, GoalRejectedError, Outcome
from epson_driver.driver.smoothing.smoothing_process import SmoothingError, SmoothingProcess
from epson_driver.driver.state.robot_state import JointSample, RobotState
from epson_driver.driver.stopping.arm_gate import ArmGate
from epson_driver.driver.stopping.stopper import Stopper
from epson_driver.driver.tasks.fresh_moment import MAX_READING_TURNS, fresh_moment
from epson_driver.driver.tasks.notification import Notification
from epson_driver.driver.tasks.task_group import report_task_error
from epson_driver.motion import JointLimits, Trajectory

REPLACED = 'replaced by a newer goal before it could start'

FRESH_POSE_TIMEOUT_S = 0.2
"""How long a goal waits for joints if those that are there are too old, s: when the machine was
busy, they are about to come, or wait in the socket."""

_log = logging.getLogger(__name__)


@dataclass(eq=False)
class GoalHandle:
    """A goal in the queue. `on_end` gets its outcome, once, `on_feedback` each sample."""

    goal: Goal
    on_end: Callable[[Outcome], None]
    on_feedback: Callable[[GoalExecution, JointSample], None]
    execution: GoalExecution | None = None
    outcome: Outcome | None = None
    preparation: asyncio.Task[None] | None = None


class GoalQueue:
    """Executes one goal after the other. `run` until cancelled; the rest is called meanwhile.

    `on_broken_off` is called with the outcome of a goal after which the arm must be enabled again,
    and whether an answer is missing. `start_tolerance` (rad) and `settings` may be changed at any
    time; the latter hold for the running goal, too. `on_the_way`: a running goal is left without
    a stop for a new one, where that can be.
    """

    def __init__(
        self,
        limits: JointLimits,
        robot: RobotState,
        gate: ArmGate,
        stopper: Stopper,
        settings: GoalSettings,
        changed: Notification,
        on_broken_off: Callable[[Outcome, bool], None],
        smoother: SmoothingProcess | None,
        pace: Pace,
        *,
        on_the_way: bool = False,
    ) -> None:
        self.start_tolerance = 0.05
        self.scaling = SpeedScaling()
        self.unsmoothed = 0
        """Goals for which no smooth motion inside every limit was found."""
        self.last_timing: Timing | None = None
        """How long the last goal that succeeded was planned to take, and took."""
        self.other_speed = 0
        """Goals that were executed at another speed than planned."""
        self.occupied: Callable[[], str | None] = lambda: None
        """Returns why no goal may begin, as something else moves the arm; None: nothing does."""
        self._limits = limits
        self._pace = pace
        self._robot = robot
        self._gate = gate
        self._stopper = stopper
        self._settings = settings
        stopper.stopped_velocity = settings.stopped_velocity
        self._changed = changed
        self._on_broken_off = on_broken_off
        self.smoother = smoother
        self._running: GoalHandle | None = None
        self._next: GoalHandle | None = None
        self._unread: GoalHandle | None = None
        self._preparations: set[asyncio.Task[None]] = set()
        self.plans = GoalPlans()
        """Goals of which there is no trajectory yet. One that is submitted ends them."""
        self._replacing = Replacing(limits, on_the_way=on_the_way)
        self.joined = 0
        """Goals that have begun on the way of another."""

    @property
    def settings(self) -> GoalSettings:
        """Tolerances and patience of goal executions."""
        return self._settings

    @settings.setter
    def settings(self, settings: GoalSettings) -> None:
        self._settings = settings
        self._stopper.stopped_velocity = settings.stopped_velocity
        if self.execution is not None:
            self.execution.settings = settings

    @property
    def busy(self) -> bool:
        """True while a goal runs."""
        return self._running is not None

    @property
    def idle(self) -> bool:
        """True while no goal runs, waits or is being prepared."""
        waiting = (self._running, self._next, self._unread)
        return not self._preparations and all(handle is None for handle in waiting)

    @property
    def execution(self) -> GoalExecution | None:
        """The execution of the running goal; None if no goal runs."""
        return None if self._running is None else self._running.execution

    def make_ready(self) -> None:
        """Start the process that smooths, so that the first goal need not wait for it."""
        if self.smoother is not None:
            self.smoother.make_ready()

    async def close(self) -> None:
        """End the tasks and the process that prepare goals; no goal may run any more."""
        await asyncio.gather(*self._preparations, return_exceptions=True)
        if self.smoother is not None:
            await self.smoother.close()

    def submit(self, handle: GoalHandle) -> None:
        """Execute a goal; a running one is stopped first and ends as aborted.

        It is checked here, whoever submits it: one that breaks a limit ends at once, and what runs
        goes on.

        If the pose is too old, it waits for a moment for a newer one: the loop may not have been
        scheduled for a while, and what came meanwhile is still to be read.
        """
        try:
            check_goal(handle.goal, self._limits)
        except GoalRejectedError as rejection:
            handle.on_end(rejection.outcome)
            return
        self.plans.end(REPLACED)
        now = _now()
        if self._gate.reason is None and self._robot.stale(now):
            if self._unread is not None:
                self._end_unstarted(self._unread, REPLACED)
            self._unread = handle
            asyncio.get_running_loop().call_later(
                FRESH_POSE_TIMEOUT_S, self._wait_no_longer, handle, MAX_READING_TURNS
            )
        else:
            self._submit(handle, now)

    def _wait_no_longer(self, handle: GoalHandle, turns: int) -> None:
        """Submit a goal that still waits for a fresh pose, after so many turns of the loop."""
        if handle is not self._unread:
            return
        if turns:
            asyncio.get_running_loop().call_soon(self._wait_no_longer, handle, turns - 1)
            return
        self._unread = None
        self._submit(handle, _now())

    def _submit(self, handle: GoalHandle, now: float) -> None:
        """Start a goal, or let it wait for a stop. Whether the pose is fresh is judged at `now`.

        At one moment in all checks: this process may be held up between two of them.
        """
        try:
            self.check_ready(now)
        except GoalRejectedError as rejection:
            handle.on_end(rejection.outcome)
            return
        if self._running is None and self._stopper.over:
            self._start(handle, now)
            return
        if self._running is None:
            try:
                self.standing_sample(now)
            except GoalRejectedError as rejection:
                handle.on_end(rejection.outcome)
                return
        if self._next is not None:
            self._end_unstarted(self._next, REPLACED)
        self._next = handle
        if self.execution is not None:
            self._replacing.replace(self.execution, self._join, _now())

    def cancel(self, handle: GoalHandle) -> None:
        """Stop the goal's motion; it ends as canceled when the arm stands.

        A goal that was to be left for this one is stopped, too.
        """
        if handle in (self._next, self._unread):
            if handle is self._next and self._replacing.pending and self.execution is not None:
                self._replacing.stop(self.execution, 'that was canceled', _now())
            self._end_unstarted(handle, 'canceled before it could start', End.CANCELED)
        elif handle is self._running and handle.execution is not None:
            handle.execution.cancel(_now())

    def _join(self, left: Handover, now: float) -> bool:
        """Have the next goal go on where the running one is left, or stop that one for it.

        Nothing of the running goal is on its way. What forbids motion is looked at in the same
        turn of the loop in which the first point is sent.
        """
        old, new = self._running, self._next
        self._replacing.done()
        if old is None or old.execution is None or new is None:
            return False
        why = self._gate.reason or self.occupied()
        if why is None and not self._stopper.over:
            why = 'the arm is being stopped'
        try:
            if why is not None:
                raise GoalRejectedError(ErrorCode.INVALID_GOAL, why)
            way = joined(left, new.goal.trajectory, self._limits, self.start_tolerance)
            start = way.trajectory.positions[0]
            if self._settings.require_planned_speed:
                self._pace.check(way.trajectory, start)
            prepared = self._stopper.prepare(way.trajectory, start)
        except GoalRejectedError as rejection:
            self._replacing.stop(old.execution, str(rejection), now)
            return True
        points = numbered(prepared.messages, way.first, left.sequence)
        self._running, self._next = new, None
        self.joined += 1
        execution = self._new_execution(new)
        execution.go_on(way, points, left, now, self._replacing.lead)
        old.execution.handed_over()
        return True

    def end_waiting(self, why: str) -> None:
        """End the goals that wait to be started, or for their plan."""
        self.plans.end(why)
        self._replacing.done()
        for handle in (self._unread, self._next):
            if handle is not None:
                self._end_unstarted(handle, why)

    def _end_unstarted(self, handle: GoalHandle, why: str, end: End = End.ABORTED) -> None:
        if handle is self._next:
            self._next = None
        else:
            self._unread = None
        code = ErrorCode.SUCCESSFUL if end is End.CANCELED else ErrorCode.INVALID_GOAL
        handle.on_end(Outcome(end, code, why))

    def on_rest(self) -> None:
        """Start the goal that waits, as a stop is over."""
        if self._running is None and self._next is not None:
            following, self._next = self._next, None
            self._start(following, _now())

    def fault(self, why: str) -> None:
        """End the running and the waiting goals at once: something forbids motion."""
        self.end_waiting(why)
        if (execution := self.execution) is not None:
            execution.fault(f'{why} ({execution.where})')

    def withdraw(self) -> None:
        """Tell the running goal that the controller withdrew an acknowledgement."""
        if self.execution is not None:
            self.execution.on_unsolicited_failure(_now())

    async def stop(self, why: str, timeout: float) -> Outcome | None:
        """Stop the running goal, if any. Returns its outcome; None if there is none in time."""
        handle = self._running
        if handle is None or handle.execution is None:
            return None
        handle.execution.stop(why, _now())
        try:
            async with asyncio.timeout(timeout):
                while handle.outcome is None:
                    await self._changed.wait()
        except TimeoutError:
            return None
        return handle.outcome

    def on_joints(self, sample: JointSample, now: float) -> None:
        """Tell the goals that new joints came."""
        if self._unread is not None and not self._robot.stale(now):
            fresh, self._unread = self._unread, None
            self._submit(fresh, now)
        handle = self._running
        if handle is not None and handle.execution is not None:
            self._replacing.check(handle.execution, now)
            handle.execution.on_state(self._robot, now)
            if not handle.execution.ended:
                handle.on_feedback(handle.execution, sample)

    def on_status(self, now: float) -> None:
        """Tell the goals that a status came, which does not forbid motion."""
        execution = self.execution
        if execution is None:
            return
        was_paused = execution.paused
        execution.on_state(self._robot, now)
        if execution.paused and not was_paused:
            _log.info('the controller is paused: the goal waits %s', execution.where)
        elif was_paused and not execution.paused and not execution.ended:
            _log.info('the controller goes on: so does the goal, %s', execution.where)

    def check_ready(self, now: float) -> JointSample:
        """Return where the arm is. Raises GoalRejectedError unless it may move at `now`, s."""
        if self._gate.reason is not None:
            raise GoalRejectedError(
                ErrorCode.INVALID_GOAL,
                f'the arm is not enabled ({self._gate.reason}): call ~/enable',
            )
        if (why := self.occupied()) is not None:
            raise GoalRejectedError(ErrorCode.INVALID_GOAL, why)
        if (why := self._robot.why_not_ready(now)) is not None:
            raise GoalRejectedError(ErrorCode.INVALID_GOAL, why)
        if self._robot.paused and not self._stopper.resumes:
            raise GoalRejectedError(
                ErrorCode.INVALID_GOAL,
                'the controller is paused (it says that motion is not possible): continue there',
            )
        sample = self._robot.sample
        assert sample is not None  # noqa: S101 - for the type checker: why_not_ready says so
        return sample

    def standing_sample(self, now: float) -> JointSample:
        """Return where the arm stands. Raises GoalRejectedError if it may not move or moves now.

        Nothing of ours runs then: what still moves is braking after a fault, or moved by others.
        """
        sample = self.check_ready(now)
        why = self._robot.why_not_standing(self._settings.stopped_velocity)
        if why is not None:
            raise GoalRejectedError(
                ErrorCode.INVALID_GOAL, f'the arm moves ({why}): wait until it stands'
            )
        return sample

    def _start(self, handle: GoalHandle, now: float) -> None:
        trajectory = handle.goal.trajectory
        try:
            sample = self._sample_at_start(trajectory, now)
        except GoalRejectedError as rejection:
            handle.on_end(rejection.outcome)
            return
        self._running = handle
        execution = self._new_execution(handle)
        if self.smoother is None:
            if self._replacing.on_the_way:
                trajectory = from_rest(trajectory, sample.positions, self._limits)
            self._execute(execution, trajectory, sample)
            return
        handle.preparation = asyncio.create_task(self._prepare(self.smoother, execution, sample))
        self._preparations.add(handle.preparation)
        handle.preparation.add_done_callback(self._preparations.discard)
        handle.preparation.add_done_callback(report_task_error)

    def _new_execution(self, handle: GoalHandle) -> GoalExecution:
        handle.execution = GoalExecution(
            handle.goal,
            self._settings,
            self._stopper.post,
            lambda outcome: self._on_end(handle, outcome),
            _now(),
            self.scaling,
        )
        return handle.execution

    def _sample_at_start(self, trajectory: Trajectory, now: float) -> JointSample:
        """Return where the arm stands. Raises GoalRejectedError unless it can begin there now."""
        sample = self.standing_sample(now)
        check_start(trajectory, sample.positions, self._limits, self.start_tolerance)
        return sample

    async def _prepare(
        self, smoother: SmoothingProcess, execution: GoalExecution, sample: JointSample
    ) -> None:
        """Have a goal's motion planned, then execute it, unless the goal was stopped meanwhile.

        The arm must stand then where the motion begins, as when the goal came.
        """
        planned: Trajectory | None = None
        rejection: GoalRejectedError | None = None
        try:
            try:
                planned = await smoother.prepared(execution.goal.trajectory, sample.positions)
            finally:
                smoother.make_ready()
            now = await fresh_moment(self._robot.stale, self._changed, FRESH_POSE_TIMEOUT_S)
            if execution.state is GoalState.PREPARING:
                sample = self._sample_at_start(planned, now)
        except SmoothingError as error:
            self.unsmoothed += 1
            rejection = GoalRejectedError(ErrorCode.INVALID_GOAL, str(error))
        except GoalRejectedError as error:
            rejection = error
        if execution.state is not GoalState.PREPARING:
            return
        if rejection is not None:
            execution.fault(str(rejection), rejection.code)
        elif planned is not None:
            self._execute(execution, planned, sample)

    def _execute(
        self, execution: GoalExecution, trajectory: Trajectory, sample: JointSample
    ) -> None:
        try:
            if self._settings.require_planned_speed:
                self._pace.check(trajectory, sample.positions)
            prepared = self._stopper.prepare(trajectory, sample.positions)
        except GoalRejectedError as rejection:
            execution.fault(str(rejection), rejection.code)
            return
        execution.start(
            prepared.trajectory,
            prepared.messages,
            _now(),
            sample.positions,
            prepared.delay,
            self._replacing.lead,
        )

    def _on_end(self, handle: GoalHandle, outcome: Outcome) -> None:
        if handle is self._running:
            self._running = None
        outcome = self._timed(handle, outcome)
        handle.outcome = outcome
        aftermath = AT_REST if handle.execution is None else handle.execution.aftermath
        if aftermath.broken_off:
            self._on_broken_off(outcome, aftermath.unanswered)
        if handle.preparation is not None:
            handle.preparation.cancel()
        self._changed.notify_all()
        handle.on_end(outcome)
        if aftermath.handed_over:
            return
        self._replacing.done()
        if not aftermath.at_rest:
            self.end_waiting(f'the goal before it did not bring the arm to rest: {outcome.text}')
        elif outcome.end is End.SUCCEEDED:
            self._stopper.goal_reached()
        if self._stopper.over:
            self.on_rest()

    def _timed(self, handle: GoalHandle, outcome: Outcome) -> Outcome:
        """Return the outcome; if it ran at another speed than planned, say so and log it."""
        timing = None if handle.execution is None else handle.execution.timing
        if timing is None:
            return outcome
        self.last_timing = timing
        said = self._pace.said(timing)
        if not said:
            return outcome
        self.other_speed += 1
        _log.warning('a goal ran at another speed than planned: %s', said)
        return replace(outcome, text=f'{outcome.text}; {said}')


def _now() -> float:
    return asyncio.get_running_loop().time()
