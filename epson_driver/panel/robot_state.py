# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The state of a robot's driver, and the interface for requests to it."""

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
"""Maximum number of log lines stored for a robot."""

SAME_EVENT_S, MAX_COMPARED = 2.0, 5
"""A log line is dropped if one of the last MAX_COMPARED has the same text and is at most
SAME_EVENT_S s older. The driver often logs the answer to a request of the panel, too."""

MAX_AGES_S = {'joints': 1.0, 'status': 2.5, 'diagnostics': 3.5, 'simulation': 3.0}
"""Maximum ages of values, s. Older values count as unknown. Each value should arrive at least
three times in this time."""


class RequestError(RuntimeError):
    """A request is not carried out. The text is the reason and the remedy for the user.

    Any other exception in a request ends the panel.
    """


class Tri(Enum):
    """A flag that may be unknown."""

    UNKNOWN = -1
    NO = 0
    YES = 1


@dataclass(frozen=True)
class Status:
    """The values of a robot_status message. `mode`: 'AUTO', 'MANUAL', or '' if unknown."""

    e_stopped: Tri = Tri.UNKNOWN
    motors_on: Tri = Tri.UNKNOWN
    motion_possible: Tri = Tri.UNKNOWN
    in_motion: Tri = Tri.UNKNOWN
    in_error: Tri = Tri.UNKNOWN
    mode: str = ''
    error_codes: tuple[int, ...] = ()


@dataclass(frozen=True)
class Simulation:
    """The report of a simulated controller. `condition`: such as {'estop': 'not active'}."""

    condition: Mapping[str, str]
    faults: tuple[str, ...] = ()


@dataclass(frozen=True)
class IoRange:
    """Consecutive I/O points of one type of epson_msgs/IoPoint."""

    type: int
    start: int
    values: tuple[int, ...]


@dataclass(frozen=True)
class Event:
    """A log line at `time`, s since 1970. `level`: as in rcl_interfaces/Log."""

    time: float
    level: int
    text: str


@dataclass(eq=False)
class RobotState:
    """The latest values that a driver has reported.

    Arrays of joints have the order of `joint_names`, shape (n,), rad or m.

    * inhibit: the driver's reason why the arm cannot move, or None.
    * times: when each value arrived, by its name, s on the panel's clock.
    """

    joint_names: tuple[str, ...] = ()
    positions: Array = field(default_factory=lambda: np.zeros(0))
    fastest: Sequence[float] = ()
    """Velocity limits of the joints, rad/s or m/s. Empty while the model is unknown."""
    no_joints: str = ''
    """The reason why the driver's joint positions are not used, or '' if they are."""
    measured: float = 0.0
    """Time stamp of the joints by the driver's clock, s."""
    status: Status = field(default_factory=Status)
    link: str = ''
    gate_open: bool | None = None
    inhibit: Inhibit | None = None
    goal_running: bool = False
    no_plans: str = ''
    """Why the controller takes no trajectories of several points, or '' if it does."""
    no_streams: str = ''
    """Why the controller takes no streams, so that it cannot be jogged, or '' if it does."""
    reference: Array | None = None
    tracking_error: Array | None = None
    speed: float | None = None
    io: tuple[IoRange, ...] = ()
    io_reason: str = 'nothing reported yet'
    simulation: Simulation | None = None
    taught: Mapping[str, Array] = field(default_factory=dict)
    """The driver's taught points by name: x y z, m, in base_link, and a quaternion x y z w."""
    events: deque[Event] = field(default_factory=lambda: deque(maxlen=MAX_EVENTS))
    times: dict[str, float] = field(default_factory=dict)

    def add_event(self, event: Event) -> None:
        """Add a log line, unless the driver or the panel has just logged the same text."""
        text = event.text.removeprefix('~/')
        for other in list(self.events)[-MAX_COMPARED:]:
            same = other.text.removeprefix('~/') == text
            if same and abs(other.time - event.time) < SAME_EVENT_S:
                return
        self.events.append(event)

    def age(self, name: str, now: float) -> float | None:
        """Return the age of a value in `times`, s, or None before the first one."""
        time = self.times.get(name)
        return None if time is None else now - time

    def fresh(self, name: str, now: float) -> bool:
        """Return whether a value is younger than its limit in MAX_AGES_S."""
        age = self.age(name, now)
        return age is not None and age <= MAX_AGES_S[name]

    def joints_missing(self, now: float) -> bool:
        """Return whether the joints are stale, although the controller should report them.

        `times['joints withheld']` is the last time when the controller could not report them.
        """
        ages = (self.age('joints', now), self.age('joints withheld', now))
        return all(age is None or age > MAX_AGES_S['joints'] for age in ages)


Say = Callable[[str, int], object]
"""Callback for the outcome of a request: a sentence, and its log level."""


class Robot(Protocol):
    """A driver: its state, and requests to it, which do not block.

    Requests raise RequestError if the driver does not offer the required service.
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
        """Add a line to the log of this robot in the page."""

    def trigger(self, name: str, say: Say) -> None:
        """Call the service `stop`, `enable`, `disable` or `reset_error`."""

    def set_speed(self, factor: float, say: Say) -> None:
        """Set the speed scaling, 0 … 1."""

    def write_output(self, index: int, value: int, say: Say) -> None:
        """Set a digital output."""

    def jog(self, names: Sequence[str], velocities: Array) -> None:
        """Send joint velocities, rad/s or m/s."""

    def execute(self, trajectory: Trajectory, text: str, say: Say) -> None:
        """Send a trajectory as a goal. `text`: its name in the log."""

    def cancel_goals(self) -> Sequence[object]:
        """Cancel all goals of the panel, and return those that have not ended yet."""
