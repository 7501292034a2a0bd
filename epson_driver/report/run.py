# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A recorded run, independent of its source. Times are s since its beginning."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from epson_driver.motion import Array

UNKNOWN, NO, YES = -1, 0, 1
"""Values of industrial_msgs/TriState."""

NANOSECONDS = 1_000_000_000

FLAGS = ('drives_powered', 'e_stopped', 'in_error', 'in_motion', 'motion_possible')
"""Fields of industrial_msgs/RobotStatus."""


class RunError(ValueError):
    """A file from which no report can be made, with the reason as its text."""


@dataclass(frozen=True, slots=True)
class Condition:
    """The state reported by the controller at a time: a STATUS, or a RobotStatus.

    `flags`: in the order of FLAGS. `mode`: -1 (unknown), 1 (manual) or 2 (auto).
    """

    time: float
    flags: tuple[int, int, int, int, int]
    mode: int = UNKNOWN
    error_codes: tuple[int, ...] = ()

    def flag(self, name: str) -> int:
        """Return a flag by name."""
        return self.flags[FLAGS.index(name)]


@dataclass(frozen=True, eq=False)
class Plan:
    """A trajectory sent to the controller: the time of its first point, and its points.

    times: shape (n,), s from the first point. positions: shape (n, m), rad, m.
    """

    sent: float
    times: Array
    positions: Array


@dataclass(frozen=True, slots=True)
class Event:
    """An event of the run, of the `level` 'info', 'warning' or 'error'."""

    time: float
    level: str
    text: str
    remedy: str = ''


@dataclass(frozen=True, eq=False)
class Traffic:
    """All messages of one kind: name, sender ('controller', 'driver', or a topic's), times."""

    name: str
    sender: str
    times: Array


@dataclass(frozen=True, slots=True)
class Reply:
    """A request with a reply: when it was sent, the latency of the reply, s, and its kind."""

    time: float
    latency: float
    name: str


@dataclass(frozen=True, eq=False)
class Run:
    """One run of one robot.

    began: ns since 1970. times: shape (k,), s, ascending. positions: shape (k, m), rad, m.
    velocities: the same shape, as measured by the controller, or None. `links`: times when a port
    was connected or disconnected. `notes`: sentences on the limits of the recording.
    """

    source: str
    began: int
    joint_names: tuple[str, ...]
    times: Array
    positions: Array
    velocities: Array | None = None
    sent: Array | None = None
    """Estimated sending times of the joint states, s, shape (k,)."""
    conditions: Sequence[Condition] = ()
    plans: Sequence[Plan] = ()
    events: Sequence[Event] = ()
    traffic: Sequence[Traffic] = ()
    replies: Sequence[Reply] = ()
    links: Sequence[tuple[float, str, bool]] = ()
    notes: Sequence[str] = field(default=())
    ended: float = 0.0
    """Time of the last entry in the file, s."""

    def nanoseconds(self, time: float) -> int:
        """Return a time of the run as ns since 1970."""
        return self.began + round(time * NANOSECONDS)


def array(values: Sequence[object], columns: int | None = None) -> Array:
    """Return numbers as an array of shape (k,) or (k, columns), also for k = 0."""
    found = np.array(values, dtype=float)
    return found if columns is None else found.reshape(-1, columns)
