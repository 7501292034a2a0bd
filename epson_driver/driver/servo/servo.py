# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Streams of setpoints: which one is followed, and how the arm follows it (docs/servo.md).

Rules:

1. One stream at a time, and none beside a goal. The first setpoint of a stream is where it
   begins: the arm gate is open, the arm stands, nobody else moves it, and a position is near the
   arm. Until then setpoints are refused, and the log says why, once.
2. The newest setpoint counts, and only it is kept. A tracker (motion/setpoint_tracker.py) goes
   there inside a share of every limit; its positions are sent as points, one on its way at a
   time, `period` apart or more, in the time that has passed, never as fast as they come.
3. Whatever closes the arm gate, and every STOP, ends the stream at once, with STOP. Before each
   point all that forbids it is looked at in the same turn of the loop in which it is sent.
4. After that nothing is followed by surprise. A stream that ~/stop has ended must have been silent
   first. So must one of velocities that was refused, or let go (all zero): a key that was held
   while the arm was enabled does not move it. Positions must be near the arm.
5. A stream that is silent for `timeout` brakes, unless the arm is about to rest at the setpoint.
   One that was silent for SILENCE_S is over when the arm stands; so it is when a goal comes and
   all is still.
6. The controller never knows more than MAX_LAG_S ahead of the arm: no point is sent before the arm
   has come closer.
"""

import asyncio
import logging
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from epson_driver.driver.delivery.reply_rejection import reply_rejection
from epson_driver.driver.goal.goal_checks import check_limits
from epson_driver.driver.goal.goal_execution import MAX_COUNTED_GAP_S
from epson_driver.driver.goal.goal_queue import GoalQueue
from epson_driver.driver.outcome import End, ErrorCode, GoalRejectedError, Outcome
from epson_driver.driver.servo.course import Course
from epson_driver.driver.servo.lead import Lead
from epson_driver.driver.servo.setpoint import Mode, ServoSettings, Setpoint
from epson_driver.driver.servo.velocity_estimate import VelocityEstimate
from epson_driver.driver.state.robot_state import JointSample, RobotState
from epson_driver.driver.state.standstill import Standstill
from epson_driver.driver.stopping.arm_gate import ArmGate
from epson_driver.driver.stopping.stopper import Stopper
from epson_driver.log_lines import LogThrottle
from epson_driver.motion import Array, JointLimits, Trajectory
from epson_driver.motion.setpoint_tracker import SetpointTracker, servo_limits
from epson_driver.simple_message import Message, Packet

CYCLE_S = 0.02
"""How often is looked whether to send a point, and whether one may still be sent, s."""

MAX_STEP_S = 0.2
"""What one point may cover at most, s: a controller may take long to answer one."""

DURATION_SHARE = 0.8
"""What of the time that a point covers is sent as its duration: a controller that waited before it
began may catch up. The tracker is as much slower, so that the arm keeps to the servo's speed. So
it is where setpoints replace each other: they have no duration, but their share of the limits."""

STOP_WITHIN_S = 0.3
"""The arm is never so fast that a stop with its whole limits would take longer, s."""

MAX_LAG_S = 0.5
"""While the arm is farther behind what was sent, nothing more is, s."""

SILENCE_S = 1.0
"""A stream that was silent for so long is over; what comes then is a new one, s."""

MIN_STEP = 1e-6
"""A smaller change of all joints, rad or m, is not sent before the tracker rests."""

REST_STEP = 1e-8
"""Nor is a smaller one when it rests: that is rounding."""

ESTIMATE_LEAD_S = 0.04
"""How far estimated velocities may put the tracker's aim ahead of a setpoint, s."""

ESTIMATE_FRESH_S = 0.07
"""So long after a setpoint they count, s; then the arm goes to that setpoint, and rests there."""

NEAR = 0.01
"""An arm that stands so near to the last point, rad or m, has done all that was sent."""

LATE_REST_S = 2.0
"""An arm that stands elsewhere so long after the last reply will not go there any more, s."""

_log = logging.getLogger(__name__)


@dataclass(slots=True)
class ServoCounts:
    """Setpoints since the start. late: those before which the arm had braked on its way."""

    received: int = 0
    refused: int = 0
    clipped: int = 0
    late: int = 0


@dataclass(slots=True, eq=False)
class _Session:
    """A stream that is followed. Times are the loop's, s.

    sent, sent_velocity: of the last point; sequence: of the next. waiting: its reply is awaited,
    since `posted`. span: tracker's time since the last point. time: of the last point. braked:
    the stream was silent, and the arm brakes. course: where positions lead from `heard` on.
    scale: the share of the limits.
    """

    setpoint: Setpoint
    tracker: SetpointTracker
    heard: float
    sent: Array
    sent_velocity: Array
    stepped: float
    standstill: Standstill
    scale: float
    course: Course | None = None
    estimate: VelocityEstimate = field(default_factory=VelocityEstimate)
    lead: Lead = field(default_factory=Lead)
    sequence: int = 0
    waiting: bool = False
    posted: float = 0.0
    answered: float = 0.0
    span: float = 0.0
    time: float = 0.0
    braked: bool = False

    @property
    def source(self) -> str:
        return self.setpoint.source

    @property
    def all_sent(self) -> bool:
        """Whether the controller has all that the tracker went, and has answered it."""
        if self.waiting or not self.sequence or not self.tracker.at_rest:
            return False
        return float(np.abs(self.sent - self.tracker.state[0]).max()) < MIN_STEP


@dataclass(slots=True)
class _Refused:
    """A stream that was refused: when it was last, whether it must be silent, what was said."""

    at: float
    until_silent: bool = False
    said: str = ''


class Servo:
    """Follows streams. `run` until cancelled; the rest is called meanwhile, in the same loop.

    `on_broken_off` is called with an outcome after which the arm must be enabled again, and
    whether an answer is missing. `settings` may be changed at any time.
    """

    def __init__(
        self,
        limits: JointLimits,
        robot: RobotState,
        gate: ArmGate,
        stopper: Stopper,
        goals: GoalQueue,
        on_broken_off: Callable[[Outcome, bool], None],
    ) -> None:
        self.settings = ServoSettings()
        self.counts = ServoCounts()
        self.lag = 0.0
        """How far the arm is behind the points that were sent, or was in the end, s."""
        self._limits = limits
        self._robot = robot
        self._gate = gate
        self._stopper = stopper
        self._goals = goals
        self._on_broken_off = on_broken_off
        self._session: _Session | None = None
        self._refused: dict[str, _Refused] = {}
        self._begun = asyncio.Event()
        self._looked = 0.0
        self._clipped_throttle = LogThrottle()
        self._invalid_throttle = LogThrottle()

    # --- what others want to know -----------------------------------------------------------

    @property
    def active(self) -> bool:
        """True while a stream is followed, or the arm still moves after one."""
        return self._session is not None

    @property
    def source(self) -> str:
        """The topic that is followed; '' if none is."""
        return '' if self._session is None else self._session.source

    @property
    def mode(self) -> Mode | None:
        """What is followed; None if nothing is."""
        return None if self._session is None else self._session.setpoint.mode

    def occupation(self) -> str | None:
        """Return why no goal may begin now; None: no stream has the arm any more."""
        session = self._session
        if session is None:
            return None
        now = _now()
        if now - session.heard > self.settings.timeout and self._done(session, now):
            self._end(session)
            return None
        return (
            f'the arm follows a stream of setpoints on {session.source}: end that, or call ~/stop'
        )

    # --- what comes in ----------------------------------------------------------------------

    def take(self, setpoint: Setpoint) -> None:
        """Follow a setpoint, if that may be; it replaces the one before."""
        now = _now()
        self.counts.received += 1
        if (problem := setpoint.problem(self._limits)) is not None:
            self._refuse_invalid(setpoint.source, problem, now)
        elif self._session is not None:
            self._go_on(self._session, setpoint, now)
        elif setpoint.at_rest:  # let go of
            self._refused.pop(setpoint.source, None)
        else:
            self._try_to_begin(setpoint, now)

    def refuse(self, source: str, why: str) -> None:
        """Take note of a message on a topic that is no setpoint at all."""
        self.counts.received += 1
        self._refuse_invalid(source, why, _now())

    def stop(self, why: str) -> bool:
        """Stop, and follow no stream that goes on; return whether there was one to stop."""
        for refused in self._refused.values():
            refused.until_silent = True
        session = self._session
        if session is None:
            return False
        self._session = None
        self._refused[session.source] = _Refused(_now(), until_silent=True)
        _log.warning('the stream on %s is not followed any more: %s', session.source, why)
        self._stopper.stop()
        return True

    def enabled(self) -> None:
        """Somebody enabled the arm: streams of positions may begin, if they are near it."""
        for refused in self._refused.values():
            refused.until_silent, refused.said = False, ''

    def withdraw(self) -> None:
        """Take a negative reply to something that the controller had acknowledged before."""
        if self._session is not None:
            self._break_off(self._session, 'the controller withdrew an acknowledgement')

    def on_joints(self, sample: JointSample, now: float) -> None:
        """Look at new joints."""
        session = self._session
        if session is None:
            return
        stopped = np.full(len(sample.positions), self._goals.settings.stopped_velocity)
        session.standstill.see(sample, self._robot, stopped, now)
        session.lead.see(sample)
        self.lag = session.lead.lag

    async def run(self) -> None:
        """Send points while there is a stream, until cancelled."""
        while True:
            await self._begun.wait()
            self._looked = due = _now()
            while (session := self._session) is not None:
                self._cycle(session, _now())
                due = max(due + CYCLE_S, _now())
                await asyncio.sleep(due - _now())
            self._begun.clear()

    # --- the beginning ----------------------------------------------------------------------

    def _try_to_begin(self, setpoint: Setpoint, now: float) -> None:
        why = self._why_not_yet(setpoint, now)
        if why is None:
            try:
                sample = self._goals.standing_sample(now)
                why = self._why_too_far(setpoint, sample)
                if why is None:
                    self._begin(setpoint, sample, now)
                    return
            except GoalRejectedError as rejection:
                why = 'not ready', str(rejection)
        self._refuse(setpoint, *why, now)

    def _why_not_yet(self, setpoint: Setpoint, now: float) -> tuple[str, str] | None:
        """Return what is in the way, a word for its kind first, or None."""
        before = self._refused.get(setpoint.source)
        must = before is not None and (before.until_silent or setpoint.mode is Mode.VELOCITY)
        if must and before is not None and now - before.at < SILENCE_S:
            return 'silent', f'it must be silent for {SILENCE_S:g} s first, or be let go of'
        if not self._goals.idle:
            return 'goal', 'a goal runs: cancel it, or wait until it has ended'
        if not self._stopper.over:
            return 'stop', 'the arm is being stopped'
        return None

    def _why_too_far(self, setpoint: Setpoint, sample: JointSample) -> tuple[str, str] | None:
        """Return which joint is too far from the first position, or from its range, or None."""
        limits, tolerance = self._limits, self.settings.start_tolerance
        inside = np.clip(sample.positions, limits.position_min, limits.position_max)
        wanted = inside if setpoint.positions is None else setpoint.positions
        for what, there in (('it begins', wanted), ('its range begins', inside)):
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

    def _begin(self, setpoint: Setpoint, sample: JointSample, now: float) -> None:
        """Begin a session where the arm stands. Raises GoalRejectedError."""
        limits = self._limits
        start = np.clip(sample.positions, limits.position_min, limits.position_max)
        standstill = Standstill(now)
        standstill.expect(None)
        tracker = SetpointTracker(
            servo_limits(limits, self.settings.share * DURATION_SHARE, STOP_WITHIN_S), start
        )
        session = _Session(
            setpoint,
            tracker,
            now,
            start,
            np.zeros_like(start),
            now,
            standstill,
            self.settings.share,
            answered=now,
        )
        first = self._message(session, start, session.sent_velocity, 0.0)
        self._session = session
        self._goals.plans.end('setpoints moved the arm, while the motion was planned')
        self._refused.pop(setpoint.source, None)
        self._plot(session, setpoint, now)
        self._note_beyond(setpoint, session, now)
        _log.info('following the stream of %ss on %s', setpoint.mode, setpoint.source)
        self._begun.set()
        self._post(session, first, now)

    def _go_on(self, session: _Session, setpoint: Setpoint, now: float) -> None:
        """Take a setpoint while a stream is followed."""
        if setpoint.source != session.source or setpoint.mode is not session.setpoint.mode:
            if not setpoint.at_rest:
                text = f'the arm follows the {session.setpoint.mode} stream on {session.source}'
                self._refuse(setpoint, 'two', text, now)
            return
        session.setpoint = setpoint
        if setpoint.at_rest and session.tracker.at_rest:
            return  # a stick at rest: the stream is as good as silent
        session.heard = now
        self._plot(session, setpoint, now)
        self.counts.late += session.braked
        session.braked = False
        self._note_beyond(setpoint, session, now)

    def _plot(self, session: _Session, setpoint: Setpoint, now: float) -> None:
        """Work out once where the positions of a setpoint lead."""
        if setpoint.positions is None:
            return
        estimate = session.estimate.add(now, setpoint.positions)
        session.course = Course(setpoint, self._limits, estimate)

    def _note_beyond(self, setpoint: Setpoint, session: _Session, now: float) -> None:
        beyond = setpoint.beyond(self._limits, session.tracker.limits.velocity)
        if beyond is None:
            return
        self.counts.clipped += 1
        if (line := self._clipped_throttle.line(beyond, now)) is not None:
            _log.warning('a setpoint on %s goes as far as it may: %s', setpoint.source, line)

    def _refuse(self, setpoint: Setpoint, kind: str, text: str, now: float) -> None:
        """Count it, and say why once for each kind of reason and stream."""
        self.counts.refused += 1
        refused = self._refused.get(setpoint.source)
        if refused is None or now - refused.at >= SILENCE_S:
            refused = self._refused[setpoint.source] = _Refused(now)
        refused.at = now
        if refused.said != kind:
            refused.said = kind
            _log.warning('the stream on %s is not followed: %s', setpoint.source, text)

    def _refuse_invalid(self, source: str, why: str, now: float) -> None:
        self.counts.refused += 1
        if (line := self._invalid_throttle.line(why, now)) is not None:
            _log.warning('a setpoint on %s was dropped: %s', source, line)

    # --- the way ----------------------------------------------------------------------------

    def _cycle(self, session: _Session, now: float) -> None:
        """Let the tracker go on, and send where it is, if that may be."""
        gap, self._looked = now - self._looked, now
        if (why := self._why_not_on()) is not None:
            self.stop(why)
        elif session.waiting:
            session.posted += max(gap - MAX_COUNTED_GAP_S, 0.0)  # its reply may be there
            waited = now - max(session.posted, session.standstill.alive)
            if waited > self.settings.reply_timeout:
                text = f'no reply to setpoint {session.sequence - 1}'
                self._break_off(
                    session, f'{text}: the arm has not moved for {waited:.3g} s', unanswered=True
                )
        elif session.lead.lag > MAX_LAG_S or self._robot.stale(now):
            session.stepped = now
            waited = now - max(session.answered, session.standstill.alive)
            if waited > self.settings.reply_timeout:
                self._break_off(session, f'the arm has not followed setpoints for {waited:.3g} s')
        else:
            self._step(session, now)
        silent = now - session.heard > SILENCE_S
        if silent and session is self._session and self._done(session, now):
            self._end(session)

    def _why_not_on(self) -> str | None:
        """Return what forbids every further point, or None."""
        if self._gate.reason is not None:
            return self._gate.reason
        if not self._stopper.over:
            return 'the arm is being stopped'
        if self._robot.paused:
            return 'the controller is paused'
        return None

    def _step(self, session: _Session, now: float) -> None:
        # a setpoint that replaces the one before is gone at once, and its absence is silence
        period = CYCLE_S if self._stopper.replaces else self.settings.period
        if now - session.stepped < period - CYCLE_S / 2.0:
            return
        dt = min(now - session.stepped, MAX_STEP_S)
        session.stepped = now
        tracker = session.tracker
        if not self._aim(session, now):
            self.stop('no stop inside every limit was found for the setpoints')
            return
        position, velocity, _ = tracker.step(dt)
        session.span += dt
        moved = float(np.abs(position - session.sent).max())
        if moved < (REST_STEP if tracker.at_rest else MIN_STEP):
            if tracker.at_rest:
                session.span = 0.0
            return
        try:
            message = self._message(session, position, velocity, session.span)
        except GoalRejectedError as rejection:  # a defect: it is the tracker's business
            self._break_off(session, f'setpoints break a limit: {rejection}')
            return
        session.lead.sent(now, position)
        self._post(session, message, now)

    def _aim(self, session: _Session, now: float) -> bool:
        """Tell the tracker where to go; return False if it cannot even brake."""
        tracker, setpoint = session.tracker, session.setpoint
        factor = self._goals.scaling.factor(now)
        silent = now - session.heard > self.settings.timeout
        if silent or factor == 0.0:
            session.braked |= silent and not tracker.at_rest
            return tracker.brake()
        if session.course is not None:
            found = self._follow(session, session.course, now - session.heard, factor)
        else:
            assert setpoint.velocities is not None  # noqa: S101 - one of the two is there
            found = tracker.move(setpoint.velocities * factor)
        return found or tracker.brake()

    def _follow(self, session: _Session, course: Course, age: float, factor: float) -> bool:
        """Follow positions, as far ahead in their window as the arm is behind."""
        setpoint = session.setpoint
        if setpoint.window is None and setpoint.velocities is None:
            if age > ESTIMATE_FRESH_S:
                return session.tracker.follow(course.at(0.0)[0], None, factor)
            return session.tracker.follow(*course.at(age), factor, ESTIMATE_LEAD_S)
        ahead = max(min(age + session.lead.behind, course.reach), age)
        return session.tracker.follow(*course.at(ahead), factor)

    def _message(
        self, session: _Session, position: Array, velocity: Array, span: float
    ) -> Message:
        """Return the message of the next point, `span` s of the tracker after the last one.

        Raises GoalRejectedError if it breaks a limit, or the controller takes no streams.
        """
        share = 1.0 if self._stopper.replaces else DURATION_SHARE
        duration = span * share
        way = Trajectory(
            self._limits.names,
            np.array([session.time, session.time + duration]),
            np.array([session.sent, position]),
            np.array([session.sent_velocity, velocity]) / share,
        )
        if span > 0.0:
            check_limits(way, self._limits, may_end_moving=True)
        message = self._stopper.setpoint(way, session.sequence, session.scale)
        session.sent, session.sent_velocity = position, velocity
        session.span = 0.0
        session.time += duration
        return message

    def _post(self, session: _Session, message: Message, now: float) -> None:
        """Send a point, unless something forbids it now."""
        if session is not self._session:
            return
        if (why := self._why_not_on()) is not None:
            self.stop(why)
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
        if session is not self._session:
            return  # STOP was sent since
        if (no := reply_rejection(packet)) is not None:
            text = f'the controller refused setpoint {sequence} ({no})'
            self._break_off(session, text, unexplained=True)
            return
        session.waiting, session.answered = False, now
        session.standstill.expect(now)

    # --- the end ----------------------------------------------------------------------------

    def _done(self, session: _Session, now: float) -> bool:
        """Return whether all that was sent is done, and the arm stands."""
        sample = self._robot.sample
        if sample is None or not session.all_sent:
            return False
        if not session.standstill.reached(sample.measured):
            return False
        return self._near(session, sample) or now - session.answered > LATE_REST_S

    def _near(self, session: _Session, sample: JointSample) -> bool:
        return float(np.abs(sample.positions - session.sent).max()) <= NEAR

    def _end(self, session: _Session) -> None:
        """End a stream that is over; the arm stands."""
        sample = self._robot.sample
        self._session = None
        if sample is not None and self._near(session, sample):
            self._stopper.goal_reached()
        _log.info('the stream on %s has ended, and the arm stands', session.source)

    def _break_off(
        self,
        session: _Session,
        why: str,
        *,
        unanswered: bool = False,
        unexplained: bool = False,
    ) -> None:
        """Stop, and have the arm disabled: nobody knows what the controller will do."""
        self._session = None
        self._refused[session.source] = _Refused(_now(), until_silent=True)
        self._stopper.stop()
        outcome = Outcome(End.ABORTED, ErrorCode.PATH_TOLERANCE_VIOLATED, why, unexplained)
        self._on_broken_off(outcome, unanswered)


def _now() -> float:
    return asyncio.get_running_loop().time()
