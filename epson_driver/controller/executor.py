# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What the motion program and the arm agree on: points in, motion out.

Two keep to it. `PointToPoint` rests at every point and only then has it answered, as SPEL+'s `Go`
in the thesis' program. `Streaming` takes points ahead of the arm and goes through them smoothly.
"""

from dataclasses import dataclass
from typing import Protocol

from epson_driver.motion import Array, JointLimits


@dataclass(frozen=True, slots=True, eq=False)
class Point:
    """An accepted point.

    `target` has shape (n,), rad, within the limits; `velocity` is a fraction (0, 1] of the
    joints' speed, `duration` the time from the point before, s; 0 means that none is given.
    """

    sequence: int
    target: Array
    velocity: float
    duration: float


class Executor(Protocol):
    """An arm that goes to the points it takes. Time is passed in with `step`."""

    @property
    def limits(self) -> JointLimits:
        """What the arm never exceeds."""

    @property
    def position(self) -> Array:
        """The commanded joint angles now, shape (n,), rad."""

    @property
    def moving(self) -> bool:
        """Whether the arm moves or has points to go to."""

    @property
    def has_room(self) -> bool:
        """Whether it takes another point now."""

    @property
    def done(self) -> bool:
        """Whether the point taken last may be answered."""

    def take(self, point: Point) -> None:
        """Go to a point, after those taken before; only while there is room."""

    def stop(self) -> bool:
        """Forget all points and brake. Return whether points that were answered are forgotten."""

    def step(self, dt: float) -> float | None:
        """Let `dt` ≥ 0 s pass; return how much of it is left for the next point, s, or None."""
