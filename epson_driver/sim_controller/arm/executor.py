# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The interface between motion program and arm: points in, motion out.

There are two executors. `PointToPoint` moves from point to point, like SPEL+'s `Go`. `Streaming`
accepts points ahead of the arm and moves through them smoothly.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from epson_driver.motion import Array, JointLimits, LineMotion
from epson_driver.sim_controller.arm.overlap import JointMoves
from epson_driver.tool_motion.curve_motion import CurveMotion

Motion = LineMotion | CurveMotion | JointMoves
"""A motion from rest to rest."""

PathMotion = Callable[[Array, bool], Motion]
"""Function that returns the motion from rest at a position, shape (n,), rad, to a point.

The second argument selects low power. The motion must respect the arm's limits. The function must
not raise.
"""


@dataclass(frozen=True, slots=True, eq=False)
class Point:
    """An accepted point.

    * `target`: joint positions within the limits, shape (n,), rad.
    * `velocity`: fraction (0, 1] of the joints' speed (0: not specified).
    * `duration`: time from the previous point, s (0: not specified).
    * `cp`: whether the motion may blend into the next one (None: the executor's default).
    * `path`: replaces the straight line in joint space (None). A motion with a path never blends.
    * `setpoint`: whether a stream of setpoints starts with this point.
    """

    sequence: int
    target: Array
    velocity: float
    duration: float
    cp: bool | None = None
    path: PathMotion | None = None
    setpoint: bool = False


class Executor(Protocol):
    """The commanded motion of an arm through points. Time advances with `step`."""

    low_power: bool
    """Whether the next motion that starts from rest respects the low-power caps."""

    speed: float
    """SPEL+ Speed: a fraction (0, 1] of the joints' speed, from the next statement on."""

    accel: float
    """SPEL+ Accel: a fraction (0, 1] of the acceleration, from the next statement on."""

    @property
    def started_points(self) -> int:
        """Number of points whose motion has started since the executor was created."""

    @property
    def limits(self) -> JointLimits:
        """The limits that the arm never exceeds."""

    @property
    def position(self) -> Array:
        """The commanded joint angles now, shape (n,), rad."""

    @property
    def velocity(self) -> Array:
        """The commanded joint velocities now, shape (n,), rad/s."""

    @property
    def moving(self) -> bool:
        """Whether the arm moves or has points to execute, even during a hold."""

    @property
    def at_rest(self) -> bool:
        """Whether the arm is at rest and has no motion to start, for example during a pause."""

    @property
    def has_room(self) -> bool:
        """Whether the arm accepts another point now."""

    @property
    def done(self) -> bool:
        """Whether the last accepted point may be acknowledged."""

    def take(self, point: Point) -> None:
        """Accept a point, to be executed after the earlier ones. Requires `has_room`."""

    def stop(self) -> bool:
        """Discard all points, brake, and end a hold.

        Return whether any of the discarded points had been acknowledged.
        """

    def hold(self) -> None:
        """Brake on the path and stay there, keeping the points. Calling it twice is allowed."""

    def resume(self) -> None:
        """Resume after `hold`, towards the same points."""

    def set_position(self, position: Array) -> None:
        """Set the position, shape (n,), rad, after the arm was moved without power.

        Raises RuntimeError unless the arm is at rest without points.
        """

    def step(self, dt: float) -> float | None:
        """Advance by `dt` ≥ 0 s, or less if a point is done or the arm comes to rest earlier.

        Return the remaining time, s, for which the program supplies the next point and steps
        again. Return None if all of `dt` has elapsed.
        """
