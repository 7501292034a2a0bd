# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Streams of setpoints: which stream is followed, and how the arm follows it (docs/servo.md).

Rules:

1. Only one stream is followed at a time, and none while a goal runs. A stream starts with its
   first setpoint, provided that the arm gate is open, the arm is at rest, no other client moves
   it, and a position is near the arm. Until then setpoints are refused, and the reason is logged
   once.
2. Only the newest setpoint is stored and followed. A tracker (motion/setpoint_tracker.py) moves
   toward it within a fraction of every limit. Its positions are sent as points, one pending at a
   time and at least `period` apart. Each point covers the time since the previous one, regardless
   of the rate at which setpoints arrive.
3. Any closing of the arm gate and every STOP ends the stream immediately, with STOP. All
   conditions that inhibit motion are checked before each point, in the same turn of the loop that
   sends it.
4. After that, and after each closing of the gate, a stream must be released before it is followed
   again, whichever publisher sends it (restart_interlock.py). The same applies to a stream that
   was refused. Positions must start near the arm.
5. Velocities that are all zero, or that stop arriving for `timeout`, send STOP: they mean a
   released key, and without STOP the controller would still execute its remaining points. The arm
   comes to rest before it follows the stream again. A pause (speed scaling 0) also sends STOP. If
   positions stop arriving for `timeout`, the arm ends at the last one. If the arm lags too far
   behind them (LEFT_BEHIND_S), or if `timeout` is FRESH_S or less, it brakes where it is instead.
   A stream that was silent for RELEASE_S ends when the arm is at rest. A stream that is silent and
   whose arm is at rest also ends when a goal arrives.
6. When the arm is behind positions, it catches up at no more than `catch_up` times their speed,
   even if the limits would permit more.
7. The controller never has more than MAX_LAG_S of motion ahead of the arm. No further point is
   sent before the arm has come closer.
"""

import asyncio
import logging
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from epson_driver.driver.delivery.reply_rejection import reply_rejection
from epson_driver.driver.goal.goal import check_limits
from epson_driver.driver.goal.goal_execution import MAX_COUNTED_GAP_S
from epson_driver.driver.goal.goal_queue import GoalQueue
from epson_driver.driver.inhibit import Cause, Inhibit, Purpose
from epson_driver.driver.outcome import End, ErrorCode, GoalRejectedError, Outcome
from epson_driver.driver.servo.restart_interlock import RELEASE_S, RestartInterlock
from epson_driver.driver.servo.setpoint import NO_STATE_YET, Mode, ServoSettings, Setpoint
from epson_driver.driver.servo.stream import (
    FRESH_S,
    MAX_EXTRAPOLATION_S,
    StreamFilter,
    StreamLag,
    StreamReference,
    StreamSpeedEstimator,
    VelocityCheck,
)
from epson_driver.driver.state.robot_state import JointSample, RobotState
from epson_driver.driver.state.standstill import Standstill
from epson_driver.driver.stopping.stopper import Stopper
from epson_driver.log_lines import LogThrottle
from epson_driver.motion import Array, JointLimits, Trajectory
from epson_driver.motion.setpoint_tracker import ServoTarget, SetpointTracker, servo_limits
from epson_driver.simple_message import Message, Packet

CYCLE_S = 0.02
"""Period for checking whether to send a point, and whether one may still be sent, s."""

MAX_STEP_S = 0.2
"""Maximum time that one point covers, s: the controller may take long to reply."""

DURATION_SHARE = 0.8
"""Fraction of the time covered by a point that is sent as its duration, so that a controller that
started late can catch up. The tracker is slower by the same fraction, so the arm keeps the servo's
speed. The same applies where setpoints replace each other: they have no duration, but a fraction
of the limits. A point sent without waiting has a larger fraction if the tracker moves at the full
speed that the stream's pace permits."""

STOP_WITHIN_S = 0.3
"""Maximum stopping time with the full limits, s. It bounds the speed of the arm."""

MAX_LAG_S = 0.5
"""Maximum time that is sent ahead of the arm, s."""

MIN_STEP = 1e-6
"""Minimum change of any joint that is sent before the tracker is at rest, rad or m."""

REST_STEP = 1e-8
"""The same for a tracker at rest. Smaller changes are rounding errors."""

SLOWEST_SHARE = 1e-3
"""Fraction of a joint's velocity limit that is always permitted for following positions."""

LEFT_BEHIND_S = 0.25
"""Lag behind a stream above which the arm counts as left behind, s. The tracker's lag is less."""

NEAR = 0.01
"""Distance to the last point, rad or m, within which an arm at rest has executed all points."""

LATE_REST_S = 2.0
"""Time after the last reply, s, after which an arm at rest elsewhere will not move any more."""

_log = logging.getLogger(__name__)


@dataclass(slots=True)
class ServoCounts:
    """Counts of setpoints since the start.

    late: setpoints before which the arm had started to brake. left_behind: setpoints that arrived
    while the arm was more than LEFT_BEHIND_S behind the stream.
    """

    received: int = 0
    refused: int = 0
    clipped: int = 0
    late: int = 0
    left_behind: int = 0


@dataclass(slots=True, eq=False)
class _Session:
    """A stream being followed. Times are the loop's, s.

    sent, sent_velocity: of the last point. sequence: number of the next point. waiting: a reply is
    pending since `posted`. waited: the last step was longer than usual. span: tracker time since
    the last point. time: of the last point. braked: the stream was silent and the arm brakes.
    let_go: STOP was sent for silence, zero velocities or a pause. reference: planned positions
    from `heard` on. fastest: maximum speed from the stream's pace, shape (n,). behind: lag of the
    tracker, s. said_behind: this lag has been logged.
    """

    setpoint: Setpoint
    tracker: SetpointTracker
    heard: float
    sent: Array
    sent_velocity: Array
    stepped: float
    standstill: Standstill
    check: VelocityCheck
    pace: StreamSpeedEstimator
    filter: StreamFilter
    reference: StreamReference | None = None
    lag: StreamLag = field(default_factory=StreamLag)
    sequence: int = 0
    waiting: bool = False
    posted: float = 0.0
    answered: float = 0.0
    span: float = 0.0
    time: float = 0.0
    waited: bool = False
    braked: bool = False
    released: bool = False
    fastest: Array | None = None
    behind: float = 0.0
    said_behind: bool = False

    @property
    def source(self) -> str:
        return self.setpoint.source

    @property
    def all_sent(self) -> bool:
        """Whether all of the tracker's motion has been sent and acknowledged."""
        if self.waiting or not self.sequence or not self.tracker.at_rest:
            return False
        return float(np.abs(self.sent - self.tracker.state[0]).max()) < MIN_STEP


class Servo:
    """Follows streams of setpoints while `run` runs, in the same loop.

    `on_broken_off` is called with an outcome after which the arm must be enabled again, and with
    True if a reply is missing. `settings` may be changed at any time.
    """

    def __init__(
        self,
        limits: JointLimits,
        robot: RobotState,
        why_not: Callable[[Purpose, float], Inhibit | None],
        stopper: Stopper,
        goals: GoalQueue,
        on_broken_off: Callable[[Outcome, bool], None],
    ) -> None:
        self.settings = ServoSettings()
        self.counts = ServoCounts()
        self.lag = 0.0
        """Current or last lag of the arm behind the points that were sent, s."""
        self._limits = limits
        self._robot = robot
        self._why_not = why_not
        self._stopper = stopper
        self._goals = goals
        self._on_broken_off = on_broken_off
        self._session: _Session | None = None
        self._interlock = RestartInterlock()
        self._reported: dict[tuple[str, Cause | str], float] = {}
        self._begun = asyncio.Event()
        self._looked = 0.0
        self._clipped_throttle = LogThrottle()
        self._invalid_throttle = LogThrottle()
        self._valid: set[str] = set()
        self._first_problem: dict[str, str] = {}

    # --- status -----------------------------------------------------------------------------

    @property
    def active(self) -> bool:
        """True while a stream is followed, or the arm still moves after one."""
        return self._session is not None

    @property
    def source(self) -> str:
        """Topic of the stream being followed, or '' if none."""
        return '' if self._session is None else self._session.source

    @property
    def mode(self) -> Mode | None:
        """Mode of the stream being followed, or None if none."""
        return None if self._session is None else self._session.setpoint.mode

    @property
    def commanded(self) -> Array | None:
        """Commanded joint positions of the stream being followed, shape (n,), or None."""
        return None if self._session is None else self._session.tracker.state[0]

    def blocked(self, now: float) -> dict[str, float]:
        """Return the topics that must be released, and the remaining time for each, s."""
        return dict(self._interlock.waiting(now))

    def active_user(self) -> str | None:
        """Return why no goal may start now, or None if no stream uses the arm."""
        session = self._session
        if session is None:
            return None
        now = _now()
        if self._silent(session, now) and not session.released and self._done(session, now):
            self._end(session)
            return None
        return f'the arm follows a stream of setpoints on {session.source}'

    # --- input ------------------------------------------------------------------------------

    def take(
        self, setpoint: Setpoint, came: float | None = None, *, missed: bool = False
    ) -> str | None:
        """Follow a setpoint instead of the previous one, or return why it is refused.

        `came`: the loop's time of arrival, s; None: now. `missed`: earlier messages were lost.
        """
        now = _now()
        self.counts.received += 1
        came = now if came is None else came
        if (problem := setpoint.problem(self._limits)) is not None:
            return self._refuse_invalid(setpoint.source, problem, came)
        self._valid.add(setpoint.source)
        asks = self._interlock.receive(setpoint.source, setpoint, came, missed=missed)
        if self._session is not None:
            return self._go_on(self._session, setpoint, now, came)
        if asks:
            return self._try_to_begin(setpoint, now, came)
        if setpoint.positions is not None and not self._at(setpoint.positions):
            if (result := self._why_not(Purpose.LET_GO, now)) is not None:
                return self._refuse(setpoint, result.cause, result.text_with_remedy)
            text = f'it holds its position: it must move, or pause for {RELEASE_S:g} s first'
            return self._refuse(setpoint, 'far', text)
        return None

    def refuse(self, source: str, why: str, came: float | None = None) -> None:
        """Record a message that is not a valid setpoint."""
        self.counts.received += 1
        self._refuse_invalid(source, why, _now() if came is None else came)

    def stop(self, why: str) -> bool:
        """Stop following any stream, and return whether one was followed."""
        self._interlock.trip(_now())
        self._reported.clear()
        session = self._session
        if session is None:
            return False
        self._session = None
        _log.warning('the stream on %s is no longer followed: %s', session.source, why)
        self._stopper.stop()
        return True

    def withdraw(self) -> None:
        """Handle a negative reply to a message that the controller acknowledged before."""
        session = self._session
        if session is not None and not session.released:
            self._break_off(session, 'the controller withdrew an acknowledgement')

    def on_joints(self, sample: JointSample, now: float) -> None:
        """Evaluate new joints."""
        session = self._session
        if session is None:
            return
        stopped = np.full(len(sample.positions), self._goals.settings.stopped_velocity)
        session.standstill.see(sample, self._robot, stopped, now)
        session.lag.see(sample)
        self.lag = session.lag.now

    async def run(self) -> None:
        """Send points while a stream is followed, until cancelled."""
        while True:
            await self._begun.wait()
            self._looked = due = _now()
            while (session := self._session) is not None:
                self._cycle(session, _now())
                due = max(due + CYCLE_S, _now())
                await asyncio.sleep(due - _now())
            self._begun.clear()

    # --- start ------------------------------------------------------------------------------

    def _try_to_begin(self, setpoint: Setpoint, now: float, came: float) -> str | None:
        if (result := self._why_not(Purpose.STREAM, now)) is not None:
            return self._refuse(setpoint, result.cause, result.text_with_remedy)
        if (waited := now - came) > self.settings.timeout:
            text = f'this driver was delayed by {waited:.3g} s after receiving it'
            return self._refuse(setpoint, 'old', text)
        sample = self._robot.sample
        assert sample is not None  # noqa: S101 - for the type checker: otherwise there is no pose
        why = self._why_blocked(setpoint) or self._why_too_far(setpoint, sample)
        if why is not None:
            return self._refuse(setpoint, *why)
        self._begin(setpoint, sample, now, came)
        return None

    def _why_blocked(self, setpoint: Setpoint) -> tuple[str, str] | None:
        """Return a refusal if the stream must be released first, or None."""
        if self._interlock.permits(setpoint.source):
            return None
        return 'blocked', (
            f'it must be released first: {RELEASE_S:g} s without a message that requests motion'
        )

    def _why_too_far(self, setpoint: Setpoint, sample: JointSample) -> tuple[str, str] | None:
        """Return a refusal if a joint is too far from the first position or its range, or None."""
        limits, tolerance = self._limits, self.settings.start_tolerance
        inside = np.clip(sample.positions, limits.position_min, limits.position_max)
        wanted = inside if setpoint.positions is None else setpoint.positions
        for what, there in (('it starts', wanted), ('its range starts', inside)):
            apart = np.abs(there - sample.positions)
            joint = int(np.argmax(apart))
            if apart[joint] > tolerance:
                unit = limits.units[joint]
                return 'far', (
                    f'{limits.names[joint]}: {what} at {there[joint]:.6g} {unit}, the joint is at '
                    f'{sample.positions[joint]:.6g} {unit}: {apart[joint]:.6g} {unit} apart, '
                    f'servo.start_tolerance is {tolerance:g} {unit}'
                )
        return None

    def _begin(self, setpoint: Setpoint, sample: JointSample, now: float, came: float) -> None:
        """Start a session at the arm's position.

        Raises GoalRejectedError if the controller takes no streams.
        """
        limits = self._limits
        start = np.clip(sample.positions, limits.position_min, limits.position_max)
        standstill = Standstill(now)
        standstill.expect(None)
        fraction = servo_limits(limits, self.settings.share, STOP_WITHIN_S)
        slower = replace(fraction, velocity=DURATION_SHARE * fraction.velocity)
        tracker = SetpointTracker(slower, start)
        session = _Session(
            setpoint,
            tracker,
            came,
            start,
            np.zeros_like(start),
            now,
            standstill,
            VelocityCheck(limits),
            StreamSpeedEstimator(start, came),
            StreamFilter(tracker.limits),
            answered=now,
        )
        first = self._message(session, start, session.sent_velocity, 0.0)
        self._session = session
        self._goals.plans.end('setpoints moved the arm, while the motion was planned')
        self._reported.clear()
        self._plot(session, setpoint, came)
        self._note_beyond(setpoint, session, now)
        _log.info('following the stream of %ss on %s', setpoint.mode, setpoint.source)
        self._begun.set()
        self._post(session, first, now)

    def _go_on(self, session: _Session, setpoint: Setpoint, now: float, came: float) -> str | None:
        """Process a setpoint while a stream is followed."""
        if setpoint.source != session.source or setpoint.mode is not session.setpoint.mode:
            if setpoint.at_rest:
                return None
            text = f'the arm follows the {session.setpoint.mode} stream on {session.source}'
            return self._refuse(setpoint, 'two', text)
        if (why := self._contradiction(session, setpoint, came)) is not None:
            return self._refuse_invalid(setpoint.source, why, now)
        session.setpoint = setpoint
        if setpoint.at_rest:  # handled like silence
            self._release(session, now)
            return None
        session.heard = came
        self._plot(session, setpoint, came)
        self.counts.late += session.braked
        self.counts.left_behind += session.behind > LEFT_BEHIND_S
        session.braked = False
        self._note_beyond(setpoint, session, now)
        return None

    def _contradiction(self, session: _Session, setpoint: Setpoint, came: float) -> str | None:
        """Return how the positions of a stream contradict its velocities, or None."""
        if setpoint.positions is None or setpoint.velocities is None:
            return None
        return session.check.add(came, setpoint.positions, setpoint.velocities)

    def _plot(self, session: _Session, setpoint: Setpoint, came: float) -> None:
        """Update the reference from a position setpoint."""
        if setpoint.positions is None:
            return
        estimate = None
        if setpoint.window is None:
            trusted = setpoint.velocities if session.check.trusted else None
            estimate = session.filter.add(came, setpoint.positions, trusted)
        session.reference = StreamReference(setpoint, self._limits, estimate)
        session.pace.add(came, session.reference)

    def _note_beyond(self, setpoint: Setpoint, session: _Session, now: float) -> None:
        beyond = setpoint.beyond(self._limits, session.tracker.limits.velocity)
        if beyond is None:
            return
        self.counts.clipped += 1
        if (line := self._clipped_throttle.line(beyond, now)) is not None:
            _log.warning('a setpoint on %s clipped to the joint limit: %s', setpoint.source, line)

    def _note_behind(self, session: _Session, behind: float) -> None:
        session.behind = behind
        if behind <= LEFT_BEHIND_S or session.said_behind:
            return
        session.said_behind = True
        _log.warning(
            'the arm is %.2g s behind the stream on %s (gap or too fast), catching up at most at '
            '%g times its speed (servo.catch_up) and %g of the limits (servo.scale)',
            behind,
            session.source,
            self.settings.catch_up,
            self.settings.share,
        )

    def _refuse(self, setpoint: Setpoint, kind: Cause | str, text: str) -> str:
        """Count a refused setpoint, log the reason once per kind and stream, and return it."""
        self.counts.refused += 1
        if kind != 'far':
            self._interlock.block(setpoint.source)
        key, now = (setpoint.source, kind), _now()
        before = self._reported.get(key, -np.inf)
        self._reported[key] = now
        if now - before >= RELEASE_S:
            _log.warning('the stream on %s is not followed: %s', setpoint.source, text)
        return text

    def _refuse_invalid(self, source: str, why: str, came: float) -> str:
        self.counts.refused += 1
        self._interlock.receive(source, None, came, missed=False)
        if source != self.source:
            self._interlock.block(source)
        early = source not in self._valid  # for example, from a client without a state
        if early:
            if self._first_problem.get(source) == why:
                return why
            self._first_problem[source] = why
        if (line := self._invalid_throttle.line(why, _now())) is not None:
            level = logging.INFO if early and why == NO_STATE_YET else logging.WARNING
            _log.log(level, 'a setpoint on %s was dropped: %s', source, line)
        return why

    def _at(self, positions: Array) -> bool:
        """Return whether the arm is at positions, shape (n,)."""
        sample = self._robot.sample
        return sample is not None and float(np.abs(sample.positions - positions).max()) <= NEAR

    # --- motion -----------------------------------------------------------------------------

    def _cycle(self, session: _Session, now: float) -> None:
        """Advance the tracker and send its position, if motion is permitted."""
        gap, self._looked = now - self._looked, now
        paused = not self._goals.scaling.target
        if (result := self._why_not_on(session, now)) is not None:
            self.stop(result.text)
        elif session.released:
            if self._stopper.over and (not paused or self._silent(session, now)):
                self._go_on_or_end(session, now)
        elif paused and not self._done(session, now):
            self._release(session, now)
        elif session.setpoint.mode is Mode.VELOCITY and self._silent(session, now):
            session.braked = True
            self._release(session, now)
        elif min(gap, now - session.heard) > RELEASE_S and not session.tracker.at_rest:
            self.stop(f'this driver was delayed by {gap:.3g} s')  # the arm may be at rest by now
        elif session.waiting:
            session.posted += max(gap - MAX_COUNTED_GAP_S, 0.0)  # its reply may be unread
            waited = now - max(session.posted, session.standstill.alive)
            if waited > self.settings.reply_timeout:
                text = f'no reply to setpoint {session.sequence - 1}'
                self._break_off(
                    session, f'{text}: the arm has not moved for {waited:.3g} s', unanswered=True
                )
        else:
            self._step_or_wait(session, now)
        silent = now - session.heard > RELEASE_S
        if silent and session is self._session and self._done(session, now):
            self._end(session)

    def _step_or_wait(self, session: _Session, now: float) -> None:
        """Take a step, or wait for the arm or its state. Break off after the reply timeout."""
        stale = self._robot.stale(now)
        waited = now - max(session.answered, session.standstill.alive)
        if (stale or session.lag.now > MAX_LAG_S) and waited > self.settings.reply_timeout:
            self._break_off(session, f'the arm has not followed setpoints for {waited:.3g} s')
        elif stale or session.lag.ahead > MAX_LAG_S:
            session.stepped = now
        else:
            self._step(session, now)

    def _silent(self, session: _Session, now: float) -> bool:
        return now - session.heard > self.settings.timeout

    def _why_not_on(self, session: _Session, now: float) -> Inhibit | None:
        """Return why no further point may be sent, or None."""
        return self._why_not(Purpose.LET_GO if session.released else Purpose.FOLLOW, now)

    def _step(self, session: _Session, now: float) -> None:
        if now - session.stepped < self.settings.period - CYCLE_S / 2.0:
            return
        dt = min(now - session.stepped, MAX_STEP_S)
        session.stepped = now
        session.waited = dt >= 2.0 * self.settings.period
        tracker = session.tracker
        self._track(session, now, dt)
        position, velocity, _ = tracker.state
        if session.reference is not None:
            self._note_behind(session, session.pace.see(now, position))
        session.span += dt
        moved = float(np.abs(position - session.sent).max())
        if moved < (REST_STEP if tracker.at_rest else MIN_STEP):
            if tracker.at_rest:
                session.span = 0.0
            return
        try:
            message = self._message(session, position, velocity, session.span)
        except GoalRejectedError as rejection:  # a defect: the tracker must respect the limits
            self._break_off(session, f'setpoints break a limit: {rejection}')
            return
        session.lag.sent(now, position)
        self._post(session, message, now)

    def _track(self, session: _Session, now: float, dt: float) -> None:
        """Advance the tracker by `dt` s, in steps of about a cycle."""
        tracker, setpoint = session.tracker, session.setpoint
        factor = self._goals.scaling.factor(now)
        silent = self._silent(session, now)
        count = max(round(dt / CYCLE_S), 1)
        step = dt / count
        if silent or factor == 0.0:
            session.braked |= silent and not tracker.at_rest
            ends = self.settings.timeout > FRESH_S and session.behind <= LEFT_BEHIND_S
            tracker.brake(setpoint.positions if ends and factor > 0.0 else None, factor)
            tracker.step(dt)
        elif session.reference is not None:
            aim, speed = self._aim(session, session.reference, now, dt, step, factor)
            for left in reversed(range(count)):
                tracker.follow(step, aim.before(left * step), speed)
                tracker.step(step)
        else:
            assert setpoint.velocities is not None  # noqa: S101 - one of the two is there
            for _ in range(count):
                tracker.move(step, setpoint.velocities * factor)
                tracker.step(step)

    def _aim(
        self,
        session: _Session,
        reference: StreamReference,
        now: float,
        dt: float,
        step: float,
        factor: float,
    ) -> tuple[ServoTarget, Array]:
        """Return the target and the maximum speed. In a window, look ahead by the arm's lag.

        An arm that is behind positions catches up at `catch_up` times their speed. The speed is
        limited for each joint separately, so the arm stays approximately on their line.
        """
        limits = session.tracker.limits
        own = np.maximum(session.pace.fastest(), SLOWEST_SHARE * limits.velocity)
        session.fastest = self.settings.catch_up * own
        slack = DURATION_SHARE if session.waited else 1.0
        speed = np.minimum(session.fastest / slack / limits.velocity, factor)
        if session.setpoint.window is None:
            return session.filter.aim(now, dt - step), speed
        age = now - session.heard
        known = reference.reach + MAX_EXTRAPOLATION_S
        ahead = max(min(age + session.lag.behind, known), age)
        return reference.aim(ahead, step, limits), speed

    def _message(
        self, session: _Session, position: Array, velocity: Array, span: float
    ) -> Message:
        """Return the message of the next point, `span` s of tracker time after the last one.

        Raises GoalRejectedError if it violates a limit, or if the controller takes no streams.
        """
        fraction = DURATION_SHARE
        if session.fastest is not None and span > 0.0 and not session.waited:
            speeds = np.abs([session.sent_velocity, velocity, (position - session.sent) / span])
            fraction = min(max(fraction, float((speeds / session.fastest).max())), 1.0)
        duration = span * fraction
        way = Trajectory(
            self._limits.names,
            np.array([session.time, session.time + duration]),
            np.array([session.sent, position]),
            np.array([session.sent_velocity, velocity]) / fraction,
        )
        if span > 0.0:
            check_limits(way, self._limits, may_end_moving=True)
        message = self._stopper.delivery.setpoint(way, session.sequence)
        session.sent, session.sent_velocity = position, velocity
        session.span = 0.0
        session.time += duration
        return message

    def _post(self, session: _Session, message: Message, now: float) -> None:
        """Send a point, unless motion is inhibited now."""
        if session is not self._session:
            return
        if (result := self._why_not_on(session, now)) is not None:
            self.stop(result.text)
            return
        sequence = session.sequence
        session.sequence += 1
        session.waiting, session.posted = True, now
        session.standstill.expect(None)

        def on_reply(packet: Packet, now: float) -> None:
            self._on_reply(session, sequence, packet, now)

        try:
            self._stopper.post(message, on_reply)
        except ConnectionError as error:
            self._break_off(session, f'setpoint {sequence} could not be sent: {error}')

    def _on_reply(self, session: _Session, sequence: int, packet: Packet, now: float) -> None:
        if session is not self._session or session.released:
            return  # STOP was sent since
        if (no := reply_rejection(packet)) is not None:
            text = f'the controller refused setpoint {sequence} ({no})'
            self._break_off(session, text, unexplained=True)
            return
        session.waiting, session.answered = False, now
        session.standstill.expect(now)

    # --- end --------------------------------------------------------------------------------

    def _release(self, session: _Session, now: float) -> None:
        """Send STOP, unless all points are executed.

        This is not a requested stop, so the stream need not be silent before it continues.
        """
        if not session.released and not self._done(session, now):
            session.released = True
            self._stopper.stop()

    def _go_on_or_end(self, session: _Session, now: float) -> None:
        """Restart the stream from the current position if motion was requested since its STOP."""
        self._session = None
        if session.setpoint.at_rest or self._silent(session, now):
            _log.info('the stream on %s has ended, and the arm is at rest', session.source)
        else:
            self._try_to_begin(session.setpoint, now, session.heard)

    def _done(self, session: _Session, now: float) -> bool:
        """Return whether all points are executed and the arm is at rest."""
        sample = self._robot.sample
        if sample is None or not session.all_sent:
            return False
        if not session.standstill.reached(sample.measured):
            return False
        return self._at(session.sent) or now - session.answered > LATE_REST_S

    def _end(self, session: _Session) -> None:
        """End a stream that is over and whose arm is at rest."""
        self._session = None
        if self._at(session.sent):
            self._stopper.goal_reached()
        _log.info('the stream on %s has ended, and the arm is at rest', session.source)

    def _break_off(
        self,
        session: _Session,
        why: str,
        *,
        unanswered: bool = False,
        unexplained: bool = False,
    ) -> None:
        """Stop and disable the arm, because the controller's further motion is unknown."""
        self._session = None
        self._stopper.stop()
        outcome = Outcome(End.ABORTED, ErrorCode.PATH_TOLERANCE_VIOLATED, why, unexplained)
        self._on_broken_off(outcome, unanswered)


def _now() -> float:
    return asyncio.get_running_loop().time()
