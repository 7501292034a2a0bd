# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The execution of one goal, from the first point to its one outcome.

The rules, and what may follow what, are in goal_states.py.

The object has no clock and no I/O: it is told what happened and when, and it sends through the
callable it was given.
"""

import contextlib
import logging
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property, partial

import numpy as np

from epson_driver.driver.delivery.reply_rejection import reply_rejection
from epson_driver.driver.delivery.trajectory_points import STOP
from epson_driver.driver.goal.goal import Arrival, Goal, GoalSettings, late_start
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
from epson_driver.driver.goal.lead import Lead
from epson_driver.driver.goal.planned_speed import PlannedSpeed, Timing
from epson_driver.driver.goal.reference import PointSchedule, SpeedScaling
from epson_driver.driver.goal.splice import LATEST_SHARE, SplicedTrajectory, SplicePoint
from epson_driver.driver.outcome import End, ErrorCode, Outcome
from epson_driver.driver.state.robot_state import JointSample, PauseDetector, RobotState
from epson_driver.driver.state.standstill import (
    UNCONFIRMED_REST_TIME_S,
    UNSAID_REST_TIME_S,
    Standstill,
)
from epson_driver.link.replies import sequence_of
from epson_driver.motion import Array, Trajectory
from epson_driver.simple_message import Message, MotionReply, Packet, TriState

SETTLE_TIME_S = 1.0
"""How long an arm may stand beside the goal after the last reply before that is a failure, s."""

MAX_COUNTED_GAP_S = 0.5
"""Time from one state to the next that counts as waiting, s: what is longer is this process not
scheduled, or a silent controller, which the link sees by itself (receive_timeout.py)."""

REPLACED = 'replaced by a new goal'

_log = logging.getLogger(__name__)

Send = Callable[[Message, Callable[[Packet, float], None]], object]
"""send(message, on_reply) posts a request; on_reply(packet, now) is called when its reply comes.
Raises ConnectionError if there is no link."""

Successor = Callable[[SplicePoint, float], bool]
"""successor(point, now) has another goal go on, or stops this one; False: it does neither."""


class GoalExecution:
    """Streams a goal's points, decides its outcome and calls `on_end` with it exactly once.

    Times (`now`) are monotonic, s. `lead`: how far ahead of the plan's clock points are
    sent; None: without a limit, and the goal is not left on its way.
    """

    def __init__(
        self,
        goal: Goal,
        settings: GoalSettings,
        send: Send,
        on_end: Callable[[Outcome], None],
        now: float,
        scaling: SpeedScaling | None = None,
        lead: Lead | None = None,
        planned_speed: PlannedSpeed | None = None,
    ) -> None:
        self.goal = goal
        self.settings = settings
        self.state = GoalState.PREPARING
        self.aftermath = UNKNOWN
        """What is known of the arm when the goal has ended."""
        self.timing: Timing | None = None
        """How long the plan took, once the goal has succeeded."""
        self.started = now
        self.point = 0
        """How many points were taken: the index of the one that is on its way."""
        self._send = send
        self._on_end = on_end
        self._scaling = scaling or SpeedScaling()
        self._schedule: PointSchedule | None = None
        self._standstill = Standstill(now)
        self._pause = PauseDetector()
        self._rest_at: float | None = None
        self._checked: JointSample | None = None
        self._due = 0.0  # when the plan was to be where the next answer or the standstill comes
        self._looked = now
        self._when_at_rest = Outcome(End.ABORTED, ErrorCode.INVALID_GOAL, 'stopped')
        self._rejection = ''
        self._rejected_at = 0.0
        self._cause_waited = 0.0
        self._lead = lead
        self.leavable = True
        """Whether it may be left on its way."""
        self.on_sent: Callable[[], None] = lambda: None
        """Called when a point was sent."""
        self._planned_speed = planned_speed
        self._successor: Successor | None = None
        self._leave_by = math.inf  # when it should have been left for the successor
        self._sequence = 0  # of the point that was sent last
        self._goes_on = False

    @property
    def paused(self) -> bool:
        """True while the controller is paused: the motion waits for it."""
        return self._pause.paused

    @property
    def desired(self) -> tuple[float, Array, Array] | None:
        """Where the plan is: its time in s, positions and velocities, shape (n,), rad and rad/s.

        None before the goal is prepared. Velocities are 0 while the plan waits and at its end.
        """
        if self._schedule is None:
            return None
        clock = self._schedule.clock
        return min(clock.time, self.goal.trajectory.duration), *clock.desired()

    def speed(self, now: float) -> float:
        """Return the share of the planned speed that the goal runs at: 0 while it is paused."""
        return 0.0 if self.paused else self._scaling.factor(now)

    @property
    def target(self) -> int:
        """Index of the trajectory's point that the arm is on its way to."""
        return 0 if self._schedule is None else min(self.point, len(self._schedule) - 1)

    @property
    def where(self) -> str:
        """How far the goal has come, as a clause."""
        preparing = self.state is GoalState.PREPARING
        return 'before its first point' if preparing else f'on the way to point {self.target}'

    @property
    def ended(self) -> bool:
        """True once the outcome is known."""
        return self.state in FINAL_STATES

    @property
    def reach(self) -> float | None:
        """How far ahead of the clock the points reach that were sent, s.

        None unless some were, the goal runs, and the controller is not paused.
        """
        if self._schedule is None or self.state not in RUNNING_STATES or self.paused:
            return None
        last = self.point if self._in_flight else self.point - 1
        return None if last < 0 else self._schedule.ahead(last)

    @property
    def _in_flight(self) -> bool:
        """Whether a point is on its way to the controller, or its reply."""
        schedule = self._schedule
        return self.state is GoalState.STREAMING and schedule is not None and not schedule.waits

    def start(
        self,
        trajectory: Trajectory,
        points: Sequence[Message],
        now: float,
        at: Array | None = None,
        begin_within: float = 0.0,
        scaled_from: int | None = None,
    ) -> None:
        """Send the first point of a prepared trajectory unless the goal was stopped before.

        `trajectory` is what is executed: the goal's own, or what was made of it. `at`: shape
        (n,), rad, where the arm stands, if that is not the first point. `begin_within`: how long
        from now on the controller lets the arm stand before it moves, s; the plan begins then.
        `scaled_from`: as of the schedule.
        """
        if self.state is not GoalState.PREPARING:
            return
        self.goal = replace(self.goal, trajectory=trajectory)
        start = trajectory.positions[0] if at is None else at
        self._due = now + begin_within
        schedule = PointSchedule(
            trajectory,
            points,
            start,
            self._scaling,
            self._due,
            lead=self._lead,
            scaled_from=scaled_from,
        )
        self._begin(schedule, now)

    @property
    def schedule(self) -> PointSchedule | None:
        """The points while some are to be sent, else None."""
        return self._schedule if self.state is GoalState.STREAMING else None

    def go_on_with(
        self, trajectory: Trajectory, points: Sequence[Message], known: int, now: float
    ) -> None:
        """Execute another trajectory from the points on that were not sent, see PointSchedule."""
        if self._schedule is not None and self.state is GoalState.STREAMING:
            self.goal = replace(self.goal, trajectory=trajectory)
            self._schedule.replace(trajectory, points, known)
            if self._schedule.waits:
                self._send_point(now)

    def go_on(
        self,
        spliced: SplicedTrajectory,
        points: list[Message],
        left: SplicePoint,
        now: float,
    ) -> None:
        """Send the first point that the controller does not have yet.

        It has those before from the goal that was `left`.
        """
        self.goal = replace(self.goal, trajectory=spliced.trajectory)
        self._goes_on = True
        self._due = now
        self._sequence = left.sequence
        self.point = spliced.first
        schedule = PointSchedule(
            spliced.trajectory,
            points,
            spliced.trajectory.positions[0],
            self._scaling,
            left.seen,
            lead=self._lead,
            sent=spliced.factors,
            sent_until=left.sent_until,
        )
        self._begin(schedule, now)

    @cached_property
    def _arrival(self) -> Arrival:
        """The comparison of the arm with the end of the goal, once that is prepared."""
        return Arrival(self.goal)

    def _begin(self, schedule: PointSchedule, now: float) -> None:
        self.started = self._standstill.alive = now
        self._schedule = schedule
        self._step(GoalEvent.PREPARED)
        self._send_point(now)

    def replace(self, successor: Successor, now: float) -> None:
        """Have `successor` called as soon as no point is on its way, or stop for the next goal.

        It is stopped at once unless it may be left on its way (`lead`, splice.py), and when
        that does not come soon. Until then what ends it ends it, and nobody is called.
        """
        if self._lead is None or not self.leavable:
            self.stop(REPLACED, now)
            return
        reach, latest = self.reach, LATEST_SHARE * self._lead.most
        if reach is None:
            self.stop_for_next('it could not be left on the way', now)
        elif reach > latest:
            text = f'the controller has points of it for {reach:.2g} s, more than {latest:.2g} s'
            self.stop_for_next(text, now)
        else:
            self._successor = successor
            self._leave_by = min(self._leave_by, now + latest)
            if not self._in_flight:
                self._splice(now)

    @property
    def replacing(self) -> bool:
        """True while a replacement waits for the controller's reply to a point."""
        return self._successor is not None

    def keep(self) -> None:
        """Go on: no goal waits for this one to be left any more."""
        self._successor, self._leave_by = None, math.inf

    def stop_for_next(self, why: str, now: float) -> None:
        """Stop for the next goal, as this one cannot be left on its way."""
        self.keep()
        _log.info('the running motion is stopped for the new one: %s', why)
        self.stop(REPLACED, now)

    def end_spliced(self) -> None:
        """End as aborted, as another goal goes on from where this one is."""
        where = self.where
        self._step(GoalEvent.SPLICED)
        text = f'replaced by a new goal {where}; the arm goes on to that one without a stop'
        self._on_end(Outcome(End.ABORTED, ErrorCode.INVALID_GOAL, text))

    def _splice(self, now: float) -> bool:
        """Replace the goal if a replacement waits, and return whether it was replaced."""
        successor = self._successor
        self.keep()
        if successor is None or self._schedule is None or self.state not in RUNNING_STATES:
            return False
        clock = self._schedule.clock
        point = SplicePoint(
            self.goal.trajectory,
            self.point - 1,
            self._sequence,
            self._schedule.sent_until,
            clock.time,
            clock.seen,
            *clock.planned(),
            clock.factors,
        )
        return successor(point, now)

    def on_reply(self, index: int, packet: Packet, now: float) -> None:
        """Take the controller's reply to point `index`."""
        if self.state is not GoalState.STREAMING or index != self.point:
            if self.state in UNCONFIRMED_STATES:
                self._take_late_reply(packet, now)
            return
        self._standstill.alive = now
        if (no := reply_rejection(packet)) is not None:
            self._reject(f'the controller refused {self._name(index)} ({no})', now)
            return
        self.point += 1
        if self._successor is not None and self._splice(now):
            return
        if self._schedule is not None and self.point < len(self._schedule):
            self._send_point(now)
        else:
            self._standstill.expect(max(now, self._due))
            self._step(GoalEvent.LAST_REPLY)

    def on_unsolicited_failure(self, now: float) -> None:
        """Take a negative reply to something that the controller had acknowledged before."""
        if self.state in RUNNING_STATES:
            where = self._name(self.target)
            self._reject(f'the controller withdrew an acknowledgement before {where}', now)

    def on_state(self, robot: RobotState, now: float) -> None:
        """Look at the robot state, after new joints or a new status came."""
        sample = robot.sample
        if self.ended or sample is None:
            return
        if now > self._leave_by:
            self.stop_for_next('the point that is on its way was not answered in time', now)
        looked, self._looked = self._looked, now
        self._exclude_unscheduled_time(now, now - looked)
        self._keep_time(robot, sample, now)
        if self._schedule is not None:
            self._arrival.see(sample.positions)
        self._standstill.see(sample, robot, self._stopped(), now)
        if not self._standstill.stands:
            self._rest_at = None
        elif self._rest_at is None:
            self._rest_at = self._plan_time
        if self.state in REJECTED_STATES:
            self._look_for_cause(robot, now - max(looked, self._rejected_at))
            return
        said = robot.in_motion != TriState.UNKNOWN
        if self.state is GoalState.SETTLING and not said:
            self._standstill.expect_rest(UNSAID_REST_TIME_S)
        if self._standstill.reached(sample.measured):
            if self.state is GoalState.SETTLING:
                self._judge(now, said=said)
            elif self.state in BRAKING_STATES:
                self._rest()
        self._check_path(sample, now)
        self._check_patience(now)

    def cancel(self, now: float) -> None:
        """Stop because the goal was canceled: it ends as canceled when the arm stands."""
        outcome = Outcome(End.CANCELED, ErrorCode.SUCCESSFUL, 'canceled; the arm stands')
        self._stop(GoalEvent.CANCEL, outcome, now)

    def stop(self, why: str, now: float) -> None:
        """Stop for another reason: the goal ends as aborted when the arm stands."""
        outcome = Outcome(End.ABORTED, ErrorCode.INVALID_GOAL, f'{why}; the arm stands')
        self._stop(GoalEvent.STOP, outcome, now)

    def fault(self, why: str, code: ErrorCode = ErrorCode.PATH_TOLERANCE_VIOLATED) -> None:
        """End now, as something forbids motion, with STOP if anything was sent."""
        if not self.ended:
            self._end_at_once(GoalEvent.FAULT, why, code)

    def _end_at_once(
        self,
        event: GoalEvent,
        why: str,
        code: ErrorCode = ErrorCode.PATH_TOLERANCE_VIOLATED,
        unexplained: bool = False,
    ) -> None:
        needs_stop = self.state is not GoalState.PREPARING and self.state not in REJECTED_STATES
        text = f'{self._rejection}: {why}' if self._rejection else why
        self._step(event)
        if needs_stop:
            self._send_stop()
        self._on_end(Outcome(End.ABORTED, code, text, unexplained))

    def _reject(self, why: str, now: float) -> None:
        """Stop, as the controller rejected a point, and wait for the STATUS that says why."""
        self._rejection, self._rejected_at = why, now
        self._cause_waited = 0.0
        statement = self._schedule is not None and math.isinf(self._schedule.duration)
        taken = self.point > 0 or self._goes_on or statement  # which may have moved the arm
        self._step(GoalEvent.REJECTION_MIDWAY if taken else GoalEvent.REJECTION)
        self._send_stop()

    def _look_for_cause(self, robot: RobotState, gap: float) -> None:
        """End a rejected goal with the cause in the first status after the rejection, if it comes.

        Of the time since the last look, `gap`, s, only a part of the patience counts: a status
        that came while this process was not scheduled is read before the next look.
        """
        status = robot.status
        told = status is not None and robot.status_time > self._rejected_at
        patience = self.settings.cause_timeout
        self._cause_waited += min(gap, patience / 2)
        if told and status and not status.error_code and robot.in_motion == TriState.TRUE:
            # It brakes: what makes it do so may only show when it stands, as motors off do.
            told = self._cause_waited > self.settings.reply_timeout
            patience = self.settings.reply_timeout
        if status is not None and told:
            if error := status.error_code:
                self.fault(f'controller error {robot.errors.phrase(error)}')
            else:
                self._end_at_once(GoalEvent.FAULT, 'it reports no error', unexplained=True)
        elif self._cause_waited > patience:
            self._end_at_once(GoalEvent.FAULT, 'no status came that says why', unexplained=True)

    def _send_stop(self) -> None:
        with contextlib.suppress(ConnectionError):  # without a link the controller stops itself
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

    def _take_late_reply(self, packet: Packet, now: float) -> None:
        """Take an answer to a point that may be the one to STOP, after which it came.

        If the point's own never comes, STOP's takes its place; then the state decides.
        """
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

    def _rest(self) -> None:
        """End the goal: the arm stands after STOP."""
        outcome = self._when_at_rest
        if self.state in UNCONFIRMED_STATES:
            outcome = replace(outcome, text=f'{outcome.text}, but a reply is missing')
        self._step(GoalEvent.AT_REST)
        self._on_end(outcome)

    def _stopped(self) -> Array:
        """Return the velocities below which the joints count as standing, rad/s, shape (n,)."""
        stopped = np.full(len(self.goal.trajectory.joint_names), self.settings.stopped_velocity)
        if self.goal.goal_velocity is not None:
            stopped = np.minimum(stopped, self.goal.goal_velocity)
        return stopped

    def _judge(self, now: float, *, said: bool) -> None:
        """Decide whether an arm that stands, with all points acknowledged, is at the goal.

        `said`: the controller says so.
        """
        pace = self._scaling.pace(now)
        if self.paused or not pace:  # it may have a rest of the way to go
            return
        if self._plan_time < self.goal.trajectory.duration:
            return  # what is planned may be yet to come, however short a way
        if self._arrival.reached(said=said):
            text = f'at the goal after {now - self.started:.2f} s'
            text += late_start(self.goal.start, self.started)
            if self._rest_at is not None:
                self.timing = Timing(self.goal.trajectory.duration, self._rest_at)
                text += self._other_speed(self.timing)
            self._step(GoalEvent.AT_GOAL)
            self._on_end(Outcome(End.SUCCEEDED, ErrorCode.SUCCESSFUL, text))
        elif now - max(self._standstill.alive, self._due) > SETTLE_TIME_S / pace:
            self.fault(self._arrival.shortfall(), ErrorCode.GOAL_TOLERANCE_VIOLATED)

    def _other_speed(self, timing: Timing) -> str:
        """Return a clause on a goal that ran at another speed than planned, or ''."""
        own = self.goal.message is not None  # the controller's own pace
        why = '' if self._planned_speed is None or own else self._planned_speed.deviation(timing)
        if not why:
            return ''
        _log.warning('a motion ran at another speed than planned: %s', why)
        return f'; {why}'

    def _check_patience(self, now: float) -> None:
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
                self._end_at_once(
                    GoalEvent.NO_REPLY,
                    f'no reply to {self._name(self.point)}: the arm has not moved for '
                    f'{waited:.3g} s',
                )
        elif self.state is not GoalState.PREPARING and min(waited, now - self._due) > timeout:
            self._end_at_once(
                GoalEvent.NO_REPLY,
                f'the controller did not confirm the standstill within {waited:.3g} s',
            )

    @property
    def _plan_time(self) -> float:
        """Where the plan is, s, or 0 before it is prepared."""
        return 0.0 if self._schedule is None else self._schedule.clock.time

    def _exclude_unscheduled_time(self, now: float, gap: float) -> None:
        """Exclude time in which this process was not scheduled from the reply timeout.

        `gap`: s since somebody looked.
        """
        unseen = gap - MAX_COUNTED_GAP_S
        if unseen > 0.0:
            self._standstill.alive += unseen
            if self._due < now:
                self._due = min(self._due + unseen, now)

    def _keep_time(self, robot: RobotState, sample: JointSample, now: float) -> None:
        """Advance the clock, detect a pause, and send a point that was held back.

        The plan is where it was when the joints were measured: they may have waited since, in the
        network or for this process.
        """
        moves = self.state in RUNNING_STATES
        clock = None if self._schedule is None else self._schedule.clock
        if clock is not None:
            runs = moves and not self._pause.interrupted
            clock.advance(sample.measured, running=runs)
            if runs and self._scaling.at_once:
                clock.follow(sample.positions)
            if runs and self._lead is not None:
                desired, velocity = clock.desired()
                self._lead.see(desired - sample.positions, velocity)
        if robot.status is not None:
            self._pause.see(robot.status)
        if clock is None or self._schedule is None:
            return
        if self._schedule.waits and self.state is GoalState.STREAMING:
            self._send_point(now)
        if moves and (self.paused or clock.held or not self._scaling.pace(now)):
            self._standstill.alive = now
        if moves and self._schedule.ahead(self.target):
            self._due = max(self._due, now)

    def _check_path(self, sample: JointSample, now: float) -> None:
        """Hold new joints against where the plan was when they were measured."""
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
            f'path tolerance violated {self.where}, {self._plan_time:.3g} s: {violation}'
        )
        outcome = Outcome(
            End.ABORTED,
            ErrorCode.PATH_TOLERANCE_VIOLATED,
            f'{self._rejection}; the arm was stopped and stands',
        )
        self._stop(GoalEvent.STOP, outcome, now)

    def _send_point(self, now: float) -> None:
        """Send the next point at the speed of the moment, or hold it back while that is 0."""
        index = self.point
        message = None if self._schedule is None else self._schedule.message(index, now)
        if message is None:
            return
        self._sequence = getattr(message, 'sequence', 0)
        try:
            self._send(message, partial(self.on_reply, index))
        except ConnectionError as error:
            self.fault(f'{self._name(index)} could not be sent: {error}')
        else:
            self.on_sent()

    def _step(self, event: GoalEvent) -> None:
        self.aftermath = AFTERMATH.get((self.state, event), UNKNOWN)
        self.state = TRANSITIONS[self.state, event]

    def _name(self, index: int) -> str:
        return f'point {index} of {0 if self._schedule is None else len(self._schedule)}'
