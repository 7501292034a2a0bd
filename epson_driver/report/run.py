# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Data of a recorded run, from a trace or a bag. Times are s since the start of the recording."""

import itertools
import statistics
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from epson_driver.driver.state.sender_clock import SenderClock
from epson_driver.error_texts import ErrorTexts
from epson_driver.motion import Array
from epson_driver.simple_message import Mode

UNKNOWN, NO, YES = -1, 0, 1  # values of industrial_msgs/TriState
NANOSECONDS = 1_000_000_000
FLAGS = ('drives_powered', 'e_stopped', 'in_error', 'in_motion', 'motion_possible')


class RunError(ValueError):
    """A file from which no report can be made. The text is the reason."""


@dataclass(frozen=True, slots=True)
class Condition:
    """A status of the controller: a STATUS message of its program, or a RobotStatus of ROS.

    `flags`: in the order of FLAGS. `mode`: -1 (unknown), 1 (manual) or 2 (auto).
    """

    time: float
    flags: tuple[int, ...]
    mode: int = UNKNOWN
    error_codes: tuple[int, ...] = ()

    def flag(self, name: str) -> int:
        return self.flags[FLAGS.index(name)]


@dataclass(frozen=True, eq=False)
class Plan:
    """A trajectory that was sent at the time `sent`, s.

    `times` are counted from the first point, shape (n,). `positions` have the shape (n, m).
    """

    sent: float
    times: Array
    positions: Array


@dataclass(frozen=True, slots=True)
class Event:
    """An event of the run. `level`: 'info', 'warning' or 'error'."""

    time: float
    level: str
    text: str
    remedy: str = ''


@dataclass(frozen=True, eq=False)
class Traffic:
    """All messages of one kind.

    `sender`: in a trace, 'controller' or 'driver'. In a bag, the type of the messages.
    """

    name: str
    sender: str
    times: Array


@dataclass(frozen=True, slots=True)
class Reply:
    """A request sent at `time`, s, whose reply arrived `latency` s later."""

    time: float
    latency: float
    name: str


@dataclass(frozen=True, eq=False)
class Run:
    """The recorded messages of one robot.

    * began: start of the recording, ns since 1970.
    * times: ascending times of the joint states, s, shape (k,).
    * positions: shape (k, m), rad or m.
    * velocities: measured by the controller, shape (k, m), or None.
    * links: time, port, and whether the port was connected (True) or disconnected (False).
    * notes: sentences on the limits of the recording.
    """

    source: str
    began: int
    joint_names: tuple[str, ...]
    times: Array
    positions: Array
    velocities: Array | None = None
    sent: Array | None = None  # estimated sending times of the joint states, s, shape (k,)
    conditions: Sequence[Condition] = ()
    plans: Sequence[Plan] = ()
    events: Sequence[Event] = ()
    traffic: Sequence[Traffic] = ()
    replies: Sequence[Reply] = ()
    links: Sequence[tuple[float, str, bool]] = ()
    notes: Sequence[str] = field(default=())
    ended: float = 0.0  # time of the last message, s

    def nanoseconds(self, time: float) -> int:
        return self.began + round(time * NANOSECONDS)


def array(values: Sequence[object], columns: int | None = None) -> Array:
    """Return values as an array, shape (k,), or (k, columns). `values` may be empty."""
    result = np.array(values, dtype=float)
    return result if columns is None else result.reshape(-1, columns)


MIN_MESSAGES = 20  # minimum number of messages for an estimate of their sending times


@dataclass(frozen=True, slots=True)
class Arrival:
    """The arrival of a state message at `time`, s.

    `stamp`: time in the message, by the controller's clock, s.
    """

    time: float
    joints: bool
    stamp: float | None = None


def sent_times(arrivals: Sequence[Arrival]) -> list[float]:
    """Return the estimated sending times of one connection's joint state messages, s.

    The times are ascending, on the receiver's clock. No message is sent later than it arrives.
    """
    if len(arrivals) < MIN_MESSAGES:
        return [arrival.time for arrival in arrivals if arrival.joints]
    gaps = [b.time - a.time for a, b in itertools.pairwise(arrivals)]
    clock = SenderClock(max(statistics.fmean(sorted(gaps)[: -len(gaps) // 20 or None]), 1e-4))
    sent: list[float] = []
    since: list[float] = []  # the clock's time of each message
    last: float | None = None
    for item in arrivals:
        passed = None
        if item.stamp is not None:
            passed = item.stamp - last if last is not None and item.stamp > last else None
            last = item.stamp
        gap = clock.gap
        shift = clock.step(item.time, passed)
        if shift and gap is not None:
            for index in reversed(range(len(since))):
                if since[index] < gap:
                    break
                since[index] += shift
                sent[index] = min(sent[index] + shift, item.time)
        if item.joints:
            since.append(clock.time)
            sent.append(max(clock.measured, sent[-1] + 1e-6) if sent else clock.measured)
    return sent


CHANGES = {
    ('drives_powered', YES): ('info', 'motors on', ''),
    ('drives_powered', NO): ('warning', 'motors off', 'call ~/enable when the arm may move again'),
    ('e_stopped', YES): (
        'error',
        'E-stop pressed',
        'release it, call ~/reset_error or reset at the controller, then ~/enable',
    ),
    ('e_stopped', NO): ('info', 'E-stop released', ''),
    ('in_error', NO): ('info', 'error cleared', 'call ~/enable when the arm may move again'),
}
"""Flag and its new value → level, text and remedy of the event."""

MODES: dict[int, tuple[str, str, str]] = {
    Mode.MANUAL: ('warning', 'key switch: manual', 'turn it back for motion from ROS'),
    Mode.AUTO: ('info', 'key switch: automatic', ''),
}

OTHERWISE = "look up the number in the controller's manual, reset, then ~/enable"


def condition_events(conditions: Sequence[Condition], texts: ErrorTexts) -> Iterator[Event]:
    """Yield an event for each error in the first condition, and for each later change."""
    before: Condition | None = None
    for now in conditions:
        for flag, value in CHANGES:
            is_new = before is None or before.flag(flag) != value
            report = CHANGES[flag, value]
            if now.flag(flag) == value and is_new and (before is not None or report[0] == 'error'):
                yield Event(now.time, *report)
        known = () if before is None else before.error_codes
        for code in now.error_codes:
            if code not in known:
                phrase = texts.phrase(code)
                yield Event(now.time, 'error', f'error {phrase}', texts.advice(code, OTHERWISE))
        new_error = before is None or before.flag('in_error') != YES
        if now.flag('in_error') == YES and new_error and not now.error_codes:
            yield Event(now.time, 'error', 'error without a number', OTHERWISE)
        if before is not None and now.mode != before.mode and now.mode in MODES:
            yield Event(now.time, *MODES[now.mode])
        before = now
