# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Types for the state of arm and controller, with texts for users."""

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

    A field is None if the controller does not report it, or the link is down.

    * connected: whether the motion and the state link are up.
    * enabled: whether motions are allowed.
    * paused: whether the controller has interrupted motion without an error, or the speed scaling
      is 0.
    * mode: 'manual' or 'auto'.
    * text: the state as a clause.
    * remedy: the action needed before the arm can move.
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
    """Measured joints, with the time of the measurement, and the robot's state.

    * positions, velocities: shape (n,), rad and rad/s (m, m/s).
    * time: s since 1970, as returned by `time.time()`.
    """

    positions: Array
    velocities: Array
    time: float
    status: RobotStatus
