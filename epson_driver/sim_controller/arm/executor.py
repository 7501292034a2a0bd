# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The interface between motion program and arm: points in, motion out.

There are two executors. `PointToPoint` goes from point to point, as SPEL+'s `Go`. `Streaming`
takes points ahead of the arm and goes through them smoothly.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from epson_driver.motion import Array, JointLimits, LineMotion
from epson_driver.motion.joint_moves import JointMoves
from epson_driver.tool_motion.curve_motion import CurveMotion

Motion = LineMotion | CurveMotion | JointMoves
"""From rest to rest."""

PathMotion = Callable[[Array, bool], Motion]
"""Returns the motion from where the arm rests, shape (n,), rad, to a target; at low power or not.

It keeps to the arm's limits, and must not raise.
"""


@dataclass(frozen=True, slots=True, eq=False)
class Point:
    """An accepted point.

    `target` has shape (n,), rad, within the limits; `velocity` is a fraction (0, 1] of the
    joints' speed, `duration` the time from the point before, s; 0 means that none is given. `cp`:
    whether the motion may blend into the next one; None: as the executor does it with all. `path`:
    how it goes there, if that is not straight in joint space; then it never blends.
    """

    sequence: int
    target: Array
    velocity: float
    duration: float
    cp: bool | None = None
    path: PathMotion | None = None


class Executor(Protocol):
    """An arm that goes to the points it takes. Time is passed in with `step`."""

    low_power: bool
    """Whether the next motion that begins at rest keeps to the low-power caps."""

    speed: float
    """SPEL+ Speed: a fraction (0, 1] of the joints' speed, from the next statement on."""

    accel: float
    """SPEL+ Accel: a fraction (0, 1] of the acceleration, from the next statement on."""

    @property
    def begun(self) -> int:
        """How many points it has begun to go to, since the start."""

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
        """Whether the arm moves or has points to go to, held or not."""

    @property
    def still(self) -> bool:
        """Whether the arm stands, with nothing that would move it: at rest, or held at rest."""

    @property
    def has_room(self) -> bool:
        """Whether it takes another point now."""

    @property
    def done(self) -> bool:
        """Whether the point taken last may be answered."""

    def take(self, point: Point) -> None:
        """Go to a point after those taken before, while there is room."""

    def stop(self) -> bool:
        """Forget all points and brake. Return whether points that were answered are forgotten.

        It ends a hold too.
        """

    def hold(self) -> None:
        """Brake on the path and stay there, keeping the points. Twice is no error."""

    def resume(self) -> None:
        """Go on after `hold`, to the same points."""

    def settle(self, position: Array) -> None:
        """Stand at another position, shape (n,), rad: the arm was moved while it had no power.

        Only while it stands and has no points. Raises RuntimeError otherwise.
        """

    def step(self, dt: float) -> float | None:
        """Let `dt` ≥ 0 s pass, until a point is done or the arm rests.

        Return how much of it is left for what follows, s: the program gives the next point and
        steps again with that. None: all of it has passed.
        """
