# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The state and the requests of a robot's driver, as the panel needs them."""

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Any, Protocol

import numpy as np

from epson_driver.driver.inhibit import Inhibit
from epson_driver.motion import Array, Trajectory

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
    io_reason: str = 'nothing reported yet'
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


Say = Callable[[str, int], object]
"""Callback for the outcome of a request: a sentence and its log level."""


class Robot(Protocol):
    """A driver: its reported state and the requests to it, over ROS or simulated.

    Requests do not block. They raise RequestError if no server is available.
    """

    state: RobotState
    parameters: dict[str, Any]

    @property
    def name(self) -> str:
        """Return the name of the driver's node."""

    @property
    def goals(self) -> Sequence[object]:
        """Return the panel's goals that have not ended."""

    def log(self, text: str, level: int) -> None:
        """Add a line of the panel to the log of the driver."""

    def trigger(self, name: str, say: Say) -> None:
        """Call a service of the driver by name."""

    def set_speed(self, factor: float, say: Say) -> None:
        """Set the speed of trajectories, as a share of the plan."""

    def write_output(self, index: int, value: int, say: Say) -> None:
        """Set a digital output."""

    def jog(self, names: Sequence[str], velocities: Array) -> None:
        """Send velocities of joints, rad/s or m/s."""

    def execute(self, trajectory: Trajectory, text: str, say: Say) -> None:
        """Send a trajectory as a goal."""

    def cancel_goals(self) -> Sequence[object]:
        """Cancel every goal that the panel has sent and return those that have not ended yet."""
