# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The state of a robot's driver, and the interface for requests to it.

`ros_panel.py` implements the interface with ROS, `api_robot.py` with the driver in this process.
"""

import threading
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Any, Protocol

import numpy as np

from epson_driver.driver.inhibit import Inhibit
from epson_driver.motion import Array, Trajectory

INFO, WARN, ERROR = 20, 30, 40  # log levels of rcl_interfaces/Log
MAX_EVENTS = 200  # maximum number of log lines stored for a robot
SAME_EVENT_S, MAX_COMPARED = 2.0, 5
"""Maximum age, s, and number of previous log lines with which a new line is compared. If one of
the last MAX_COMPARED lines has the same text and is at most SAME_EVENT_S s older, the new line is
dropped. The driver often also logs the answer to a request of the panel."""

MAX_AGES_S = {'joints': 1.0, 'status': 2.5, 'diagnostics': 3.5, 'simulation': 3.0}
"""Age above which a value counts as unknown, s, by name of the value. A working driver sends each
value three times within this age."""


TRIGGERS = ('stop', 'enable', 'disable', 'reset_error')
MAX_TAUGHT_POINTS = 200  # maximum number of points shown


class RequestError(RuntimeError):
    """Raised if a request is refused. The text contains the reason and the remedy for the user.

    Any other exception in a request ends the panel.
    """


class Tri(Enum):
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
    """The report of a simulated controller.

    `condition` contains items such as {'estop': 'not active'}. `joints`: positions in displayed
    units while a program runs, else ().
    """

    condition: Mapping[str, str]
    faults: tuple[str, ...] = ()
    joints: tuple[float, ...] = ()


@dataclass(frozen=True)
class IoRange:
    """Consecutive I/O points of one type of epson_msgs/IoPoint."""

    type: int
    start: int
    values: tuple[int, ...]


@dataclass(frozen=True)
class Event:
    """A log line at `time`, s since 1970. `level`: a constant of rcl_interfaces/Log."""

    time: float
    level: int
    text: str


@dataclass(eq=False)
class RobotState:
    """The latest values that a driver has reported.

    Arrays of joints have the order of `joint_names`, shape (n,), rad or m.

    * inhibit: the driver's reason why the arm cannot move, or None.
    * times: name of a value → time of its arrival, s on the panel's clock.
    """

    joint_names: tuple[str, ...] = ()
    positions: Array = field(default_factory=lambda: np.zeros(0))
    fastest: Sequence[float] = ()  # velocity limits, rad/s or m/s, if known
    no_joints: str = ''  # why the driver's joint positions are not used, or ''
    measured: float = 0.0  # time stamp of the joints by the driver's clock, s
    status: Status = field(default_factory=Status)
    link: str = ''
    gate_open: bool | None = None
    inhibit: Inhibit | None = None
    goal_running: bool = False
    no_plans: str = ''  # why the controller takes only single points, or ''
    no_streams: str = ''  # why the controller cannot be jogged, or ''
    reference: Array | None = None
    tracking_error: Array | None = None
    speed: float | None = None
    io: tuple[IoRange, ...] = ()
    io_reason: str = 'nothing reported yet'
    simulation: Simulation | None = None
    taught: Mapping[str, Array] = field(default_factory=dict)
    """The driver's taught points: name → x, y, z, m, in base_link, and a quaternion x, y, z, w."""
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
        """Return the age of a value in `times`, s, or None if no value has arrived yet."""
        time = self.times.get(name)
        return None if time is None else now - time

    def fresh(self, name: str, now: float) -> bool:
        age = self.age(name, now)
        return age is not None and age <= MAX_AGES_S[name]

    def joints_missing(self, now: float) -> bool:
        """Return whether joints are stale that the controller should report now.

        `times['joints withheld']` is the last time when the controller could not report them.
        """
        ages = (self.age('joints', now), self.age('joints withheld', now))
        return all(age is None or age > MAX_AGES_S['joints'] for age in ages)


Say = Callable[[str, int], object]  # outcome: a sentence, and its log level


class Goal(Protocol):
    """A motion requested by the panel. `ended` is set when it has ended."""

    ended: threading.Event


class Robot(Protocol):
    """A driver, as the panel uses it. Requests do not block, and are executed in order.

    They raise RequestError if the driver does not offer the service. Otherwise they call `say`
    with the outcome. `jog` and `cancel_goals` raise nothing.
    """

    state: RobotState
    parameters: dict[str, Any]
    """The driver's parameters robot_model, robot_ip and remote_port, or {} if unknown."""

    @property
    def name(self) -> str: ...
    @property
    def goals(self) -> Sequence[object]: ...
    def log(self, text: str, level: int) -> None: ...
    def trigger(self, name: str, say: Say) -> None:
        """Request one of the driver's services in TRIGGERS."""

    def set_speed(self, factor: float, say: Say) -> None: ...
    def write_output(self, index: int, value: int, say: Say) -> None: ...
    def jog(self, names: Sequence[str], velocities: Array) -> None: ...
    def execute(self, trajectory: Trajectory, text: str, say: Say) -> None: ...
    def cancel_goals(self) -> Sequence[object]: ...


class LabelledRobot(Robot, Protocol):
    """A robot of a page, with the name `label` there."""

    @property
    def label(self) -> str: ...
    def cancel_goals(self) -> Sequence[Goal]: ...


class Robots(Protocol):
    """The robots of a panel. They are read in the thread of `Panel.run`.

    `now`: the panel's clock, s.
    """

    @property
    def robots(self) -> Mapping[str, LabelledRobot]: ...
    def sample(self, now: float) -> None:
        """Update the states of the robots."""

    def discover(self, now: float) -> None:
        """Update `robots`, and the values in their states that seldom change."""

    def close(self) -> None: ...
