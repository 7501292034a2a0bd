# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A run as it was recorded, wherever it was read from. Times are s since its beginning."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from epson_driver.motion import Array

UNKNOWN, NO, YES = -1, 0, 1
"""Values of a lamp, as in industrial_msgs/TriState."""

NANOSECONDS = 1_000_000_000

FLAGS = ('drives_powered', 'e_stopped', 'in_error', 'in_motion', 'motion_possible')
"""The lamps, by the names of industrial_msgs/RobotStatus."""


class RunError(ValueError):
    """A file from which no report can be made, with the reason as its text."""


@dataclass(frozen=True, slots=True)
class Condition:
    """What the controller said of itself at a time: a STATUS, or a RobotStatus.

    `flags` are in the order of FLAGS; `mode` is -1 (unknown), 1 (manual) or 2 (auto).
    """

    time: float
    flags: tuple[int, int, int, int, int]
    mode: int = UNKNOWN
    error_codes: tuple[int, ...] = ()

    def flag(self, name: str) -> int:
        """Return one of the flags."""
        return self.flags[FLAGS.index(name)]


@dataclass(frozen=True, eq=False)
class Plan:
    """A trajectory that was sent: when its first point was, and its points.

    times: shape (n,), s from the first point; positions: shape (n, m), rad, m.
    """

    sent: float
    times: Array
    positions: Array


@dataclass(frozen=True, slots=True)
class Event:
    """Something worth reading, of the `level` 'info', 'warning' or 'error'."""

    time: float
    level: str
    text: str
    remedy: str = ''


@dataclass(frozen=True, eq=False)
class Traffic:
    """All messages of one kind: which, from whom ('controller', 'driver', or a topic's), when."""

    name: str
    sender: str
    times: Array


@dataclass(frozen=True, slots=True)
class Reply:
    """A request that was answered: when it was sent, how long its reply took, s, and its kind."""

    time: float
    latency: float
    name: str


@dataclass(frozen=True, eq=False)
class Run:
    """One run of one robot.

    began: ns since 1970. times: shape (k,), s, ascending; positions: shape (k, m), rad, m;
    velocities: the same shape as measured by the controller, None if it sends none. `links` says
    when a port was connected and when not; `notes` are sentences on what the file does not tell.
    """

    source: str
    began: int
    joint_names: tuple[str, ...]
    times: Array
    positions: Array
    velocities: Array | None = None
    sent: Array | None = None
    """When the controller sent the joint states, s, shape (k,), as far as it can be known."""
    conditions: Sequence[Condition] = ()
    plans: Sequence[Plan] = ()
    events: Sequence[Event] = ()
    traffic: Sequence[Traffic] = ()
    replies: Sequence[Reply] = ()
    links: Sequence[tuple[float, str, bool]] = ()
    notes: Sequence[str] = field(default=())
    ended: float = 0.0
    """Time of the last thing in the file, s."""

    def nanoseconds(self, time: float) -> int:
        """Return a time of the run as ns since 1970."""
        return self.began + round(time * NANOSECONDS)


def array(values: Sequence[object], columns: int | None = None) -> Array:
    """Return numbers as an array, of shape (k,) or (k, columns) even if there are none."""
    found = np.array(values, dtype=float)
    return found if columns is None else found.reshape(-1, columns)
