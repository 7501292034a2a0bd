# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Moves that overlap in time, like the parts of SPEL+'s `Jump` and `Jump3`."""

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np

from epson_driver.motion.limits import Array


class Move(Protocol):
    """A motion from rest to rest, as a function of the time since its start."""

    origin: Array
    end: Array
    duration: float

    @property
    def braking(self) -> float:
        """Start time of the deceleration of a motion from rest to rest, s."""

    def at(self, time: float) -> tuple[Array, Array, Array]:
        """Return position, velocity, acceleration of each joint at `time` ≥ 0, shapes (n,)."""

    def stop(self, time: float) -> 'Move':
        """Return the fastest stop along its path from the state at `time`."""


class Part(NamedTuple):
    """A move that starts at `begin`, s, from `origin`, shape (n,), rad."""

    begin: float
    origin: Array
    move: Move

    @property
    def end(self) -> float:
        """End time, s."""
        return self.begin + self.move.duration


class JointMoves:
    """Moves in parts as a function of the time since the first started, like LineMotion.

    Overlapping parts share each joint's limits, so their sum respects all limits, also during a
    stop.
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
        """Start time of the deceleration of the last part, s."""
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
        """Return the fastest stop of each part that has started, along its line."""
        stops = (
            Part(0.0, part.origin, part.move.stop(time - part.begin))
            for part in self._parts
            if part.begin <= time
        )
        return JointMoves(self.origin, list(stops))
