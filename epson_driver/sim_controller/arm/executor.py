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

Motion = LineMotion | CurveMotion | JointMoves  # a motion from rest to rest

PathMotion = Callable[[Array, bool], Motion]
"""Function that returns a motion from rest. It respects the limits and must not raise.

Its arguments are the start position, shape (n,), rad, and whether the power is low.
"""


@dataclass(frozen=True, slots=True, eq=False)
class Point:
    """An accepted point.

    * `target`: joint positions within the limits, shape (n,), rad.
    * `velocity`: fraction (0, 1] of the joints' speed (0: not specified).
    * `duration`: time from the previous point, s (0: not specified).
    * `cp`: whether this motion may blend into the next motion (None: the executor's default).
    * `path`: the path to the target (None: a straight line in joint space). A motion with a path
    never blends.
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
    def limits(self) -> JointLimits: ...

    @property
    def position(self) -> Array:
        """The commanded joint angles now, shape (n,), rad."""

    @property
    def velocity(self) -> Array:
        """The commanded joint velocities now, shape (n,), rad/s."""

    @property
    def moving(self) -> bool:
        """Whether the arm moves or still has points to execute, even if it is on hold."""

    @property
    def at_rest(self) -> bool:
        """Whether the arm is at rest and no motion is about to start.

        This includes an arm that is paused before its next motion.
        """

    @property
    def has_room(self) -> bool:
        """Whether the arm accepts another point now."""

    @property
    def done(self) -> bool:
        """Whether the last accepted point may be acknowledged."""

    def take(self, point: Point) -> None:
        """Accept a point, which is executed after the earlier points. Requires `has_room`."""

    def stop(self) -> bool:
        """Discard all points and brake. Return whether acknowledged points are discarded."""

    def hold(self) -> None:
        """Brake on the path and stay there, and keep the points. Repeated calls are allowed."""

    def resume(self) -> None: ...

    def set_position(self, position: Array) -> None:
        """Set the joint positions, shape (n,), rad.

        Raises RuntimeError if the arm has points to execute.
        """

    def step(self, dt: float) -> float | None:
        """Advance by `dt` ≥ 0 s, or less if a point is completed or the arm comes to rest earlier.

        Return None if all of `dt` has elapsed. Otherwise return the remaining time, s: the program
        then supplies its next point and calls `step` again with the remaining time.
        """
