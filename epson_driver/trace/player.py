# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The controller's side of a recording, played to a client that is not the recorded one.

No sockets and no clock: what the client does and what time it is come in as calls; what is to be
sent and closed comes out of `advance`. The rules:

* Time runs as recorded, times the speed, from the client's first connection on.
* When it is the client's turn (to connect, or to send the next request), the recording waits for
  it. Topics go on meanwhile: the last of each type, at their usual rate.
* A client that is earlier than recorded is not kept waiting: the recording jumps to that moment.
  Of the topics in between, the last of each type is sent.
* A request is the recorded one if its bytes are the same, or else its type and sequence.
* Requests are only expected in their order. What was not recorded there has no answer: none is
  made up. Heartbeats are left out: how many there are is the client's own affair.
"""

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from epson_driver.simple_message import MessageType
from epson_driver.trace.script import Entry, Kind, Script, Splitter, signature

MIN_PERIOD_S = 1e-3
"""Least time between topics that are sent again, s."""

MANY = 3
"""Of the same complaint in a row, so many are told."""


@dataclass
class Score:
    """The played entries, and how well the client matched."""

    sent: int = 0
    repeated: int = 0
    left_out: int = 0
    same: int = 0
    """Requests with the recorded bytes."""
    alike: int = 0
    """Requests with the type and sequence of the recorded one, but other values."""
    unknown: int = 0
    """Requests that were not recorded there: not answered."""
    missing: int = 0
    """Recorded requests that did not come."""


@dataclass(frozen=True, slots=True)
class Order:
    """An action on a connection: send the data, or as `kind` says."""

    connection: int
    kind: Kind
    data: bytes = b''


class _Live:
    """A client's connection that plays a recorded one."""

    def __init__(self) -> None:
        self.splitter = Splitter()
        self.last: dict[int, tuple[float, bytes]] = {}
        """Of each type of topic: when it was sent, and the frame."""


class Player:
    """Plays a script once, twice as fast with a `speed` of 2, by any clock in s."""

    def __init__(self, script: Script, speed: float, tell: Callable[[str], None]) -> None:
        self.score = Score()
        self._script = script
        self._speed = speed
        self._tell = tell
        self._position = 0.0
        self._now: float | None = None
        self._cursor = 0
        entries = script.entries
        turns = [index for index, entry in enumerate(entries) if entry.clients_turn]
        self._turns = deque(turns)
        """Indices of the client's turns that it has not taken, from the first on."""
        self._taken: set[int] = set()
        self._reach = -1
        """What lies before this index need not be waited for."""
        self._requests: dict[int, deque[int]] = {number: deque() for number in script.port_of}
        for index in turns:
            if entries[index].kind is Kind.REQUEST:
                self._requests[entries[index].connection].append(index)
        self._opens = deque(index for index in turns if entries[index].kind is Kind.OPEN)
        self._live: dict[int, _Live] = {}
        self._over: set[int] = set()
        self._waiting = False
        self._complaint = ('', 0)

    @property
    def done(self) -> bool:
        """Whether the recording is over, or no client is left."""
        left_alone = self._now is not None and not self._live and not self._opens
        return self._cursor == len(self._script.entries) or left_alone

    @property
    def waits_for(self) -> str:
        """The client's next step in the recording, or '' if there is none."""
        if not self._waiting or not self._turns:
            return ''
        entry = self._script.entries[self._turns[0]]
        name = self._name(entry.connection)
        if entry.kind is Kind.OPEN:
            return f'a connection to the {name} port'
        return f'a request on the {name} port: {_text(entry)}'

    def connect(self, port: int, now: float) -> int | None:
        """Return the recorded connection that a new one plays, or None: to be refused now.

        `port` is the recorded one. After the first, connections are there from their recorded
        time on: a controller that was off then is off now.
        """
        for index in self._opens:
            entry = self._script.entries[index]
            if self._script.port_of[entry.connection] != port:
                continue
            first = index == self._first_open(port)
            if not first and self._position < entry.time:
                return None
            self._opens.remove(index)
            self._live[entry.connection] = _Live()
            if self._now is None:
                self._now = now
            self._take(index)
            return entry.connection
        return None

    def plays(self, connection: int) -> bool:
        """Return whether a connection is still there."""
        return connection in self._live

    def receive(self, connection: int, data: bytes) -> None:
        """Take bytes from the client."""
        for piece, frame in self._live[connection].splitter.split(data):
            if frame is not None and frame.heartbeat:
                continue
            expected = self._requests[connection]
            index = expected[0] if expected else None
            entry = self._script.entries[index] if index is not None else None
            if index is not None and entry is not None and entry.data == piece:
                self.score.same += 1
            elif (
                frame is not None
                and entry is not None
                and entry.frame is not None
                and signature(frame) == signature(entry.frame)
            ):
                self.score.alike += 1
                self._complain('%s was recorded with other values', _text(entry))
            else:
                self.score.unknown += 1
                what = _text(Entry(0.0, Kind.REQUEST, connection, piece, frame))
                wanted = f'next is {_text(entry)}' if entry else 'no more requests were'
                self._complain(f'%s was not recorded here ({wanted}): no answer', what)
                continue
            expected.popleft()
            if index is not None:
                self._take(index)

    def leave(self, connection: int) -> None:
        """Take note that the client closed a connection, whose rest cannot be played."""
        if self._live.pop(connection, None) is not None:
            self._void(connection)

    def advance(self, now: float) -> list[Order]:
        """Return the actions that are due."""
        if self._now is None:
            return []
        target = self._position
        if not self._waiting:
            target += (now - self._now) * self._speed
        self._now = now
        self._waiting = False
        orders: list[Order] = []
        newest = self._newest_before_jump(target)
        entries = self._script.entries
        while self._cursor < len(entries):
            entry = entries[self._cursor]
            ahead = entry.time > target
            if self._cursor <= self._reach:
                key = (entry.connection, entry.topic)
                if ahead and newest.get(key, self._cursor) != self._cursor:
                    self.score.left_out += 1
                else:
                    orders += self._play(entry, now)
                if self._cursor == self._reach:
                    target = max(target, entry.time)
            elif ahead:
                break
            elif entry.clients_turn and self._turns and self._cursor == self._turns[0]:
                self._waiting = True
                target = entry.time
                break
            else:
                orders += self._play(entry, now)
            self._cursor += 1
        self._position = max(self._position, target)
        if self._waiting:
            orders += self._again(now)
        return orders

    def wait(self) -> float | None:
        """Return how long after the last `advance` the next is needed, s, or None."""
        if self._now is None or self._cursor == len(self._script.entries):
            return None
        if not self._waiting:
            due = self._script.entries[self._cursor].time
            return max(due - self._position, 0.0) / self._speed
        times = [
            live.last[kind][0] + self._period(number, kind) - self._now
            for number, live in self._live.items()
            for kind in live.last
        ]
        return max(min(times), 0.0) if times else None

    def finish(self) -> Score:
        """Return the final score."""
        self.score.missing += sum(map(len, self._requests.values()))
        self._requests = {}
        return self.score

    def _first_open(self, port: int) -> int:
        """Return the index of the first connection to a port, before which it was never down."""
        for index, entry in enumerate(self._script.entries):
            if entry.kind is Kind.OPEN and self._script.port_of[entry.connection] == port:
                return index
        raise AssertionError(port)

    def _take(self, index: int) -> None:
        """Take a turn of the client, skipping an earlier one that is missing."""
        self._taken.add(index)
        self._go_on()

    def _go_on(self) -> None:
        while self._turns and self._turns[0] in self._taken:
            first = self._turns.popleft()
            if self._script.entries[first].connection not in self._over:
                self._reach = max(self._reach, first)

    def _void(self, connection: int) -> None:
        """Nothing more is expected on a connection, nor sent."""
        self._over.add(connection)
        missing = self._requests[connection]
        self.score.missing += len(missing)
        if missing:
            name = self._name(connection)
            self._tell(f'the client closed the {name} port before {len(missing)} requests')
        lost = set(missing)
        missing.clear()
        self._turns = deque(index for index in self._turns if index not in lost)
        self._go_on()

    def _newest_before_jump(self, target: float) -> dict[tuple[int, int | None], int]:
        """Return, if time must jump, the index of the last topic of each type before there."""
        entries = self._script.entries
        if self._reach < self._cursor or entries[self._reach].time <= target:
            return {}
        return {
            (entries[index].connection, entries[index].topic): index
            for index in range(self._cursor, self._reach)
            if entries[index].topic is not None
        }

    def _play(self, entry: Entry, now: float) -> Iterator[Order]:
        live = self._live.get(entry.connection)
        if entry.clients_turn:
            return
        if live is None:
            self.score.left_out += entry.kind is Kind.SEND
            return
        if entry.kind is Kind.SEND:
            self.score.sent += 1
            if entry.topic is not None:
                live.last[entry.topic] = (now, entry.data)
        else:
            del self._live[entry.connection]
            self._void(entry.connection)
        yield Order(entry.connection, entry.kind, entry.data)

    def _again(self, now: float) -> Iterator[Order]:
        """Send the topics that are due while the recording waits."""
        for number, live in self._live.items():
            for kind, (sent, data) in live.last.items():
                if now - sent >= self._period(number, kind) - 1e-6:
                    live.last[kind] = (now, data)
                    self.score.repeated += 1
                    yield Order(number, Kind.SEND, data)

    def _period(self, connection: int, kind: int) -> float:
        period = self._script.periods.get((connection, kind), 1.0)
        return max(period, MIN_PERIOD_S) / self._speed

    def _name(self, connection: int) -> str:
        port = self._script.port_of[connection]
        return next(role for role, number in self._script.ports.items() if number == port)

    def _complain(self, text: str, what: str) -> None:
        last, count = self._complaint
        kind = text.split('(')[0]
        self._complaint = (kind, count + 1 if kind == last else 1)
        if self._complaint[1] <= MANY:
            more = ' (and so on)' if self._complaint[1] == MANY else ''
            self._tell(text % what + more)


def _text(entry: Entry) -> str:
    """Return a name for a message."""
    if entry.frame is None:
        return f'{len(entry.data)} bytes that are no message'
    number, _, sequence = signature(entry.frame)
    try:
        name = MessageType(number).name
    except ValueError:
        name = f'message type {number}'
    return name if sequence is None else f'{name} {sequence}'
