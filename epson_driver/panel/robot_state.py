# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The reported state of a robot's driver, with arrival times and maximum ages."""

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum

import numpy as np

from epson_driver.driver.inhibit import Inhibit
from epson_driver.motion import Array

INFO, WARN, ERROR = 20, 30, 40
"""Log levels of rcl_interfaces/Log."""

MAX_EVENTS = 200

SAME_NEWS_S = 2.0
MAX_COMPARED = 5
"""Interval for merging log lines, s. The driver often logs a request's answer too, so nearby lines
with the same text are one event."""

MAX_AGES_S = {'joints': 1.0, 'status': 2.5, 'diagnostics': 3.5, 'simulation': 3.0}
"""Maximum ages, s: at least three of the driver's periods. Older values count as unknown."""


class RequestError(RuntimeError):
    """A request was not carried out, with the reason and the remedy as text.

    Any other exception ends the panel.
    """


class Tri(Enum):
    """A yes/no that may be unknown."""

    UNKNOWN = -1
    NO = 0
    YES = 1


@dataclass(frozen=True)
class Status:
    """A robot_status. `mode`: 'AUTO', 'MANUAL' or ''."""

    e_stopped: Tri = Tri.UNKNOWN
    motors_on: Tri = Tri.UNKNOWN
    motion_possible: Tri = Tri.UNKNOWN
    in_motion: Tri = Tri.UNKNOWN
    in_error: Tri = Tri.UNKNOWN
    mode: str = ''
    error_codes: tuple[int, ...] = ()


@dataclass(frozen=True)
class Simulation:
    """The state reported by a simulated controller: condition by region, and active faults."""

    condition: Mapping[str, str]
    faults: tuple[str, ...] = ()


@dataclass(frozen=True)
class IoRange:
    """Points of one type of epson_msgs/IoPoint that follow one another."""

    type: int
    start: int
    values: tuple[int, ...]


@dataclass(frozen=True)
class Event:
    """A log line with rcl_interfaces/Log's level. `at`: s since the epoch."""

    at: float
    level: int
    text: str


@dataclass(eq=False)
class RobotState:
    """The latest value of each report. `times`: arrival by the panel's clock, s, by name.

    Joints in the order of `joint_names`: shape (n,), rad or m. `inhibit`: the driver's reason why
    the arm cannot move.
    """

    joint_names: tuple[str, ...] = ()
    positions: Array = field(default_factory=lambda: np.zeros(0))
    fastest: Sequence[float] = ()
    """Velocity limits of the joints, rad/s or m/s, once the model is known."""
    no_joints: str = ''
    """The reason why the driver's joint positions are not used. Empty: they are used."""
    measured: float = 0.0
    """Time stamp of the joints by the driver's clock, s."""
    status: Status = field(default_factory=Status)
    link: str = ''
    gate_open: bool | None = None
    inhibit: Inhibit | None = None
    goal_running: bool = False
    reference: Array | None = None
    tracking_error: Array | None = None
    speed: float | None = None
    io: tuple[IoRange, ...] = ()
    io_reason: str = 'nothing was reported yet'
    simulation: Simulation | None = None
    taught: Mapping[str, Array] = field(default_factory=dict)
    """Points by name: x y z, m, in base_link, and a quaternion x y z w, shape (7,)."""
    events: deque[Event] = field(default_factory=lambda: deque(maxlen=MAX_EVENTS))
    times: dict[str, float] = field(default_factory=dict)

    def add_event(self, event: Event) -> None:
        """Add a log line, unless the driver or the panel has just logged the same text."""
        news = event.text.removeprefix('~/')
        for other in list(self.events)[-MAX_COMPARED:]:
            if abs(other.at - event.at) < SAME_NEWS_S and other.text.removeprefix('~/') == news:
                return
        self.events.append(event)

    def age(self, name: str, now: float) -> float | None:
        """Return the age of a value, s, or None before the first one."""
        at = self.times.get(name)
        return None if at is None else now - at

    def fresh(self, name: str, now: float) -> bool:
        """Return whether a value is recent enough to be trusted."""
        age = self.age(name, now)
        return age is not None and age <= MAX_AGES_S[name]
