# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Moves of different joints that overlap in time, as the parts of SPEL+'s `Jump` do."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from epson_driver.motion.limits import Array
from epson_driver.motion.point_to_point import LineMotion


class Part(NamedTuple):
    """A move since `begin`, s, from `origin`, shape (n,), rad."""

    begin: float
    origin: Array
    move: LineMotion

    @property
    def end(self) -> float:
        """When it ends, s."""
        return self.begin + self.move.duration


class JointMoves:
    """Moves in parts as a function of the time since the first began: as LineMotion is.

    No joint may move in two parts at a time, so each part within the limits keeps them all.
    """

    def __init__(self, origin: Array, parts: Sequence[Part]) -> None:
        self.origin = origin
        self._parts = tuple(parts)
        self.duration = max((part.end for part in self._parts), default=0.0)
        self.end: Array = origin + sum(
            (part.move.end - part.origin for part in self._parts), np.zeros_like(origin)
        )

    @property
    def braking(self) -> float:
        """When the deceleration of the last part begins, s."""
        last = self._parts[-1]
        return last.begin + last.move.braking

    def at(self, time: float) -> tuple[Array, Array, Array]:
        """Return position, velocity, acceleration of each joint at `time` ≥ 0, shapes (n,)."""
        position = self.origin.copy()
        velocity, acceleration = np.zeros_like(position), np.zeros_like(position)
        for part in self._parts:
            if part.begin <= time:
                p, v, a = part.move.at(time - part.begin)
                position += p - part.origin
                velocity, acceleration = velocity + v, acceleration + a
        return position, velocity, acceleration

    def stop(self, time: float) -> 'JointMoves':
        """Return the fastest stop of each part that has begun, along its line."""
        stops = (
            Part(0.0, part.origin, part.move.stop(time - part.begin))
            for part in self._parts
            if part.begin <= time
        )
        return JointMoves(self.origin, list(stops))


def time_at(move: LineMotion, joint: int, distance: float) -> float:
    """Return when a joint has gone a distance (rad, m), s: the whole move where it goes less."""
    early, late = 0.0, move.duration
    for _ in range(50):
        middle = 0.5 * (early + late)
        if abs(move.at(middle)[0][joint] - move.origin[joint]) < distance:
            early = middle
        else:
            late = middle
    return late
