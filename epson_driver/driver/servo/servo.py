# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Streams of setpoints: which stream is followed, and how the arm follows it (docs/servo.md).

Rules:

1. Only one stream is followed at a time, and no stream while a goal runs. A stream starts with its
   first setpoint if the arm gate is open, the arm is at rest, and no other client moves the arm. A
   position setpoint must also be near the arm. Otherwise the setpoint is refused, and the reason
   is logged once.
2. Only the newest setpoint is stored and followed. A tracker (motion/setpoint_tracker.py) moves
   toward it within a fraction of every limit. The positions of the tracker are sent as points. At
   most one point is pending, and points are at least `period` apart. Each point covers the time
   since the previous point, regardless of the rate at which setpoints arrive.
3. A stop, or closing the arm gate, ends the stream immediately, with STOP. All conditions that
   inhibit motion are checked before each point, in the same turn of the loop that sends it.
4. A stream that was stopped or refused must be released before it is followed again, even if
   another publisher sends it (restart_interlock.py).
5. A key counts as released if all velocities are zero, or if no velocities arrive for `timeout`.
   The driver then sends STOP, because the controller would still execute its remaining points.
   The arm comes to rest before it follows the stream again. A pause (speed scaling 0) also sends
   STOP. If no positions arrive for `timeout`, the arm stops at the last position. It brakes
   immediately instead if it lags too far behind the stream (LEFT_BEHIND_S), or if `timeout` is at
   most FRESH_S. A stream that was silent or held its position for RELEASE_S ends when the arm is
   at rest. If a goal arrives, the stream ends as soon as it is silent for `timeout` and the arm
   is at rest.
6. An arm that is behind a stream of positions catches up at no more than `catch_up` times the
   speed of the stream, even if the limits permit more.
7. The sent points are never more than MAX_LAG_S ahead of the arm. No further point is sent until
   the arm has come closer.
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

CYCLE_S = 0.02  # period for checking whether to send a point, and whether one may still be sent, s
MAX_STEP_S = 0.2  # maximum time that one point covers, s, even if the controller replies later

MIN_DURATION_FRACTION = 0.8
"""Minimum duration sent with a point, as a fraction of the time that the point covers. The
tracker is slower by the same fraction, so that the arm does not exceed the permitted speed."""

USUAL_LAG_S = 0.08  # lag of the arm behind the points sent that is not corrected, s

LAG_CORRECTION = 1.5
"""Rate at which a lag above USUAL_LAG_S is corrected, 1/s. The duration of a point is reduced by
the fraction rate · excess of the lag. The rate is low, because the arm is faster by this fraction.
"""

STOP_WITHIN_S = 0.3  # maximum stopping time with full limits, s. It limits the arm's speed
MAX_LAG_S = 0.5  # maximum time by which the points sent may be ahead of the arm, s
MIN_STEP = 1e-6  # minimum change of any joint that is sent while the tracker moves, rad or m
REST_STEP = 1e-8  # the same when the tracker is at rest. A smaller change is a rounding error
MIN_SPEED_FRACTION = 1e-3  # fraction of the velocity limit that positions may always use
LEFT_BEHIND_S = 0.25  # lag above which the arm counts as left behind, s. The tracker lags less
NEAR = 0.01  # distance to the last point, rad or m, at which all points are executed
LATE_REST_S = 2.0  # time after the last reply after which an arm at rest is done, s

_log = logging.getLogger(__name__)


@dataclass(slots=True)
class ServoCounts:
    """Numbers of setpoints since the driver started."""

    received: int = 0  # all setpoints
    refused: int = 0  # not followed
    clipped: int = 0  # beyond the range or the maximum speed of a joint
    late: int = 0  # arrived after the arm had started to brake because setpoints were missing
    left_behind: int = 0  # arrived while the arm was more than LEFT_BEHIND_S behind the stream


@dataclass(slots=True, eq=False)
class _Session:
    """A stream that the arm follows. Times are the event loop's, s."""

    setpoint: Setpoint  # the newest
    tracker: SetpointTracker
    received: float  # arrival of the last setpoint that was not at rest
    requested: float  # arrival of the last setpoint that requested motion
    sent: Array  # the last point
    sent_velocity: Array
    stepped: float  # time of the last step of the tracker
    standstill: Standstill
    check: VelocityCheck
    pace: StreamSpeedEstimator
    filter: StreamFilter
    reference: StreamReference | None = None  # from the newest position setpoint
    lag: StreamLag = field(default_factory=StreamLag)
    sequence: int = 0  # number of the next point
    waiting: bool = False  # the point that was sent at `posted` has no reply yet
    posted: float = 0.0
    answered: float = 0.0  # time of the last reply
    span: float = 0.0  # time that the tracker has advanced since the last point, s
    time: float = 0.0  # sum of the durations of all points, s
    waited: bool = False  # the last step of the tracker was longer than usual
    braked: bool = False  # since the last setpoint, because no newer one arrived
    released: bool = False  # STOP was sent because of silence, zero velocities or a pause
    fastest: Array | None = None  # when following positions, shape (n,), rad/s or m/s
    behind: float = 0.0  # lag of the tracker behind the stream, s
    behind_logged: bool = False

    @property
    def source(self) -> str:
        return self.setpoint.source

    @property
    def all_sent(self) -> bool:
        """Whether the tracker is at rest, and all its motion has been sent and acknowledged."""
        if self.waiting or not self.sequence or not self.tracker.at_rest:
            return False
        return float(np.abs(self.sent - self.tracker.state[0]).max()) < MIN_STEP


class Servo:
    """Follows streams of setpoints while `run` runs. `settings` may be changed at any time."""

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
        self.lag = 0.0  # current or last lag of the arm behind the points sent, s
        self._limits = limits
        self._robot = robot
        self._why_not = why_not
        self._stopper = stopper
        self._goals = goals
        self._on_broken_off = on_broken_off
        self._session: _Session | None = None
        self._interlock = RestartInterlock()
        self._reported: dict[tuple[str, Cause | str], float] = {}
        self._started = asyncio.Event()
        self._last_cycle = 0.0
        self._clipped_throttle = LogThrottle()
        self._invalid_throttle = LogThrottle()
        self._valid: set[str] = set()
        self._first_problem: dict[str, str] = {}

    @property
    def active(self) -> bool:
        """Whether a stream is followed, or the arm has not come to rest after one."""
        return self._session is not None

    @property
    def source(self) -> str:
        return '' if self._session is None else self._session.source

    @property
    def mode(self) -> Mode | None:
        return None if self._session is None else self._session.setpoint.mode

    @property
    def commanded(self) -> Array | None:
        """Joint positions of the tracker, shape (n,), rad or m, or None without a stream."""
        return None if self._session is None else self._session.tracker.state[0]

    def blocked(self, now: float) -> dict[str, float]:
        """Return the topics whose streams are blocked, each with the time until its release, s."""
        return dict(self._interlock.waiting(now))

    def active_user(self) -> str | None:
        """End the stream if it is finished. Return why a stream prevents new goals, or None."""
        session = self._session
        if session is None:
            return None
        now = _now()
        if self._silent(session, now) and not session.released and self._done(session, now):
            self._end(session)
            return None
        return f'the arm follows a stream of setpoints on {session.source}'

    def take(
        self, setpoint: Setpoint, arrival: float | None = None, *, missed: bool = False
    ) -> str | None:
        """Follow a setpoint instead of the previous one, or return why the setpoint is refused.

        `arrival`: loop time of its arrival, s. None: now. `missed`: earlier messages were lost.
        """
        now = _now()
        self.counts.received += 1
        arrival = now if arrival is None else arrival
        if (problem := setpoint.problem(self._limits)) is not None:
            return self._refuse_invalid(setpoint.source, problem, arrival)
        self._valid.add(setpoint.source)
        requests_motion = self._interlock.receive(
            setpoint.source, setpoint, arrival, missed=missed
        )
        if (session := self._session) is not None:
            if requests_motion and setpoint.source == session.source:
                session.requested = arrival
            return self._update(session, setpoint, now, arrival)
        if requests_motion:
            return self._try_to_start(setpoint, now, arrival)
        if setpoint.positions is not None and not self._is_at(setpoint.positions):
            if (inhibit := self._why_not(Purpose.LET_GO, now)) is not None:
                return self._refuse(setpoint, inhibit.cause, inhibit.text_with_remedy)
            text = f'it holds a position: it must move, or be silent for {RELEASE_S:g} s first'
            return self._refuse(setpoint, 'far', text)
        return None

    def refuse(self, source: str, why: str, arrival: float | None = None) -> None:
        """Record an invalid message on topic `source`. `arrival`: loop time, s. None: now."""
        self.counts.received += 1
        self._refuse_invalid(source, why, _now() if arrival is None else arrival)

    def stop(self, why: str) -> bool:
        """Stop the current stream, block all streams, and return whether one was followed."""
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
        session = self._session
        if session is not None and not session.released:
            text = 'the controller reported a failure of an accepted setpoint'
            self._break_off(session, text, unexplained=True)

    def on_joints(self, sample: JointSample, now: float) -> None:
        session = self._session
        if session is None:
            return
        stopped = np.full(len(sample.positions), self._goals.settings.stopped_velocity)
        session.standstill.update(sample, self._robot, stopped, now)
        session.lag.update(sample)
        self.lag = session.lag.now

    async def run(self) -> None:
        while True:
            await self._started.wait()
            self._last_cycle = due = _now()
            while (session := self._session) is not None:
                self._cycle(session, _now())
                due = max(due + CYCLE_S, _now())
                await asyncio.sleep(due - _now())
            self._started.clear()

    def _try_to_start(self, setpoint: Setpoint, now: float, arrival: float) -> str | None:
        if (inhibit := self._why_not(Purpose.STREAM, now)) is not None:
            return self._refuse(setpoint, inhibit.cause, inhibit.text_with_remedy)
        if (waited := now - arrival) > self.settings.timeout:
            text = f'this driver was delayed by {waited:.3g} s after receiving it'
            return self._refuse(setpoint, 'old', text)
        sample = self._robot.sample
        assert sample is not None  # noqa: S101 - for the type checker: otherwise there is no pose
        if not self._interlock.permits(setpoint.source):
            text = f'{RELEASE_S:g} s without a message that requests motion'
            return self._refuse(setpoint, 'blocked', f'it must be released first: {text}')
        if (why := self._why_too_far(setpoint, sample)) is not None:
            return self._refuse(setpoint, 'far', why)
        self._start(setpoint, sample, now, arrival)
        return None

    def _why_too_far(self, setpoint: Setpoint, sample: JointSample) -> str | None:
        """Return which joint is too far from the setpoint or outside its own range, or None."""
        limits, tolerance = self._limits, self.settings.start_tolerance
        inside = np.clip(sample.positions, limits.position_min, limits.position_max)
        target = inside if setpoint.positions is None else setpoint.positions
        for what, position in (('it starts', target), ('its range starts', inside)):
            distance = np.abs(position - sample.positions)
            joint = int(np.argmax(distance))
            if distance[joint] > tolerance:
                unit = limits.units[joint]
                return (
                    f'{limits.names[joint]}: {what} at {position[joint]:.6g} {unit}, the joint is '
                    f'at {sample.positions[joint]:.6g} {unit}: {distance[joint]:.6g} {unit} '
                    f'apart, servo.start_tolerance is {tolerance:g} {unit}'
                )
        return None

    def _start(self, setpoint: Setpoint, sample: JointSample, now: float, arrival: float) -> None:
        limits = self._limits
        start = np.clip(sample.positions, limits.position_min, limits.position_max)
        standstill = Standstill(now)
        standstill.expect(None)
        reduced = servo_limits(limits, self.settings.scale, STOP_WITHIN_S)
        reduced = replace(reduced, velocity=MIN_DURATION_FRACTION * reduced.velocity)
        tracker = self._stopper.delivery.tracker(reduced, start)
        session = _Session(
            setpoint,
            tracker,
            arrival,
            arrival,
            start,
            np.zeros_like(start),
            now,
            standstill,
            VelocityCheck(limits),
            StreamSpeedEstimator(start, arrival),
            StreamFilter(tracker.limits),
            answered=now,
        )
        first = self._message(session, start, session.sent_velocity, 0.0)
        self._session = session
        self._goals.plans.end('setpoints moved the arm, while the motion was planned')
        self._reported.clear()
        self._update_reference(session, setpoint, arrival)
        self._report_clipping(setpoint, session, now)
        _log.info('following the %s stream on %s', setpoint.mode, setpoint.source)
        self._started.set()
        self._post(session, first, now)

    def _update(
        self, session: _Session, setpoint: Setpoint, now: float, arrival: float
    ) -> str | None:
        if setpoint.source != session.source or setpoint.mode is not session.setpoint.mode:
            if setpoint.at_rest:
                return None
            text = f'the arm follows the {session.setpoint.mode} stream on {session.source}'
            return self._refuse(setpoint, 'two', text)
        if setpoint.positions is not None and setpoint.velocities is not None:
            why = session.check.add(arrival, setpoint.positions, setpoint.velocities)
            if why is not None:
                return self._refuse_invalid(setpoint.source, why, now)
        session.setpoint = setpoint
        if setpoint.at_rest:  # handled like silence
            self._release(session, now)
            return None
        session.received = arrival
        self._update_reference(session, setpoint, arrival)
        self.counts.late += session.braked
        self.counts.left_behind += session.behind > LEFT_BEHIND_S
        session.braked = False
        self._report_clipping(setpoint, session, now)
        return None

    def _update_reference(self, session: _Session, setpoint: Setpoint, arrival: float) -> None:
        if setpoint.positions is None:
            return
        estimate = None
        if setpoint.window is None:
            trusted = setpoint.velocities if session.check.trusted else None
            estimate = session.filter.add(arrival, setpoint.positions, trusted)
        session.reference = StreamReference(setpoint, self._limits, estimate)
        session.pace.add(arrival, session.reference)

    def _report_clipping(self, setpoint: Setpoint, session: _Session, now: float) -> None:
        beyond = setpoint.beyond(self._limits, session.tracker.limits.velocity)
        if beyond is None:
            return
        self.counts.clipped += 1
        if (line := self._clipped_throttle.line(beyond, now)) is not None:
            _log.warning('a setpoint on %s clipped to the joint limit: %s', setpoint.source, line)

    def _report_lag(self, session: _Session, behind: float) -> None:
        session.behind = behind
        if behind <= LEFT_BEHIND_S or session.behind_logged:
            return
        session.behind_logged = True
        _log.warning(
            'the arm is %.2g s behind the stream on %s (gap or too fast). It catches up at no '
            'more than %g times the speed of the stream (servo.catch_up) and %g of the limits '
            '(servo.scale)',
            behind,
            session.source,
            self.settings.catch_up,
            self.settings.scale,
        )

    def _refuse(self, setpoint: Setpoint, kind: Cause | str, text: str) -> str:
        """Count a refused setpoint, and return the reason. Log it once per kind and stream."""
        self.counts.refused += 1
        if kind != 'far':
            self._interlock.block(setpoint.source)
        key, now = (setpoint.source, kind), _now()
        before = self._reported.get(key, -np.inf)
        self._reported[key] = now
        if now - before >= RELEASE_S:
            _log.warning('the stream on %s is refused: %s', setpoint.source, text)
        return text

    def _refuse_invalid(self, source: str, why: str, arrival: float) -> str:
        """Count an invalid setpoint, and return the reason. Log it at a limited rate."""
        self.counts.refused += 1
        self._interlock.receive(source, None, arrival, missed=False)
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

    def _is_at(self, positions: Array) -> bool:
        sample = self._robot.sample
        return sample is not None and float(np.abs(sample.positions - positions).max()) <= NEAR

    def _cycle(self, session: _Session, now: float) -> None:
        """Send the next point, or stop, release or end the stream (rules 3 and 5)."""
        gap, self._last_cycle = now - self._last_cycle, now
        paused = not self._goals.scaling.target
        if (inhibit := self._why_no_point(session, now)) is not None:
            self.stop(inhibit.text)
        elif session.released:
            if self._stopper.over and (not paused or self._silent(session, now)):
                self._restart_or_end(session, now)
        elif paused and not self._done(session, now):
            self._release(session, now)
        elif session.setpoint.mode is Mode.VELOCITY and self._silent(session, now):
            session.braked = True
            self._release(session, now)
        elif min(gap, now - session.received) > RELEASE_S and not session.tracker.at_rest:
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
        idle = now - session.requested > RELEASE_S
        if idle and session is self._session and self._done(session, now):
            self._end(session)

    def _step_or_wait(self, session: _Session, now: float) -> None:
        """Advance the tracker, unless the arm is too far behind or its state is stale."""
        stale = self._robot.stale(now)
        waited = now - max(session.answered, session.standstill.alive)
        if (stale or session.lag.now > MAX_LAG_S) and waited > self.settings.reply_timeout:
            self._break_off(session, f'the arm has not followed setpoints for {waited:.3g} s')
        elif stale or session.lag.ahead > MAX_LAG_S:
            session.stepped = now
        else:
            self._step(session, now)

    def _silent(self, session: _Session, now: float) -> bool:
        return now - session.received > self.settings.timeout

    def _why_no_point(self, session: _Session, now: float) -> Inhibit | None:
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
            self._report_lag(session, session.pace.lag(now, position))
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
        tracker, setpoint = session.tracker, session.setpoint
        factor = self._goals.scaling.factor(now)
        silent = self._silent(session, now)
        count = max(round(dt / CYCLE_S), 1)
        step = dt / count
        if silent or factor == 0.0:
            session.braked |= silent and not tracker.at_rest
            at_last = self.settings.timeout > FRESH_S and session.behind <= LEFT_BEHIND_S
            fastest = self._fastest(session, factor)
            tracker.brake(setpoint.positions if at_last and factor > 0.0 else None, fastest)
            tracker.step(dt)
        elif session.reference is not None:
            target, speed = self._target(session, session.reference, now, dt, step, factor)
            for remaining in reversed(range(count)):
                tracker.follow(step, target.before(remaining * step), speed)
                tracker.step(step)
        else:
            assert setpoint.velocities is not None  # noqa: S101 - one of the two is there
            for _ in range(count):
                tracker.move(step, setpoint.velocities * factor)
                tracker.step(step)

    def _target(
        self,
        session: _Session,
        reference: StreamReference,
        now: float,
        dt: float,
        step: float,
        factor: float,
    ) -> tuple[ServoTarget, Array | float]:
        """Return the target at `now`, and the maximum speed as fractions of the limits.

        The tracker will advance by `dt` s in steps of `step` s. If the setpoint contains several
        points, the target is taken later than `now`, to compensate for the arm's lag.
        """
        speed, lead = self._fastest(session, factor), self._stopper.delivery.lead
        if session.setpoint.window is None:
            return session.filter.aim(now, dt - step, lead), speed
        age = now - session.received
        end = reference.reach + MAX_EXTRAPOLATION_S
        time = max(min(age + max(session.lag.behind, lead), end), age)
        return reference.aim(time, step, session.tracker.limits), speed

    def _fastest(self, session: _Session, factor: float) -> Array | float:
        """Return the maximum speed of the tracker, as a fraction of each joint's limit."""
        if session.reference is None:
            return factor
        limit = session.tracker.limits.velocity
        stream_speed = np.maximum(session.pace.fastest(), MIN_SPEED_FRACTION * limit)
        session.fastest = self.settings.catch_up * stream_speed
        slack = MIN_DURATION_FRACTION if session.waited else 1.0
        return np.minimum(session.fastest / slack / limit, factor)

    def _message(
        self, session: _Session, position: Array, velocity: Array, span: float
    ) -> Message:
        """Return the message of the next point. `span`: tracker time since the last point, s."""
        late = max(session.lag.behind - USUAL_LAG_S, 0.0)
        fraction = max(1.0 - LAG_CORRECTION * late, MIN_DURATION_FRACTION)
        if session.fastest is not None and span > 0.0 and not session.waited:
            speeds = np.abs([session.sent_velocity, velocity, (position - session.sent) / span])
            fraction = min(max(fraction, float((speeds / session.fastest).max())), 1.0)
        duration = span * fraction
        step = Trajectory(
            self._limits.names,
            np.array([session.time, session.time + duration]),
            np.array([session.sent, position]),
            np.array([session.sent_velocity, velocity]) / fraction,
        )
        if span > 0.0:
            check_limits(step, self._limits, may_end_moving=True)
        message = self._stopper.delivery.setpoint(step, session.sequence)
        session.sent, session.sent_velocity = position, velocity
        session.span = 0.0
        session.time += duration
        return message

    def _post(self, session: _Session, message: Message, now: float) -> None:
        if session is not self._session:
            return
        if (inhibit := self._why_no_point(session, now)) is not None:
            self.stop(inhibit.text)
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

    def _release(self, session: _Session, now: float) -> None:
        """Send STOP, unless all points are executed. Later setpoints may move the arm again."""
        if not session.released and not self._done(session, now):
            session.released = True
            self._stopper.stop()

    def _restart_or_end(self, session: _Session, now: float) -> None:
        self._session = None
        if session.setpoint.at_rest or self._silent(session, now):
            _log.info('the stream on %s has ended, and the arm is at rest', session.source)
        else:
            self._try_to_start(session.setpoint, now, session.received)

    def _done(self, session: _Session, now: float) -> bool:
        sample = self._robot.sample
        if sample is None or not session.all_sent:
            return False
        if not session.standstill.reached(sample.measured):
            return False
        return self._is_at(session.sent) or now - session.answered > LATE_REST_S

    def _end(self, session: _Session) -> None:
        self._session = None
        if self._is_at(session.sent):
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
        """Stop and disable the arm, because it is unknown which of its points will be executed."""
        self._session = None
        self._stopper.stop()
        outcome = Outcome(End.ABORTED, ErrorCode.PATH_TOLERANCE_VIOLATED, why, unexplained)
        self._on_broken_off(outcome, unanswered)


def _now() -> float:
    return asyncio.get_running_loop().time()
