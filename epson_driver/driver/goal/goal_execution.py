# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The execution of one goal, from its first point to its single outcome.

The rules and the allowed transitions are in goal_states.py.

GoalExecution has no clock and no I/O. Its owner passes every event and the event's time to it, and
provides a function that sends messages.
"""

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cached_property, partial

import numpy as np

from epson_driver.driver.delivery.delivery import PreparedTrajectory
from epson_driver.driver.delivery.reply_rejection import reply_rejection
from epson_driver.driver.delivery.statements import StatementReply
from epson_driver.driver.delivery.streaming import MIN_DURATION_S, START_MARGIN_RAD, STOP
from epson_driver.driver.goal.goal import Arrival, Goal, GoalSettings, check_start, late_start
from epson_driver.driver.goal.goal_states import (
    AFTERMATH,
    BRAKING_STATES,
    FINAL_STATES,
    REJECTED_STATES,
    RUNNING_STATES,
    TRANSITIONS,
    UNCONFIRMED_STATES,
    UNKNOWN,
    GoalEvent,
    GoalState,
)
from epson_driver.driver.goal.reference import (
    PointSchedule,
    SpeedScaling,
    Timing,
    TimingMonitor,
    remainder,
)
from epson_driver.driver.outcome import End, ErrorCode, GoalRejectedError, Outcome
from epson_driver.driver.remedy import Remedy
from epson_driver.driver.state.robot_state import JointSample, PauseDetector, RobotState
from epson_driver.driver.state.standstill import (
    REST_TIME_S,
    UNCONFIRMED_REST_TIME_S,
    UNREPORTED_REST_TIME_S,
    Standstill,
)
from epson_driver.link.replies import sequence_of
from epson_driver.motion import Array, JointLimits
from epson_driver.simple_message import Message, MotionReply, Packet, TriState

SETTLE_TIME_S = 1.0  # maximum time at rest away from the goal after the last reply

MAX_COUNTED_GAP_S = 0.5
"""Maximum time between two states that counts toward a timeout, s. A longer gap means that this
process was not scheduled, or that the controller is silent. The link detects a silent controller
(`ReceiveTimeout`)."""

EARLY_S = 0.2  # subtracted from the plan time of a pause: repeat points rather than skip them
ACCEPTED_EARLY = 2  # assumed points ahead of a paused arm, if the controller ignores times


COUNTED_STATES = BRAKING_STATES | {GoalState.SETTLING}
"""States in which the arm must come to rest within the reply timeout."""

Send = Callable[[Message, Callable[[Packet, float], None]], object]
"""send(message, on_reply) sends a request. on_reply(packet, now) is called with its reply.
Raises ConnectionError if no link is available."""


class GoalExecution:
    """Streams a goal's points, decides its outcome and calls `on_end` with it exactly once."""

    def __init__(
        self,
        goal: Goal,
        settings: GoalSettings,
        send: Send,
        on_end: Callable[[Outcome], None],
        now: float,
        scaling: SpeedScaling | None = None,
        timing_monitor: TimingMonitor | None = None,
    ) -> None:
        self.goal = goal
        self.settings = settings
        self.state = GoalState.PREPARING
        self.aftermath = UNKNOWN  # of the arm after the goal has ended
        self.timing: Timing | None = None  # of a goal that succeeded
        self.started = now
        self.plan_share = (1.0, 1.0)  # maximum velocity and acceleration / limits
        self.point = 0  # number of accepted points, which is also the index of the pending point
        self._send = send
        self._on_end = on_end
        self._scaling = scaling or SpeedScaling()
        self._plan = goal.trajectory
        self._start = goal.trajectory.positions[0]
        self._schedule: PointSchedule | None = None
        self._paused_at: Array | None = None  # where the arm came to rest
        self._reached = 0.0  # plan time at that position, as far as known
        self._passed = 0.0  # plan time before the last pause
        self._standstill = Standstill(now)
        self._pause = PauseDetector()
        self._rest_at: float | None = None
        self._checked: JointSample | None = None
        self._due = 0.0  # time at which the next reply or the standstill is due by the plan
        self._last_check = now
        self._when_at_rest = Outcome(End.ABORTED, ErrorCode.INVALID_GOAL, 'stopped')
        self._moved = False  # the controller has replied that the motion is over
        self._rejection = ''
        self._rejected_at = 0.0
        self._cause_waited = 0.0
        self._timing_monitor = timing_monitor

    @property
    def paused(self) -> bool:
        return self._pause.paused

    @property
    def desired(self) -> tuple[float, Array, Array] | None:
        """Plan time, s, planned positions, rad, and velocities, rad/s. None before the start."""
        if self._schedule is None:
            rest = self._paused_at
            return None if rest is None else (self._reached, rest, np.zeros_like(rest))
        clock = self._schedule.clock
        time = min(clock.time, self.goal.trajectory.duration)
        return max(self._passed + time, self._reached), *clock.desired()

    def speed(self, now: float) -> float:
        return 0.0 if self.paused else self._scaling.factor(now)

    @property
    def target(self) -> int:
        return 0 if self._schedule is None else min(self.point, len(self._schedule) - 1)

    @property
    def where(self) -> str:
        first = self._schedule is None
        return 'before its first point' if first else f'moving to point {self.target}'

    @property
    def ended(self) -> bool:
        return self.state in FINAL_STATES

    def start(
        self, prepared: PreparedTrajectory, now: float, position: Array | None = None
    ) -> None:
        """Send the first point, unless the goal has been stopped. `position`: the arm's, rad.

        Raises GoalRejectedError if the controller cannot execute the plan at its speed.
        """
        if self.state is not GoalState.PREPARING:
            return
        trajectory = prepared.trajectory
        start = trajectory.positions[0] if position is None else position
        first = self._paused_at is None
        keep_speed = self.settings.require_planned_speed and self.goal.message is None
        if self._timing_monitor is not None and first and keep_speed:
            self._timing_monitor.check(trajectory, start, self._scaling.target)
        self.goal = replace(self.goal, trajectory=trajectory)
        self._due = now + prepared.delay
        if first:
            self._start, self.started = start, now
        self._schedule = PointSchedule(prepared, start, self._scaling, self._due)
        self._standstill.alive = now
        self._step(GoalEvent.PREPARED)
        self._send_point(now)

    @cached_property
    def _arrival(self) -> Arrival:
        """Check whether the arm is at the goal. It is created when the trajectory is final."""
        return Arrival(self.goal)

    def on_reply(self, index: int, packet: Packet, now: float) -> None:
        if self.state is not GoalState.STREAMING or index != self.point:
            if self.state in UNCONFIRMED_STATES:
                self._handle_late_reply(packet, now)
            return
        self._standstill.alive = now
        if (no := reply_rejection(packet)) is not None:
            why = f'the controller refused {self._name(index)} ({no})'
            self._reject(why, now, moved=isinstance(packet.message, StatementReply))
            return
        self.point += 1
        if self._schedule is not None and self.point < len(self._schedule):
            self._send_point(now)
        else:
            self._moved = isinstance(packet.message, StatementReply)  # it is sent after the motion
            self._standstill.expect(max(now, self._due))
            self._step(GoalEvent.LAST_REPLY)

    def on_unsolicited_failure(self, now: float) -> None:
        if self.state in RUNNING_STATES:
            where = self._name(self.target)
            text = f'reported a failure, although it had accepted all points before {where}'
            self._reject(f'the controller {text}', now)

    def on_state(self, robot: RobotState, now: float) -> None:
        sample = robot.sample
        if self.ended or sample is None:
            return
        last_check, self._last_check = self._last_check, now
        self._exclude_unscheduled_time(now, now - last_check)
        self._advance_clock(robot, sample, now)
        if self._schedule is not None:
            self._arrival.update(sample.positions)
        self._standstill.update(sample, robot, self._stopped(), now)
        if not self._standstill.is_at_rest:
            self._rest_at = None
        elif self._rest_at is None:
            self._rest_at = self._plan_time
        if self.state in REJECTED_STATES:
            self._check_cause(robot, now - max(last_check, self._rejected_at))
            return
        reported = robot.in_motion != TriState.UNKNOWN
        if self.state is GoalState.SETTLING:
            self._standstill.expect_rest(self._rest_time(reported=reported))
        if self._standstill.reached(sample.measured):
            if self.state is GoalState.SETTLING:
                # the next goal is refused as long as the arm counts as moving
                if robot.why_not_at_rest(self.settings.stopped_velocity) is None:
                    self._check_arrival(now, at_rest=reported)
            elif self.state in BRAKING_STATES:
                self._on_rest(sample)
        self._check_path(sample, now)
        self._check_timeouts(now)

    def cancel(self, now: float) -> None:
        outcome = Outcome(End.CANCELED, ErrorCode.SUCCESSFUL, 'canceled, the arm is at rest')
        self._stop(GoalEvent.CANCEL, outcome, now)

    def stop(self, why: str, now: float) -> None:
        outcome = Outcome(End.ABORTED, ErrorCode.INVALID_GOAL, f'{why}, the arm is at rest')
        self._stop(GoalEvent.STOP, outcome, now)

    def pause(self, now: float) -> None:
        if self.state is GoalState.PREPARING:
            self._step(GoalEvent.PAUSE)
            return
        outcome = Outcome(End.ABORTED, ErrorCode.INVALID_GOAL, 'paused, the arm is at rest')
        self._stop(GoalEvent.PAUSE, outcome, now)

    def resume(self, sample: JointSample, limits: JointLimits, tolerance: float) -> None:
        """Replace a paused goal's trajectory by its remainder, starting at the arm's position."""
        if self._paused_at is None:
            check_start(self._plan, sample.positions, limits, tolerance)
        else:
            moved = np.abs(sample.positions - self._paused_at)
            joint = int(np.argmax(moved))
            if moved[joint] > tolerance:
                raise GoalRejectedError(
                    ErrorCode.INVALID_GOAL,
                    f'{limits.names[joint]} moved by {moved[joint]:.6g} {limits.units[joint]} '
                    f'during the pause: the limit is {tolerance:g} {limits.units[joint]}',
                )
            rest = remainder(self._plan, self._start, sample.positions, self._reached, limits)
            self._passed = self._plan.duration - rest.duration
            self.goal = replace(self.goal, trajectory=rest)
        self.point, self._rest_at, self._schedule = 0, None, None
        self._step(GoalEvent.RESUME)

    @property
    def _expected(self) -> float:
        """Estimated plan time at which the arm stopped, s."""
        if self._schedule is None:
            return 0.0
        times = self.goal.trajectory.times
        if self._timing_monitor is not None and self._timing_monitor.unplanned:
            target = max(self.point - ACCEPTED_EARLY, 0)
            time = float((times[target - 1] if target else 0.0) + times[target]) / 2
        else:  # no later than the last point that was sent
            time = min(self._plan_time, float(times[self.target])) - EARLY_S
        fraction = time / max(self.goal.trajectory.duration, MIN_DURATION_S)
        expected = self._passed + (self._plan.duration - self._passed) * fraction
        return max(expected, self._reached)

    @contextlib.contextmanager
    def ended_by_rejection(self) -> Iterator[None]:
        try:
            yield
        except GoalRejectedError as rejection:
            self.fault(str(rejection), rejection.code, rejection.remedy)

    def fault(
        self,
        why: str,
        code: ErrorCode = ErrorCode.PATH_TOLERANCE_VIOLATED,
        remedy: Remedy = Remedy.NONE,
    ) -> None:
        """Abort the goal immediately, for the reason `why`. Send STOP if a point was sent."""
        if not self.ended:
            self._abort(GoalEvent.FAULT, why, code, remedy=remedy)

    def _abort(
        self,
        event: GoalEvent,
        why: str,
        code: ErrorCode = ErrorCode.PATH_TOLERANCE_VIOLATED,
        unexplained: bool = False,
        remedy: Remedy = Remedy.NONE,
    ) -> None:
        needs_stop = self.state is not GoalState.PREPARING and self.state not in REJECTED_STATES
        text = f'{self._rejection}: {why}' if self._rejection else why
        self._step(event)
        if needs_stop:
            self._send_stop()
        self._on_end(Outcome(End.ABORTED, code, text, unexplained, remedy))

    def _reject(self, why: str, now: float, *, moved: bool = False) -> None:
        self._rejection, self._rejected_at = why, now
        self._cause_waited = 0.0
        moved |= self.point > 0
        self._step(GoalEvent.REJECTION_MIDWAY if moved else GoalEvent.REJECTION)
        self._send_stop()

    def _check_cause(self, robot: RobotState, gap: float) -> None:
        """End a rejected goal with the cause from the first STATUS after the rejection.

        `gap`: time since the last call, s. At most half the timeout is counted, so that a STATUS
        that arrived while this process was not scheduled is read before the timeout.
        """
        status = robot.status
        report = status is not None and robot.status_time > self._rejected_at
        timeout = self.settings.cause_timeout
        self._cause_waited += min(gap, timeout / 2)
        if report and status and not status.error_code and robot.in_motion == TriState.TRUE:
            # The arm brakes. The cause, such as motors off, may only show once it is at rest.
            report = self._cause_waited > self.settings.reply_timeout
            timeout = self.settings.reply_timeout
        if status is not None and report:
            if error := status.error_code:
                self.fault(f'controller error {robot.errors.phrase(error)}')
            else:
                self._abort(GoalEvent.FAULT, 'it reports no error', unexplained=True)
        elif self._cause_waited > timeout:
            self._abort(GoalEvent.FAULT, 'no status shows the cause', unexplained=True)

    def _send_stop(self) -> None:
        with contextlib.suppress(ConnectionError):  # without a link the controller stops anyway
            self._send(STOP, lambda _packet, _now: None)

    def _stop(self, event: GoalEvent, outcome: Outcome, now: float) -> None:
        if (self.state, event) not in TRANSITIONS:
            return
        self._when_at_rest = outcome
        already = self.state in BRAKING_STATES
        self._step(event)
        if already:
            return
        self._standstill.alive = now
        self._standstill.expect(None)
        try:
            self._send(STOP, self._on_stop_reply)
        except ConnectionError as error:
            self.fault(f'STOP could not be sent: {error}')

    def _handle_late_reply(self, packet: Packet, now: float) -> None:
        """Handle a reply to a point after STOP was sent. It may be the reply to STOP instead."""
        message = packet.message
        if not isinstance(message, MotionReply) and not sequence_of(message):
            self._standstill.expect(now, UNCONFIRMED_REST_TIME_S)

    def _on_stop_reply(self, packet: Packet, now: float) -> None:
        if (no := reply_rejection(packet)) is None:
            if (self.state, GoalEvent.STOP_CONFIRMED) in TRANSITIONS:
                self._step(GoalEvent.STOP_CONFIRMED)
            self._standstill.expect(now)
        else:
            self.fault(f'the controller refused STOP ({no})')

    def _on_rest(self, sample: JointSample) -> None:
        if self.state is GoalState.PAUSING_CONFIRMED:
            self._paused_at, self._reached = sample.positions, self._expected
            self._step(GoalEvent.AT_REST)
            return
        outcome = self._when_at_rest
        if self.state in UNCONFIRMED_STATES:
            outcome = replace(outcome, text=f'{outcome.text}, but a reply is missing')
        self._step(GoalEvent.AT_REST)
        self._on_end(outcome)

    def _stopped(self) -> Array:
        """Return the velocity below which each joint counts as stopped, rad/s, shape (n,)."""
        stopped = np.full(len(self.goal.trajectory.joint_names), self.settings.stopped_velocity)
        if self.goal.goal_velocity is not None:
            stopped = np.minimum(stopped, self.goal.goal_velocity)
        return stopped

    def _rest_time(self, *, reported: bool) -> float:
        """Return how long the arm must have been at rest at the goal, s.

        The report of the controller is enough if it replied that the motion is over, or if it
        reported this standstill after the arm was away from the goal.
        """
        if not reported:
            return UNREPORTED_REST_TIME_S
        seen = self._arrival.seen and self._standstill.is_reported
        return 0.0 if self._moved or seen else REST_TIME_S

    def _check_arrival(self, now: float, *, at_rest: bool) -> None:
        """Complete the goal if the arm has reached it.

        Abort the goal if the arm has been at rest for SETTLE_TIME_S without reaching it.
        """
        if self.paused:  # part of the motion may remain
            return
        if self._plan_time < self.goal.trajectory.duration:
            return  # part of the plan may remain, even if the distance is short
        if self._arrival.reached(at_rest=at_rest):
            text = f'at the goal after {now - self.started:.2f} s'
            text += late_start(self.goal.start, self.started) + self.goal.remark
            distance = np.abs(self.goal.trajectory.positions - self._start).max()
            if self._rest_at is not None and distance > START_MARGIN_RAD:
                self.timing = Timing(self.goal.trajectory.duration, self._rest_at)
                own = self.goal.message is not None  # the controller chose the speed
                monitor = None if own else self._timing_monitor
                if why := '' if monitor is None else monitor.deviation(self.timing):
                    text += f', it {why}'
            self._step(GoalEvent.AT_GOAL)
            self._on_end(Outcome(End.SUCCEEDED, ErrorCode.SUCCESSFUL, text))
        elif now - max(self._standstill.alive, self._due) > SETTLE_TIME_S:
            self.fault(self._arrival.shortfall(), ErrorCode.GOAL_TOLERANCE_VIOLATED)

    def _check_timeouts(self, now: float) -> None:
        if self.ended:
            return
        waited = now - self._standstill.alive
        timeout = self.settings.reply_timeout
        late = self._plan_time - self.goal.trajectory.duration
        if self.state in RUNNING_STATES and 0.0 < self.goal.goal_time < late:
            self.fault(
                f'not at the goal after {self._plan_time:.3g} s: the plan takes '
                f'{self.goal.trajectory.duration:.3g} s, and the goal_time tolerance is '
                f'{self.goal.goal_time:g} s',
                ErrorCode.GOAL_TOLERANCE_VIOLATED,
            )
        elif self._schedule is not None and self.state is GoalState.STREAMING:
            if min(waited - self._schedule.duration, now - self._due) > timeout:
                self._abort(
                    GoalEvent.NO_REPLY,
                    f'no reply to {self._name(self.point)}: the arm has not moved for '
                    f'{waited:.3g} s',
                )
        elif self.state in COUNTED_STATES and min(waited, now - self._due) > timeout:
            self._abort(
                GoalEvent.NO_REPLY,
                f'the controller did not confirm the standstill within {waited:.3g} s',
            )

    @property
    def _plan_time(self) -> float:
        return 0.0 if self._schedule is None else self._schedule.clock.time

    def _exclude_unscheduled_time(self, now: float, gap: float) -> None:
        """Exclude the time during which this process was not scheduled from the reply timeout."""
        excluded = gap - MAX_COUNTED_GAP_S
        if excluded > 0.0:
            self._standstill.alive += excluded
            if self._due < now:
                self._due = min(self._due + excluded, now)

    def _advance_clock(self, robot: RobotState, sample: JointSample, now: float) -> None:
        """Advance the plan's clock to the measurement time of the joints, unless paused."""
        moves = self.state in RUNNING_STATES
        clock = None if self._schedule is None else self._schedule.clock
        if clock is not None:
            clock.advance(sample.measured, running=moves and not self._pause.interrupted)
        if robot.status is not None:
            self._pause.update(robot.status)
        if clock is None or self._schedule is None:
            return
        if moves and self.paused:
            self._standstill.alive = now
        if moves and self._schedule.ahead(self.target):
            self._due = max(self._due, now)

    def _check_path(self, sample: JointSample, now: float) -> None:
        tolerance = self.goal.path_tolerance
        is_new, self._checked = sample is not self._checked, sample
        if (
            tolerance is None
            or self._schedule is None
            or self.state not in RUNNING_STATES
            or self._pause.interrupted
            or not is_new
            or self._plan_time >= self.goal.trajectory.duration
        ):
            return
        positions, velocities = self._schedule.clock.desired()
        violation = tolerance.violation(
            self.goal.trajectory.joint_names,
            positions - sample.positions,
            velocities - sample.velocities,
            self.goal.unit,
        )
        if violation is None:
            return
        self._rejection = (
            f'path tolerance violated ({self.where}, {self._plan_time:.3g} s): {violation}'
        )
        outcome = Outcome(
            End.ABORTED,
            ErrorCode.PATH_TOLERANCE_VIOLATED,
            f'{self._rejection}, the arm was stopped and is at rest',
        )
        self._stop(GoalEvent.STOP, outcome, now)

    def _send_point(self, now: float) -> None:
        if self._schedule is None:
            return
        index = self.point
        message = self._schedule.message(index, now)
        try:
            self._send(message, partial(self.on_reply, index))
        except ConnectionError as error:
            self.fault(f'{self._name(index)} could not be sent: {error}')

    def _step(self, event: GoalEvent) -> None:
        self.aftermath = AFTERMATH.get((self.state, event), UNKNOWN)
        self.state = TRANSITIONS[self.state, event]

    def _name(self, index: int) -> str:
        return f'point {index} of {0 if self._schedule is None else len(self._schedule)}'
