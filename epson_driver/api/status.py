# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The state of arm and controller at one moment, in words as well."""

from dataclasses import dataclass

from epson_driver.motion import Array


@dataclass(frozen=True, slots=True)
class ControllerError:
    """An error of the controller: its number, what it means, and what helps ('' if not known)."""

    number: int
    text: str
    remedy: str


@dataclass(frozen=True, slots=True)
class RobotStatus:
    """What is known now, or None where the controller does not tell, or the link is down.

    connected: both links are up. enabled: motions are taken. paused: the controller denies motion
    for a while, or the speed scaling is 0. text: the state as a clause. remedy: what to do before
    the arm can move, or ''.
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
    """Joints as measured at one moment, and the state then.

    positions, velocities: shape (n,), rad and rad/s (m, m/s). time: of the measurement, s since
    1970, as `time.time()`.
    """

    positions: Array
    velocities: Array
    time: float
    status: RobotStatus
