# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Invariants of every world, judged independently of the driver's own state.

An error in the driver's state would otherwise hide its own effect. Requests are known from the
users' actions and the answers to them, and the result is judged from the commanded positions of
the simulated arm. The numbers are from docs/invariants.md.
"""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from epson_driver.motion import Array
from epson_driver.simple_message import IoType

STILL_RAD = 1e-9
"""Maximum step of a commanded joint that counts as at rest."""

HOLD_RAD = 1e-4
"""Maximum motion of an arm that holds its measured position, rad, because encoders round."""

REACTION_S = 0.5
"""Maximum transit time of commands sent before a stop to an arm at rest, s."""

RELEASE_S = 0.999
"""Time for which a topic must request no motion after a stop (docs/servo.md), s."""

REMEMBERED_S = 8.0
"""Time for which true joint positions are stored, s. Published positions must be among them."""

HELD_S = 1.0
"""Time for which a stream without setpoints still counts as requesting motion, s."""

ANSWERED_S = 0.02
"""Time since the last motion after which an arm may be reported at rest, s."""

POSSIBLE_RAD = 0.15
"""Maximum distance of published joints outside their range, even if bits were flipped, rad."""

LATE_WRITE_S = 5.0
"""Time for which an unanswered write may still take effect, s."""

READ_RAD = 2e-3
"""Tolerance between published and true positions, rad, because encoders lag and round."""


class BrokenError(AssertionError):
    """A violated invariant, with its number and the observation."""


@dataclass
class Topic:
    """A topic with setpoints, from the users' view. Times in s.

    free: whether a stream was allowed to start after the last stop.
    """

    wanted: float = -np.inf
    """Time of the last request for motion."""
    closed: float = np.inf
    """Time of the last stop. The topic has not been released since then unless `free`."""
    free: bool = False


@dataclass
class Wishes:
    """The users' current requests: whether the arm may move, and why."""

    open: bool | None = False
    """Whether the arm is enabled: an enable has succeeded, and nothing has closed the gate since.
    None: unknown, because something closed it during an enable."""
    goals: set[int] = field(default_factory=set)
    """Goals submitted since the last stop that have not ended."""
    given_up: dict[int, float] = field(default_factory=dict)
    """Goals that are no longer wanted and have not ended, with the times, s."""
    closed_meanwhile: bool = False
    """Whether an event has closed the gate since the last request to open it."""
    person: bool = False
    """Whether a person at the controller has let the arm continue."""
    topics: dict[str, Topic] = field(default_factory=dict)
    asked: float = -np.inf
    """Time of the last new request for motion, s. It may be over before the next step."""

    def goal(self, number: int, now: float) -> None:
        self.goals.add(number)
        self.asked = now

    def give_up(self, goals: Iterable[int], now: float) -> None:
        for number in list(goals):
            if number in self.goals:
                self.goals.discard(number)
                self.given_up[number] = now

    def any(self, now: float) -> bool:
        followed = (topic.free and now - topic.wanted < HELD_S for topic in self.topics.values())
        return bool(self.goals) or self.person or any(followed)

    def nothing(self, now: float) -> None:
        """Record a stop, after which no motion is requested any more."""
        self.give_up(self.goals, now)
        self.person = False
        for topic in self.topics.values():
            topic.free = False
            topic.closed = now

    def closed(self, now: float) -> None:
        """Record an event that closes the gate and is known to all users."""
        shut = [] if self.open is not False else [t for t in self.topics.values() if not t.free]
        since = [topic.closed for topic in shut]  # topics closed before need no new release
        self.open, self.closed_meanwhile = False, True
        self.nothing(now)
        for topic, closed in zip(shut, since, strict=True):
            topic.closed = closed

    def setpoint(self, source: str, now: float, *, moves: bool) -> None:
        """Record a setpoint, which may start a stream under the rules after a stop."""
        topic = self.topics.setdefault(source, Topic(closed=now - 2.0))
        if not moves:
            return
        since = max(topic.wanted, topic.closed)
        if self.open is not False and (topic.free or now - since >= RELEASE_S):
            topic.free = True
            self.asked = now
        topic.wanted = now


class Arm:
    """Watches every step of the controller's arm. `look` receives its executor."""

    def __init__(
        self, controller: Any, now: Any, wishes: Wishes, settle: float, look: Callable[[Any], None]
    ) -> None:
        self._controller = controller
        self._look = look
        self._now = now
        self._wishes = wishes
        self._settle = settle
        self._step = controller.step
        controller.step = self.step
        self.moved = now()
        """Time of the last commanded motion, s."""
        self.travel = 0.0
        """Commanded travel, summed over all joints, rad."""
        self._unwanted_since: float | None = None
        self._rested = True
        """Whether the arm has been at rest since the last request for motion ended."""
        self._true: deque[tuple[float, Array]] = deque()
        self._commanded: Array = controller.arm.commanded.copy()
        self._rest, self._hold = self._commanded, HOLD_RAD
        """Position at which the arm must rest, and the tolerance in each joint, rad."""
        limits = controller.model.limits
        self._fastest = limits.velocity * (1.0 + 1e-6)
        self._cycle = controller.profile.rtmc.cycle if controller.real_time else 0.0
        self._low, self._high = limits.position_min - 1e-9, limits.position_max + 1e-9

    @property
    def at(self) -> Array:
        actual: Array = self._controller.servo.actual
        return actual

    @property
    def still(self) -> bool:
        """Whether the command and the servos of the arm are at rest."""
        return bool(self._now() - self.moved > 0.1)

    def step(self, seconds: float) -> None:
        """Advance the arm and judge its motion. Raises BrokenError."""
        self._step(seconds)
        self._look(self._controller.arm)
        now, wishes, moves = self._now(), self._wishes, False
        commanded, before = self._controller.arm.commanded, self._commanded
        if commanded.tobytes() != before.tobytes():  # faster than an array's !=
            self._commanded = commanded.copy()
            way = np.abs(commanded - before)
            span = max(seconds, self._cycle)  # real-time targets move the arm once per cycle
            if not (way <= self._fastest * span + 1e-9).all():  # also if it is not a number
                raise BrokenError(f'2: faster than its limit: {way / seconds}')
            if (commanded < self._low).any() or (commanded > self._high).any():
                raise BrokenError(f'2: outside its limits: {commanded}')
            moves = bool(way.max() > STILL_RAD)
            self.travel += float(way.sum())
        if moves:
            self.moved = now
        if not self._true or now - self.moved < REMEMBERED_S:
            self._remember(now)
        if wishes.any(now):
            self._unwanted_since, self._rested = None, False
            return
        if self._unwanted_since is None or wishes.asked >= self._unwanted_since:
            self._unwanted_since, self._rested = now, False
        if not self._rested:
            self._rested = self.still and now - self._unwanted_since > REACTION_S
            self._rest, self._hold = self._commanded, HOLD_RAD
        if not moves:
            return
        if self._rested and np.abs(self._commanded - self._rest).max() <= self._hold:
            return  # it holds its measured position
        if self._rested:
            raise BrokenError(
                f'4: the arm moves, without a request for {now - self._unwanted_since:.3f} s'
            )
        if now - self._unwanted_since > self._settle:
            raise BrokenError(
                f'3: the arm still moves {self._settle:g} s after the last request ended'
            )

    def rest(self, target: Array, away: float) -> None:
        """Expect the arm to stay close to a target from now on, after a goal has succeeded.

        It may still execute the last point within this distance.
        """
        self._unwanted_since, self._rested = self._now(), True
        self._rest, self._hold = target, away + HOLD_RAD

    def client_connected(self) -> None:
        """Expect old points to be executed until STOP has arrived (docs/safety.md)."""
        self._wishes.asked = self._now()

    def old_points_over(self, since: float) -> None:
        """Judge that STOP has arrived, if no motion was requested since. Raises BrokenError."""
        if self._now() - self.moved < ANSWERED_S and self._wishes.asked <= since:
            raise BrokenError('4: the arm executes old points after a client connected')

    def said_to_stand(self, request: str) -> None:
        """Judge that the arm is at rest, as an answer claims. Raises BrokenError."""
        if self._now() - self.moved < ANSWERED_S:
            raise BrokenError(f'9: ~/{request} reports an arm at rest, but it moves')

    def _remember(self, now: float) -> None:
        """Store the current position. During a long rest, the last stored ones remain."""
        while self._true and now - self._true[0][0] > REMEMBERED_S:
            self._true.popleft()
        self._true.append((now, self.at.copy()))

    def published(self, positions: Array, *, unsure: bool = False) -> None:
        """Judge joint positions published by the driver. Raises BrokenError.

        unsure: bits were flipped in transit, so the positions need only be possible.
        """
        beyond = (positions < self._low - POSSIBLE_RAD) | (positions > self._high + POSSIBLE_RAD)
        if beyond.any() or not np.isfinite(positions).all():
            raise BrokenError(f'8: joints are published that cannot be: {positions}')
        if unsure:
            return
        for _, where in reversed(self._true):
            if np.abs(positions - where).max() <= READ_RAD:
                return
        if self._true:
            known = np.array([where for _, where in self._true])
            low, high = known.min(axis=0) - READ_RAD, known.max(axis=0) + READ_RAD
            if np.any(positions < low) or np.any(positions > high):
                raise BrokenError(
                    f'8: joints are published where the arm has not been for '
                    f'{REMEMBERED_S:g} s: {positions}'
                )


@dataclass
class Writing:
    """A pending write of an output. `alone`: no other change of the output occurred."""

    value: int
    until: float = np.inf
    """Time after which the write can no longer take effect, s."""
    answered: bool = False
    alone: bool = True

    def done(self) -> None:
        self.answered = True


class Outputs:
    """Watches the controller's outputs: only requested values may be written.

    They may become 0, the safe value, at any time. `break_` receives violations.
    """

    def __init__(
        self, points: Any, now: Callable[[], float], break_: Callable[[BrokenError], object]
    ) -> None:
        self._points, self._now, self._break = points, now, break_
        self._values = self._read()
        self._writes: dict[int, list[Writing]] = {}
        self._readers: dict[int, list[set[int]]] = {}
        points.listen(self._changed)

    def _read(self) -> tuple[int, ...]:
        values: tuple[int, ...] = self._points.read_range(
            IoType.DIGITAL_OUTPUT, 0, self._points.profile.digital_outputs
        )
        return values

    def _changed(self) -> None:
        before, self._values = self._values, self._read()
        for index, (old, new) in enumerate(zip(before, self._values, strict=True)):
            if old == new:
                continue
            writes = [item for item in self._writes.get(index, []) if self._now() < item.until]
            self._writes[index] = writes
            for held in self._readers.get(index, []):
                held.add(new)
            for element in writes:
                element.alone &= element.value == new
            if new and all(write.value != new for write in writes):
                self._break(BrokenError(f'1: output {index} becomes {new} without a request'))

    @contextmanager
    def reading(self, index: int) -> Iterator[set[int]]:
        held = {self._values[index]}
        readers = self._readers.setdefault(index, [])
        readers.append(held)
        try:
            yield held
        finally:
            readers.remove(held)

    @contextmanager
    def writing(self, index: int, value: int) -> Iterator[Writing]:
        """Allow a value during the block, and later if it ends without an answer."""
        writing = Writing(value)
        writes = self._writes.setdefault(index, [])
        for write in writes:
            write.alone = False
        writing.alone = not writes
        writes.append(writing)
        try:
            yield writing
        finally:
            writing.until = self._now() + (0.0 if writing.answered else LATE_WRITE_S)
            if writing.answered and writing.alone and self._values[index] != value:
                text = f'9: output {index} = {value} is answered as done, and it is not'
                self._break(BrokenError(text))
