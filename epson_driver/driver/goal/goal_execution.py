# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""One goal on its way through the controller, from the first point to its one outcome.

The rules, and what may follow what, are in goal_states.py.

The object has no clock and no I/O: it is told what happened and when, and it sends through the
callable it was given.
"""

import contextlib
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from epson_driver.driver.delivery.reply_rejection import reply_rejection
from epson_driver.driver.delivery.trajectory_points import MIN_DURATION_S, STOP
from epson_driver.driver.goal.goal import Goal
from epson_driver.driver.goal.goal_clock import GoalClock
from epson_driver.driver.goal.goal_states import FINAL_STATES, TRANSITIONS, GoalEvent, GoalState
from epson_driver.driver.goal.speed_scaling import SpeedScaling, scaled
from epson_driver.driver.outcome import End, ErrorCode, Outcome
from epson_driver.driver.state.controller_pause import PauseDetector
from epson_driver.driver.state.robot_state import JointSample, RobotState
from epson_driver.driver.state.standstill import UNCONFIRMED_REST_TIME_S, Standstill
from epson_driver.link.replies import sequence_of
from epson_driver.motion import Array, Trajectory
from epson_driver.profiles.profile import StateProfile
from epson_driver.simple_message import Message, MotionReply, Packet, TriState

SETTLE_TIME_S = 1.0
"""How long an arm may stand beside the goal after the last reply before that is a failure, s."""

CAUSE_TIMEOUT_S = 0.095
"""How long a refused goal waits for the STATUS that says why, s. EPSON's comes every 55 ms."""

CAUSE_TIMEOUT_MARGIN_S = 0.04
"""What it waits beyond the time between two of them, s."""

MAX_COUNTED_GAP_S = 0.5
"""Time from one state to the next that counts as waiting, s: what is longer is this process not
scheduled, or a controller that is silent, which the driver sees by itself (link/silence.py)."""

Send = Callable[[Message, Callable[[Packet, float], None]], object]
"""send(message, on_reply) posts a request; on_reply(packet, now) is called when its reply comes.
Raises ConnectionError if there is no link."""


@dataclass(frozen=True, slots=True)
class GoalSettings:
    """Tolerances and patience of an execution.

    stopped_velocity: rad/s, below which a joint counts as standing. reply_timeout: s without a
    reply and without the arm moving, beyond the planned duration of the point. cause_timeout: how
    long a refused goal waits for the STATUS that says why, s.
    """

    stopped_velocity: float = 0.01
    reply_timeout: float = 5.0
    cause_timeout: float = CAUSE_TIMEOUT_S


def cause_timeout(state: StateProfile) -> float:
    """Return how long to wait for a STATUS of a controller with this profile, s."""
    return state.period * (state.joint_positions_per_status + 1) + CAUSE_TIMEOUT_MARGIN_S


class GoalExecution:
    """Streams a goal's points and decides its outcome; `on_end` is called with it exactly once.

    Times (`now`) are monotonic, s.
    """

    def __init__(
        self,
        goal: Goal,
        settings: GoalSettings,
        send: Send,
        on_end: Callable[[Outcome], None],
        now: float,
        scaling: SpeedScaling | None = None,
    ) -> None:
        self.goal = goal
        self.state = GoalState.PREPARING
        self.started = now
        self.point = 0
        self._points: list[Message] = []
        self._begins_by = 0.0
        self._looked = now
        self.settings = settings
        self._send = send
        self._on_end = on_end
        self._when_at_rest = Outcome(End.ABORTED, ErrorCode.INVALID_GOAL, 'stopped')
        self._standstill = Standstill(now)
        self._rejection = ''
        self._refused_at = 0.0
        self.at_rest = False
        """The goal has ended and the arm stands: not after a fault."""
        self.broken_off = False
        """Nobody knows what the controller will do with the points it has taken."""
        self.unanswered = False
        """It broke off because no answer came in time: one may come later."""
        self._confirmed = False
        self._left = False
        self._must_leave = _must_leave(goal)
        self._pause = PauseDetector()
        self._scaling = scaling or SpeedScaling()
        self._clock: GoalClock | None = None
        self._due = 0.0
        self._delay = 0.0
        self._sent_until = 0.0

    @property
    def paused(self) -> bool:
        """True while the controller is paused: the goal waits for it."""
        return self._pause.paused

    @property
    def desired(self) -> tuple[float, Array, Array] | None:
        """Where the plan is: its time in s, positions and velocities, shape (n,), rad and rad/s.

        None before the goal is prepared. Velocities are 0 while the plan waits and at its end.
        """
        if self._clock is None:
            return None
        return min(self._clock.time, self.goal.trajectory.duration), *self._clock.desired()

    def speed(self, now: float) -> float:
        """Return the share of the planned speed that the goal runs at: 0 while it is paused."""
        return 0.0 if self.paused else self._scaling.factor(now)

    @property
    def target(self) -> int:
        """Index of the trajectory's point that the arm is on its way to."""
        return max(min(self.point, len(self._points) - 1), 0)

    @property
    def where(self) -> str:
        """How far it is, in words."""
        preparing = self.state is GoalState.PREPARING
        return 'before its first point' if preparing else f'on the way to point {self.target}'

    @property
    def ended(self) -> bool:
        """True once the outcome is known."""
        return self.state in FINAL_STATES

    def start(
        self,
        trajectory: Trajectory,
        points: list[Message],
        now: float,
        at: Array | None = None,
        begin_within: float = 0.0,
    ) -> None:
        """Send the first point of a prepared trajectory; nothing if the goal was stopped before.

        `trajectory` is what is executed: the goal's own, or what was made of it. `at`: shape
        (n,), rad, where the arm stands, if that is not the first point. `begin_within`: how long
        from now on the controller lets the arm stand before it moves, s; the plan begins then.
        """
        if self.state is not GoalState.PREPARING:
            return
        self.goal = replace(self.goal, trajectory=trajectory)
        self._must_leave = _must_leave(self.goal)
        self._points = points
        self._begins_by = self._sent_until = now + begin_within
        self.started = self._standstill.alive = now
        start = trajectory.positions[0] if at is None else at
        self._clock = GoalClock(trajectory, start, self._scaling, self._begins_by)
        self._step(GoalEvent.PREPARED)
        self._send_point(now)

    def on_reply(self, index: int, packet: Packet, now: float) -> None:
        """The controller answered point `index`."""
        if self.state in (GoalState.CANCELING, GoalState.STOPPING) and not self._confirmed:
            self._doubt_reply(packet, now)
        if self.state is not GoalState.STREAMING or index != self.point:
            return
        self._standstill.alive = now
        if (no := reply_rejection(packet)) is not None:
            self._refuse(f'the controller refused {self._name(index)} ({no})', now)
            return
        self.point += 1
        if self.point < len(self._points):
            self._send_point(now)
        else:
            self._standstill.expect(max(now, self._begins_by))
            self._step(GoalEvent.LAST_REPLY)

    def on_unsolicited_failure(self, now: float) -> None:
        """The controller sent a negative reply for something it had acknowledged before."""
        if self.state in (GoalState.STREAMING, GoalState.SETTLING):
            where = self._name(self.target)
            self._refuse(f'the controller withdrew an acknowledgement before {where}', now)

    def on_state(self, robot: RobotState, now: float) -> None:
        """New joints or a new status came."""
        sample = robot.sample
        if self.ended or sample is None:
            return
        self._forgive(now)
        self._keep_time(robot, now)
        distance = np.abs(sample.positions - self.goal.trajectory.positions[-1])
        self._left = self._left or float(distance.max()) >= self._must_leave
        self._standstill.see(sample, robot, self._stopped(), now)
        if self.state is GoalState.REJECTED:
            self._look_for_cause(robot, now)
            return
        if self._standstill.reached(sample.measured):
            if self.state is GoalState.SETTLING:
                self._judge(distance, now)
            elif self.state in (GoalState.CANCELING, GoalState.STOPPING):
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
        """Something forbids going on: send STOP if anything was sent, and end now."""
        if self.ended:
            return
        refused, unsent = self.state is GoalState.REJECTED, self.state is GoalState.PREPARING
        text = f'{self._rejection}: {why}' if self._rejection else why
        outcome = Outcome(End.ABORTED, code, text)
        self.state = TRANSITIONS[self.state, GoalEvent.FAULT]
        if not refused and not unsent:
            self._send_stop()
        self._on_end(outcome)

    def _refuse(self, why: str, now: float) -> None:
        self._rejection, self._refused_at = why, now
        self.broken_off = self.point > 0
        self._step(GoalEvent.REJECTION)
        self._send_stop()

    def _look_for_cause(self, robot: RobotState, now: float) -> None:
        """End a refused goal with what the first status after the rejection says, if it comes."""
        told = robot.status is not None and robot.status_time > self._refused_at
        waited = now - self._refused_at
        status = robot.status
        if told and status and not status.error_code and robot.in_motion == TriState.TRUE:
            # It brakes: what makes it do so may only show when it stands, as motors off do.
            told = waited > self.settings.reply_timeout
            waited = 0.0
        if robot.status is not None and told:
            error = robot.status.error_code
            text = robot.errors.phrase(error)
            self.fault(f'controller error {text}' if error else 'it reports no error')
        elif waited > self.settings.cause_timeout:
            self.fault('no status came that says why')

    def _send_stop(self) -> None:
        with contextlib.suppress(ConnectionError):  # without a link the controller stops itself
            self._send(STOP, lambda _packet, _now: None)

    def _stop(self, event: GoalEvent, outcome: Outcome, now: float) -> None:
        if (self.state, event) not in TRANSITIONS:
            return
        self._when_at_rest = outcome
        already = self.state in (GoalState.CANCELING, GoalState.STOPPING)
        self._step(event)
        if already:
            return
        self._standstill.alive = now
        self._standstill.expect(None)
        try:
            self._send(STOP, self._on_stop_reply)
        except ConnectionError as error:
            self.fault(f'STOP could not be sent: {error}')

    def _doubt_reply(self, packet: Packet, now: float) -> None:
        """Take an answer to a point that may be the one to STOP, after which it came.

        If the point's own never comes, STOP's takes its place; then the state decides.
        """
        message = packet.message
        if not isinstance(message, MotionReply) and not sequence_of(message):
            self._standstill.expect(now, UNCONFIRMED_REST_TIME_S)

    def _on_stop_reply(self, packet: Packet, now: float) -> None:
        if (no := reply_rejection(packet)) is None:
            self._confirmed = True
            self._standstill.expect(now)
        else:
            self.fault(f'the controller refused STOP ({no})')

    def _rest(self) -> None:
        """The arm stands after STOP: the goal ends."""
        outcome = self._when_at_rest
        if not self._confirmed:
            self.broken_off = self.unanswered = True
            outcome = replace(outcome, text=f'{outcome.text}, but a reply is missing')
        self._step(GoalEvent.AT_REST, outcome)

    def _stopped(self) -> Array:
        """Return the velocities below which the joints count as standing, rad/s, shape (n,)."""
        stopped = np.full(len(self.goal.trajectory.joint_names), self.settings.stopped_velocity)
        if self.goal.goal_velocity is not None:
            stopped = np.minimum(stopped, self.goal.goal_velocity)
        return stopped

    def _judge(self, distance: Array, now: float) -> None:
        """All points are acknowledged and the arm stands: decide whether it is at the goal."""
        tolerance = self.goal.goal_tolerance
        if self.paused:  # it may have a rest of the way to go
            return
        clock = self._clock
        if clock is not None and clock.time < self.goal.trajectory.duration:
            return  # what is planned may be yet to come, however short a way
        if self._left and np.all(distance <= tolerance):
            text = f'at the goal after {now - self.started:.2f} s'
            self._step(GoalEvent.AT_GOAL, Outcome(End.SUCCEEDED, ErrorCode.SUCCESSFUL, text))
        elif now - max(self._standstill.alive, self._begins_by) > SETTLE_TIME_S:
            joint = int(np.argmax(distance - tolerance))
            name, unit = self.goal.trajectory.joint_names[joint], self.goal.unit(joint)
            self.fault(
                f'the arm stands, and {name} is {distance[joint]:.6g} {unit} from the goal: '
                f'the tolerance is {tolerance[joint]:.6g} {unit}'
                if self._left
                else 'the controller acknowledged all points, but the arm did not move',
                ErrorCode.GOAL_TOLERANCE_VIOLATED,
            )

    def _check_patience(self, now: float) -> None:
        if self.ended:
            return
        planned = self.goal.trajectory.duration
        took = 0.0 if self._clock is None else self._clock.time
        waited = now - self._standstill.alive
        timeout = self.settings.reply_timeout
        if self.state in (
            GoalState.STREAMING,
            GoalState.SETTLING,
        ) and 0.0 < self.goal.goal_time < (took - planned):
            self.fault(
                f'not at the goal after {took:.3g} s: the plan takes {planned:.3g} s, and the '
                f'goal_time tolerance is {self.goal.goal_time:g} s',
                ErrorCode.GOAL_TOLERANCE_VIOLATED,
            )
        elif self.state is GoalState.STREAMING and waited > timeout + self._due:
            self._break_off(
                f'no reply to {self._name(self.point)}: the arm has not moved for {waited:.3g} s'
            )
        elif (
            self.state not in (GoalState.PREPARING, GoalState.STREAMING)
            and min(waited, now - self._begins_by) > timeout
        ):
            self._break_off(f'the controller did not confirm the standstill within {waited:.3g} s')

    def _forgive(self, now: float) -> None:
        """Leave the time in which nobody looked out of the patience: a reply may be there."""
        unseen = now - self._looked - MAX_COUNTED_GAP_S
        self._looked = now
        if unseen > 0.0:
            self._standstill.alive += unseen

    def _break_off(self, why: str) -> None:
        self.broken_off = self.unanswered = True
        self.fault(why)

    def _keep_time(self, robot: RobotState, now: float) -> None:
        """Let the clock go on, see whether the controller is paused, and send what was held."""
        clock, moves = self._clock, self.state in (GoalState.STREAMING, GoalState.SETTLING)
        if clock is not None:
            clock.advance(now, running=moves and not self._pause.interrupted)
        if robot.status is not None:
            self._pause.see(robot.status)
        if clock is None:
            return
        if clock.held and self.state is GoalState.STREAMING:
            self._send_point(now)
        if moves and (self.paused or clock.held):
            self._standstill.alive = now

    def _check_path(self, sample: JointSample, now: float) -> None:
        """Hold what was measured just now against where the plan is."""
        tolerance, clock = self.goal.path_tolerance, self._clock
        if (
            tolerance is None
            or clock is None
            or self.state not in (GoalState.STREAMING, GoalState.SETTLING)
            or self._pause.interrupted
            or sample.time != now
            or clock.time >= self.goal.trajectory.duration
        ):
            return
        positions, velocities = clock.desired()
        violation = tolerance.violation(
            self.goal.trajectory.joint_names,
            positions - sample.positions,
            velocities - sample.velocities,
            self.goal.unit,
        )
        if violation is None:
            return
        self._rejection = f'path tolerance violated {self.where}, {clock.time:.3g} s: {violation}'
        outcome = Outcome(
            End.ABORTED,
            ErrorCode.PATH_TOLERANCE_VIOLATED,
            f'{self._rejection}; the arm was stopped and stands',
        )
        self._stop(GoalEvent.STOP, outcome, now)

    def _send_point(self, now: float) -> None:
        """Send the next point at the speed of the moment, or hold it back while that is 0."""
        clock, index = self._clock, self.point
        if clock is None:
            return
        before = float(self.goal.trajectory.times[index - 1]) if index else 0.0
        planned = max(float(self.goal.trajectory.times[index]) - before, MIN_DURATION_S)
        begin = max(now, self._sent_until)  # it runs after what was sent before
        takes = self._scaling.time_for(planned, begin)
        clock.held = takes is None
        if takes is None:
            return
        factor = planned / takes
        self._sent_until = begin + takes
        self._delay += takes - planned
        message = scaled(self._points[index], factor, self._delay)
        self._due = max(takes, getattr(message, 'duration', 0.0))
        clock.sent(factor)

        def on_reply(packet: Packet, now: float) -> None:
            self.on_reply(index, packet, now)

        try:
            self._send(message, on_reply)
        except ConnectionError as error:
            self.fault(f'{self._name(index)} could not be sent: {error}')

    def _step(self, event: GoalEvent, outcome: Outcome | None = None) -> None:
        self.state = TRANSITIONS[self.state, event]
        if outcome is not None:
            self.at_rest = True
            self._on_end(outcome)

    def _name(self, index: int) -> str:
        return f'point {index} of {len(self._points)}'


def _must_leave(goal: Goal) -> float:
    """Return how far from the goal the arm must have been seen, rad.

    On a path that ends where it began, an arm that has not moved yet is at the goal, too.
    """
    excursion = float(np.abs(goal.trajectory.positions - goal.trajectory.positions[-1]).max())
    finite = goal.goal_tolerance[np.isfinite(goal.goal_tolerance)]
    return excursion / 2 if excursion > 2 * float(finite.max(initial=0.0)) else 0.0
