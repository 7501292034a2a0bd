# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""One goal on its way through the controller, from the first point to its one outcome.

Rules:
1. Every change of a goal's state is a row of TRANSITIONS. The three final states have no row:
   a goal ends once. Nothing is sent for a goal before it is prepared: its motion may have to be
   planned first.
2. One point is on its way at a time; its reply lets the next one go (streaming, REP-I0006).
3. Success needs all replies positive, the arm at the goal within tolerance, and standing, as
   measured after the last reply.
4. Cancel, stop and replacement send STOP at once, never behind a pending reply, and end the goal
   when the arm stands. A fault sends STOP and ends the goal at once: it cannot wait for an arm
   that it may no longer see.
5. After a FAILURE reply STOP is sent, and the next STATUS is awaited for CAUSE_TIME at most: it
   has the reason.

The object has no clock and no I/O: it is told what happened and when, and it sends through the
callable it was given.
"""

import contextlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from epson_driver.client.goal import End, ErrorCode, Goal, Outcome
from epson_driver.client.points import STOP
from epson_driver.client.robot_state import JointSample, RobotState
from epson_driver.motion import Array, Trajectory
from epson_driver.simple_message import JointTrajPt, Message, Packet, ReplyCode, TriState


class State(Enum):
    """Where a goal is."""

    PREPARING = 'preparing'
    STREAMING = 'streaming'
    SETTLING = 'settling'
    REFUSED = 'refused'
    CANCELING = 'canceling'
    STOPPING = 'stopping'
    SUCCEEDED = 'succeeded'
    CANCELED = 'canceled'
    ABORTED = 'aborted'


class Event(Enum):
    """What happens to a goal."""

    PREPARED = 'prepared'
    LAST_REPLY = 'last reply'
    REFUSAL = 'refusal'
    AT_GOAL = 'at the goal'
    CANCEL = 'cancel'
    STOP = 'stop'
    AT_REST = 'at rest'
    FAULT = 'fault'


TRANSITIONS: dict[tuple[State, Event], State] = {
    (State.PREPARING, Event.PREPARED): State.STREAMING,
    (State.PREPARING, Event.CANCEL): State.CANCELING,
    (State.PREPARING, Event.STOP): State.STOPPING,
    (State.PREPARING, Event.FAULT): State.ABORTED,
    (State.STREAMING, Event.LAST_REPLY): State.SETTLING,
    (State.STREAMING, Event.REFUSAL): State.REFUSED,
    (State.STREAMING, Event.CANCEL): State.CANCELING,
    (State.STREAMING, Event.STOP): State.STOPPING,
    (State.STREAMING, Event.FAULT): State.ABORTED,
    (State.REFUSED, Event.FAULT): State.ABORTED,
    (State.SETTLING, Event.AT_GOAL): State.SUCCEEDED,
    (State.SETTLING, Event.REFUSAL): State.REFUSED,
    (State.SETTLING, Event.CANCEL): State.CANCELING,
    (State.SETTLING, Event.STOP): State.STOPPING,
    (State.SETTLING, Event.FAULT): State.ABORTED,
    (State.CANCELING, Event.AT_REST): State.CANCELED,
    (State.CANCELING, Event.FAULT): State.ABORTED,
    (State.STOPPING, Event.CANCEL): State.CANCELING,
    (State.STOPPING, Event.AT_REST): State.ABORTED,
    (State.STOPPING, Event.FAULT): State.ABORTED,
}

FINAL = frozenset({State.SUCCEEDED, State.CANCELED, State.ABORTED})

REST_TIME = 0.05
"""How long the arm must stand before it counts as standing, s: more than the velocity window."""

SETTLE_TIME = 1.0
"""How long an arm may stand beside the goal after the last reply before that is a failure, s."""

CAUSE_TIME = 0.07
"""How long a refused goal waits for the STATUS that says why, s. EPSON's comes every 55 ms."""

MOVED = 1e-4
"""A change of position that shows that the arm moves, rad: well above an encoder's step."""

Send = Callable[[Message, Callable[[Packet, float], None]], None]
"""send(message, on_reply) posts a request; on_reply(packet, now) is called when its reply comes.
Raises ConnectionError if there is no link."""


@dataclass(frozen=True, slots=True)
class Settings:
    """Tolerances and patience of an execution.

    stopped_velocity: rad/s, below which a joint counts as standing. reply_timeout: s without a
    reply and without the arm moving, beyond the planned duration of the point.
    """

    stopped_velocity: float = 0.01
    reply_timeout: float = 5.0


class Execution:
    """Streams a goal's points and decides its outcome; `on_end` is called with it exactly once.

    Times (`now`) are monotonic, s.
    """

    def __init__(
        self,
        goal: Goal,
        settings: Settings,
        send: Send,
        on_end: Callable[[Outcome], None],
        now: float,
    ) -> None:
        self.goal = goal
        self.state = State.PREPARING
        self.started = now
        self.point = 0
        self._points: list[JointTrajPt] = []
        self._settings = settings
        self._send = send
        self._on_end = on_end
        self._when_at_rest = Outcome(End.ABORTED, ErrorCode.INVALID_GOAL, 'stopped')
        self._alive = now
        self._alive_at: Array | None = None
        self._standing_since: float | None = None
        self._settling_since: float | None = None
        self._refusal = ''
        self._refused_at = 0.0
        self.at_rest = False
        """The goal has ended and the arm stands: not after a fault."""
        self._left = False
        self._must_leave = _must_leave(goal)

    @property
    def target(self) -> int:
        """Index of the trajectory's point that the arm is on its way to."""
        return max(min(self.point, len(self._points) - 1), 0)

    @property
    def where(self) -> str:
        """How far it is, in words."""
        preparing = self.state is State.PREPARING
        return 'before its first point' if preparing else f'on the way to point {self.target}'

    @property
    def ended(self) -> bool:
        """True once the outcome is known."""
        return self.state in FINAL

    def start(self, trajectory: Trajectory, points: list[JointTrajPt], now: float) -> None:
        """Send the first point of a prepared trajectory; nothing if the goal was stopped before.

        `trajectory` is what is executed: the goal's own, or what was made of it.
        """
        if self.state is not State.PREPARING:
            return
        self.goal = replace(self.goal, trajectory=trajectory)
        self._must_leave = _must_leave(self.goal)
        self._points = points
        self.started = self._alive = now
        self._step(Event.PREPARED)
        self._send_point()

    def on_reply(self, index: int, packet: Packet, now: float) -> None:
        """The controller answered point `index`."""
        if self.state is not State.STREAMING or index != self.point:
            return
        self._alive = now
        if packet.reply_code is not ReplyCode.SUCCESS:
            self._refuse(f'the controller refused {self._name(index)} (FAILURE reply)', now)
            return
        self.point += 1
        if self.point < len(self._points):
            self._send_point()
        else:
            self._settling_since = now
            self._standing_since = None
            self._step(Event.LAST_REPLY)

    def on_unsolicited_failure(self, now: float) -> None:
        """The controller sent a negative reply for something it had acknowledged before."""
        if self.state in (State.STREAMING, State.SETTLING):
            where = self._name(self.target)
            self._refuse(f'the controller withdrew an acknowledgement before {where}', now)

    def on_state(self, robot: RobotState, now: float) -> None:
        """New joints or a new status came."""
        sample = robot.sample
        if self.ended or sample is None:
            return
        distance = np.abs(sample.positions - self.goal.trajectory.positions[-1])
        self._left = self._left or float(distance.max()) >= self._must_leave
        self._watch_rest(sample, robot, now)
        if self.state is State.REFUSED:
            self._look_for_cause(robot, now)
            return
        if self._standing_since is not None and sample.time - self._standing_since >= REST_TIME:
            if self.state is State.SETTLING:
                self._judge(distance, now)
            elif self.state in (State.CANCELING, State.STOPPING):
                self._step(Event.AT_REST, self._when_at_rest)
        self._check_patience(now)

    def cancel(self, now: float) -> None:
        """Stop because the goal was canceled: it ends as canceled when the arm stands."""
        outcome = Outcome(End.CANCELED, ErrorCode.SUCCESSFUL, 'canceled; the arm stands')
        self._stop(Event.CANCEL, outcome, now)

    def stop(self, why: str, now: float) -> None:
        """Stop for another reason: the goal ends as aborted when the arm stands."""
        outcome = Outcome(End.ABORTED, ErrorCode.INVALID_GOAL, f'{why}; the arm stands')
        self._stop(Event.STOP, outcome, now)

    def fault(self, why: str, code: ErrorCode = ErrorCode.PATH_TOLERANCE_VIOLATED) -> None:
        """Something forbids going on: send STOP if anything was sent, and end now."""
        if self.ended:
            return
        refused, unsent = self.state is State.REFUSED, self.state is State.PREPARING
        outcome = Outcome(End.ABORTED, code, f'{self._refusal}: {why}' if refused else why)
        self.state = TRANSITIONS[self.state, Event.FAULT]
        if not refused and not unsent:
            self._send_stop()
        self._on_end(outcome)

    def _refuse(self, why: str, now: float) -> None:
        self._refusal, self._refused_at = why, now
        self._step(Event.REFUSAL)
        self._send_stop()

    def _look_for_cause(self, robot: RobotState, now: float) -> None:
        """End a refused goal with what the first status after the refusal says, if it comes."""
        if robot.status is not None and robot.status_time > self._refused_at:
            error = robot.status.error_code
            self.fault(f'controller error {error}' if error else 'it reports no error')
        elif now - self._refused_at > CAUSE_TIME:
            self.fault('no status came that says why')

    def _send_stop(self) -> None:
        with contextlib.suppress(ConnectionError):  # without a link the controller stops itself
            self._send(STOP, lambda _packet, _now: None)

    def _stop(self, event: Event, outcome: Outcome, now: float) -> None:
        if (self.state, event) not in TRANSITIONS:
            return
        self._when_at_rest = outcome
        already = self.state in (State.CANCELING, State.STOPPING)
        self._step(event)
        if already:
            return
        self._alive = now
        self._settling_since = None
        self._standing_since = None
        try:
            self._send(STOP, self._on_stop_reply)
        except ConnectionError as error:
            self.fault(f'STOP could not be sent: {error}')

    def _on_stop_reply(self, packet: Packet, now: float) -> None:
        if packet.reply_code is ReplyCode.SUCCESS:
            self._settling_since = now
        else:
            self.fault('the controller refused STOP (FAILURE reply)')

    def _watch_rest(self, sample: JointSample, robot: RobotState, now: float) -> None:
        """Keep since when the arm stands, by what is measured and by what the controller says.

        Only what came after the last reply counts: before it, the motion may not have begun.
        """
        if self._alive_at is None or np.abs(sample.positions - self._alive_at).max() > MOVED:
            self._alive_at = sample.positions
            self._alive = now
        moving = float(np.abs(sample.velocities).max()) >= self._settings.stopped_velocity
        if moving or robot.in_motion == TriState.TRUE or self._settling_since is None:
            self._standing_since = None
        elif (
            self._standing_since is None
            and sample.time > self._settling_since
            and (robot.in_motion == TriState.UNKNOWN or robot.status_time > self._settling_since)
        ):
            self._standing_since = sample.time

    def _judge(self, distance: Array, now: float) -> None:
        """All points are acknowledged and the arm stands: decide whether it is at the goal."""
        tolerance = self.goal.goal_tolerance
        if self._left and np.all(distance <= tolerance):
            text = f'at the goal after {now - self.started:.2f} s'
            self._step(Event.AT_GOAL, Outcome(End.SUCCEEDED, ErrorCode.SUCCESSFUL, text))
        elif now - self._alive > SETTLE_TIME:
            joint = int(np.argmax(distance - tolerance))
            name = self.goal.trajectory.joint_names[joint]
            self.fault(
                f'the arm stands, and {name} is {distance[joint]:.6g} rad from the goal: '
                f'the tolerance is {tolerance[joint]:.6g} rad'
                if self._left
                else 'the controller acknowledged all points, but the arm did not move',
                ErrorCode.GOAL_TOLERANCE_VIOLATED,
            )

    def _check_patience(self, now: float) -> None:
        if self.ended:
            return
        took, planned = now - self.started, self.goal.trajectory.duration
        waited = now - self._alive
        timeout = self._settings.reply_timeout
        if self.state in (State.STREAMING, State.SETTLING) and 0.0 < self.goal.goal_time < (
            took - planned
        ):
            self.fault(
                f'not at the goal after {took:.3g} s: the plan takes {planned:.3g} s, and the '
                f'goal_time tolerance is {self.goal.goal_time:g} s',
                ErrorCode.GOAL_TOLERANCE_VIOLATED,
            )
        elif (
            self.state is State.STREAMING and waited > timeout + self._points[self.point].duration
        ):
            self.fault(
                f'no reply to {self._name(self.point)}: the arm has not moved for {waited:.3g} s'
            )
        elif self.state not in (State.PREPARING, State.STREAMING) and waited > timeout:
            self.fault(f'the controller did not confirm the standstill within {waited:.3g} s')

    def _send_point(self) -> None:
        index = self.point

        def on_reply(packet: Packet, now: float) -> None:
            self.on_reply(index, packet, now)

        try:
            self._send(self._points[index], on_reply)
        except ConnectionError as error:
            self.fault(f'{self._name(index)} could not be sent: {error}')

    def _step(self, event: Event, outcome: Outcome | None = None) -> None:
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
