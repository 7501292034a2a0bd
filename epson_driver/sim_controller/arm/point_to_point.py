# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Point-to-point motion like SPEL+'s `Go`: straight lines in joint space from rest to rest.

An accepted point is a `Go` statement. The rules:
* The motion of a statement starts at least `statement_overhead` s after its acceptance. The arm
  does not wait for this time if the previous statement is executing long enough.
* A statement counts as executed, and the program continues, when the arm is at rest at its target.
  With `cp` (`Go … CP`) it already counts as executed when the deceleration starts. If the next
  statement is known by then, the two motions overlap as far as no limit is exceeded. Otherwise the
  arm comes to rest first. With `late_blend` they also overlap if the next statement arrives during
  the deceleration.
* A statement with a `path` follows it from rest to rest and never overlaps.
* A point is acknowledged when it is executed, and only then is the next one accepted. With
  `acknowledge='taken'` it is acknowledged when it is accepted, and one is accepted ahead of the
  executing one.

"""

from collections import deque
from dataclasses import dataclass
from math import inf
from typing import Literal

import numpy as np

from epson_driver.motion import Array, JointLimits, LineMotion, go
from epson_driver.motion.joint_motion import JointMotion, stop_joints
from epson_driver.motion.point_to_point import check_fractions, check_target, go_in
from epson_driver.profiles.profile import MotionProfile
from epson_driver.sim_controller.arm.executor import Motion, PathMotion, Point
from epson_driver.sim_controller.arm.low_power import LowPower
from epson_driver.sim_controller.arm.overlap import blend_start

Stop = Motion | JointMotion


@dataclass(slots=True, eq=False)
class Statement:
    """A `Go` statement.

    * target: joint positions, shape (n,), rad.
    * speed, accel: fractions of the limits.
    * ready, duration: earliest start, s, and minimum duration, s (0: not specified).
    * executed: whether the program may continue, though the arm may still decelerate.
    * started: whether the motion has started.
    * cp: whether the statement counts as executed as soon as the arm decelerates.
    * path: the path (None: a straight line in joint space).
    """

    target: Array
    speed: float
    accel: float
    ready: float
    duration: float = 0.0
    executed: bool = False
    started: bool = False
    cp: bool = False
    path: PathMotion | None = None


@dataclass(slots=True, eq=False)
class Segment:
    """The motion of a statement, with its start time `start`, s.

    * speed: fraction of the limits.
    * decelerates: whether the deceleration of a statement with `cp` has started, so the next
      motion may start.
    """

    statement: Statement
    motion: Motion
    start: float
    speed: float
    low_power: bool
    decelerates: bool = False

    @property
    def braking(self) -> float:
        return self.start + self.motion.braking

    @property
    def end(self) -> float:
        return self.start + self.motion.duration


@dataclass(frozen=True, slots=True, eq=False)
class Brake:
    """A stop, with its start time `start`, s."""

    motion: Stop
    start: float

    @property
    def end(self) -> float:
        return self.start + self.motion.duration


OVERLAP_FRACTION = 0.5
"""Maximum fraction of the acceleration that a move with CP uses, so that two moves may overlap."""


OVERLAP_ATTEMPTS = 4
"""Maximum number of times that a timed move is replanned to make up for its overlap.

The move takes longer by its overlap with the previous move, which changes the overlap again.
"""


class PointToPoint:
    """An arm that moves from point to point within its limits.

    The velocity of a point can only make its move slower. With `cp`, moves overlap, and each uses
    at most half of the acceleration. Raises ValueError if `start` is not within the limits, or a
    fraction is out of range.

    * start: joint positions, shape (n,), rad.
    * motion: the initial Speed and Accel of SPEL+, `cp` and `statement_overhead`.
    * caps: caps at low power (None: low power has no effect).
    * timed: whether a point's duration can also make its move slower. If not, durations are
    ignored.
    * Other parameters: see the module's docstring.
    """

    def __init__(
        self,
        limits: JointLimits,
        start: Array,
        motion: MotionProfile,
        *,
        acknowledge: Literal['default', 'taken'] = 'default',
        caps: LowPower | None = None,
        timed: bool = False,
        late_blend: bool = False,
    ) -> None:
        self.limits = limits
        self.low_power = False
        self._speed = motion.speed
        self._accel = motion.accel
        self._cp = motion.cp
        self._overhead = motion.statement_overhead
        self._acknowledges_early = acknowledge == 'taken'
        self._max_unexecuted = 2 if self._acknowledges_early else 1
        self._caps = caps
        self._timed = timed
        self._late_blend = late_blend
        self.started_points = 0
        self._now = 0.0
        self._rest = go(limits, start, start, motion.speed, motion.accel).end
        self._queue: deque[Statement] = deque()  # statements that have not started
        # Started segments. The last may start before the previous one ends. At most two move.
        self._segments: list[Segment] = []
        self._brake: Brake | None = None
        self._stopping = False
        self._paused = False

    @property
    def speed(self) -> float:
        return self._speed

    @speed.setter
    def speed(self, value: float) -> None:
        check_fractions(value, self._accel)
        self._speed = value

    @property
    def accel(self) -> float:
        return self._accel

    @accel.setter
    def accel(self, value: float) -> None:
        check_fractions(self._speed, value)
        self._accel = value

    @property
    def moving(self) -> bool:
        return bool(self._segments or self._queue or self._brake)

    @property
    def at_rest(self) -> bool:
        return not (self._segments or self._brake) and (self._paused or not self._queue)

    @property
    def has_room(self) -> bool:
        """Whether the arm accepts another point now.

        It accepts none while it brakes after `stop`.
        """
        return not self._stopping and self._unexecuted() < self._max_unexecuted

    @property
    def done(self) -> bool:
        return self._acknowledges_early or not (self._stopping or self._unexecuted())

    @property
    def due_in(self) -> float:
        """Time until the next motion starts, ends or counts as executed, s.

        The time is inf if no motion is pending.
        """
        return self._next_event_time() - self._now

    @property
    def elapsed(self) -> float:
        return self._now - self._segments[0].start if self._segments else 0.0

    @property
    def destination(self) -> Array:
        """Rest position after all accepted statements, shape (n,), rad."""
        if self._queue:
            return self._queue[-1].target.copy()
        if self._brake is not None:
            return self._brake.motion.end.copy()
        return self._segments[-1].motion.end.copy() if self._segments else self._rest.copy()

    @property
    def position(self) -> Array:
        # Rounding can place the end of a line at a limit slightly beyond it.
        low, high = self.limits.position_min, self.limits.position_max
        position, _, _ = self._state()
        nearest: Array = np.minimum(
            np.maximum(position, low), high
        )  # np.clip takes four times as long
        return nearest

    @property
    def velocity(self) -> Array:
        return self._state()[1]

    def take(self, point: Point) -> None:
        """Accept a point. A point at the current position causes no motion."""
        if not self.has_room:
            raise RuntimeError('no room for a point')
        check_fractions(point.velocity or 1.0, self._accel)
        check_target(point.target, self.limits)
        if not self.moving:
            self._now = 0.0
        speed = min(self._speed, point.velocity or 1.0)
        duration = point.duration if self._timed else 0.0
        ready = self._now + self._overhead
        cp = self._cp if point.cp is None else point.cp
        target = point.target.copy()
        self._queue.append(
            Statement(target, speed, self._accel, ready, duration, cp=cp, path=point.path)
        )
        if not self._segments and not self._brake and not self._paused:
            self._skip(self._rest)
        elif self._segments and self._segments[-1].decelerates:
            last = self._segments[-1]
            if self._now <= (last.end if self._late_blend else last.braking):
                self._blend()

    def stop(self) -> bool:
        lost = [self._acknowledges_early or statement.executed for statement in self._statements()]
        self._queue.clear()
        self._paused = False
        self._start_brake()
        self._stopping = self._brake is not None
        return any(lost)

    def hold(self) -> None:
        """Brake on the path. While two moves overlap, each joint brakes independently."""
        if not self._paused:
            self._paused = True
            self._queue.extendleft(segment.statement for segment in reversed(self._segments))
            self._start_brake()

    def resume(self) -> None:
        self._paused = False

    def set_position(self, position: Array) -> None:
        if self.moving:
            raise RuntimeError('the arm is moving or has pending points')
        check_target(position, self.limits)
        self._rest = position.copy()

    def step(self, dt: float) -> float | None:
        if not self.moving:
            return dt
        until = self._now + dt
        while (due := self._next_event_time()) <= until:
            self._now = max(self._now, due)
            before = self._unexecuted()
            self._process_event()
            if self._unexecuted() < before or not self.moving:
                return min(until - self._now, dt)
        self._now = until
        return None

    def _state(self) -> tuple[Array, Array, Array]:
        if self._brake is not None:
            return self._brake.motion.at(self._now - self._brake.start)
        if not self._segments:
            zeros = np.zeros_like(self._rest)
            return self._rest.copy(), zeros, zeros.copy()
        first, *others = self._segments
        position, velocity, acceleration = first.motion.at(self._now - first.start)
        for segment in others:
            p, v, a = segment.motion.at(self._now - segment.start)
            position = position + (p - segment.motion.origin)
            velocity, acceleration = velocity + v, acceleration + a
        return position, velocity, acceleration

    def _statements(self) -> list[Statement]:
        return [segment.statement for segment in self._segments] + list(self._queue)

    def _unexecuted(self) -> int:
        return sum(not statement.executed for statement in self._statements())

    # Events and their times.

    def _next_event_time(self) -> float:
        if self._brake is not None:
            return self._brake.end
        if self._segments:
            last = self._segments[-1]
            braking = last.braking if last.statement.cp and not last.decelerates else inf
            return min(self._segments[0].end, braking)
        return self._queue[0].ready if self._queue and not self._paused else inf

    def _process_event(self) -> None:
        if self._brake is not None:
            self._rest = self._brake.motion.end
            self._brake = None
            self._stopping = False
        elif not self._segments:
            self._skip(self._rest)
            if self._queue and self._queue[0].ready <= self._now:
                self._mark_started(self._queue[0])
                self._segments.append(self._segment(self._queue.popleft(), self._rest))
        elif self._now < self._segments[0].end:
            last = self._segments[-1]
            last.decelerates = last.statement.executed = True
            self._blend()
        else:
            ended = self._segments.pop(0)
            self._rest = ended.motion.end
            ended.statement.executed = True

    def _stays(self, position: Array) -> bool:
        """Return whether the target of the next statement is `position`, compared as float32."""
        return bool(self._queue) and np.array_equal(
            position.astype(np.float32), self._queue[0].target.astype(np.float32)
        )

    def _skip(self, position: Array) -> None:
        """Skip the next statements as long as their target is `position`."""
        while self._stays(position):
            statement = self._queue.popleft()
            statement.executed = True
            self._mark_started(statement)

    def _mark_started(self, statement: Statement) -> None:
        self.started_points += not statement.started
        statement.started = True

    def _segment(self, statement: Statement, start: Array, overlap: float = 0.0) -> Segment:
        """Return the move of a statement that starts now from rest at `start`, shape (n,), rad.

        `overlap`, s, is the time for which the move overlaps the previous move. If the statement
        has a duration, the move takes at least this duration plus `overlap`.
        """
        if statement.path is not None:
            along = statement.path(start, self.low_power)
            return Segment(statement, along, self._now, statement.speed, self.low_power)
        speed, accel, maximum = statement.speed, statement.accel, 1.0
        if self.low_power and self._caps is not None:
            speed = min(speed, self._caps.speed(self.limits, statement.target - start))
            maximum = self._caps.fraction
        # With CP two moves overlap, and each may use half of the acceleration.
        overlaps = statement.cp or bool(self._segments)
        accel = min(accel, OVERLAP_FRACTION * maximum if overlaps else maximum)
        duration = statement.duration + overlap if statement.duration else 0.0
        motion = go_in(self.limits, start, statement.target, duration, speed, accel)
        return Segment(statement, motion, self._now, speed, self.low_power)

    def _blend(self) -> None:
        last = self._segments[-1]
        if self._queue and self._queue[0].cp:  # any other statement ends when the arm is at rest
            self._skip(last.motion.end)
        if not self._queue or self._stays(last.motion.end) or self.low_power is not last.low_power:
            return
        statement = self._queue[0]
        if statement.path is not None or last.statement.path is not None:
            return
        # Only two moves may overlap.
        others_end = self._segments[-2].end if len(self._segments) > 1 else 0.0
        start, overlap = max(self._now, statement.ready, others_end), 0.0
        for _ in range(OVERLAP_ATTEMPTS):
            segment = self._segment(statement, last.motion.end, overlap)
            start = max(start, self._overlap_start(last, segment, start))
            if start >= last.end:
                return
            segment.start = start
            if statement.duration == 0.0 or last.end - start <= overlap:
                self._segments.append(segment)
                self._mark_started(self._queue.popleft())
                return
            overlap = last.end - start

    def _overlap_start(self, last: Segment, segment: Segment, earliest: float) -> float:
        caps = self._caps if self.low_power else None
        # Statements with a path never overlap, so both motions are straight.
        assert isinstance(last.motion, LineMotion)  # noqa: S101
        assert isinstance(segment.motion, LineMotion)  # noqa: S101
        return last.start + blend_start(
            last.motion,
            segment.motion,
            self.limits,
            earliest - last.start,
            speed=max(last.speed, segment.speed),
            accel=1.0 if caps is None else caps.fraction,
            tool=None if caps is None else (caps.reach, caps.tool_speed),
        )

    def _start_brake(self) -> None:
        if not self._segments:
            return
        started = [
            segment for segment in self._segments if segment.start < self._now
        ] or self._segments[:1]
        if len(started) == 1:
            motion: Stop = started[0].motion.stop(self._now - started[0].start)
        else:
            motion = stop_joints(self.limits, self._state())
        self._segments.clear()
        self._brake = Brake(motion, self._now)
        if motion.duration == 0.0:
            self._process_event()
