# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""State of arm and controller at one time, including a text for users."""

from dataclasses import dataclass

from epson_driver.motion import Array


@dataclass(frozen=True, slots=True)
class ControllerError:
    """An error of the controller: number, meaning and remedy ('' if unknown)."""

    number: int
    text: str
    remedy: str


@dataclass(frozen=True, slots=True)
class RobotStatus:
    """Current state of arm and controller.

    A field is None if the controller does not report it, or the link is down. connected: both
    links are up. enabled: motions are accepted. paused: the controller denies motion for a while,
    or the speed scaling is 0. text: the state as a clause. remedy: the action needed before the
    arm can move, or ''.
    """

    connected: bool
    enabled: bool
    moving: bool | None
    paused: bool
    e_stopped: bool | None
    motors_on: bool | None
    motion_possible: bool | None
    mode: str | None
    error: ControllerError | None
    text: str
    remedy: str


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """Joints measured at one time, and the robot's state at that time.

    positions, velocities: shape (n,), rad and rad/s (m, m/s). time: of the measurement, s since
    1970, like `time.time()`.
    """

    positions: Array
    velocities: Array
    time: float
    status: RobotStatus
