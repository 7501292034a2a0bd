# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Moves that overlap in time, like SPEL+'s `Go … CP` and the parts of `Jump` and `Jump3`.

With CP, a move starts while the previous one still decelerates, and the two are added. Both
consist of pieces of constant jerk, and so does their sum. Therefore its extrema are known, and it
is checked exactly against the limits.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from epson_driver.motion.limits import Array, JointLimits
from epson_driver.motion.point_to_point import LineMotion, Pieces
from epson_driver.tool_motion.curve_motion import CurveMotion


class Part(NamedTuple):
    """A move that starts at the time `start`, s, at the position `origin`, shape (n,), rad."""

    start: float
    origin: Array
    move: 'LineMotion | CurveMotion | JointMoves'

    @property
    def end(self) -> float:
        return self.start + self.move.duration


class JointMoves:
    """The sum of moves that overlap in time, as a function of the time.

    Each move is planned within a part of the joint limits. The sum respects the limits, even
    during a stop, if these parts add up to no more than the limits.
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
        """Time at which the last part starts to decelerate, s."""
        last = self._parts[-1]
        return last.start + last.move.braking

    def at(self, time: float) -> tuple[Array, Array, Array]:
        """Return position, velocity, acceleration of each joint at `time` ≥ 0, shapes (n,)."""
        position = self.origin.copy()
        velocity, acceleration = np.zeros_like(position), np.zeros_like(position)
        for part in self._parts:
            if part.start <= time:
                p, v, a = part.move.at(time - part.start)
                position += p - part.origin
                velocity, acceleration = velocity + v, acceleration + a
        return position, velocity, acceleration

    def stop(self, time: float) -> 'JointMoves':
        """Return a stop. Each part that has started stops as fast as possible on its path."""
        stops = (
            Part(0.0, part.origin, part.move.stop(time - part.start))
            for part in self._parts
            if part.start <= time
        )
        return JointMoves(self.origin, list(stops))


CANDIDATE_STARTS = 24  # starts per round. The earliest allowed start is refined once
LIMIT_TOLERANCE_SHARE = 1e-9  # relative excess over a limit that rounding may cause
POSITION_TOLERANCE = 1e-12  # excess over a limit that rounding may cause, rad


def blend_start(
    first: LineMotion,
    second: LineMotion,
    limits: JointLimits,
    earliest: float,
    *,
    speed: float = 1.0,
    accel: float = 1.0,
    tool: tuple[Array, float] | None = None,
) -> float:
    """Return the earliest allowed start time of a second move, s after the start of the first.

    The second move starts at the position where the first ends, at the time `earliest` or later.
    Their sum respects the limits, multiplied by the fractions `speed` and `accel`. `tool`: each
    joint's reach, shape (n,), m, and the maximum tool speed, m/s. The tool speed is the sum of
    each joint's speed multiplied by its reach.
    """
    result = first.duration
    if not earliest < result or first.braking == 0.0 or second.braking == 0.0:
        return result
    check = _Check(first, second, limits, speed, accel, tool)
    starts = np.linspace(earliest, result, CANDIDATE_STARTS, endpoint=False)
    for _ in range(2):
        allowed = check(starts)
        if not allowed.any():
            break
        index = int(np.argmax(allowed))
        result = float(starts[index])
        if index == 0:
            break
        starts = np.linspace(starts[index - 1], result, CANDIDATE_STARTS, endpoint=False)[1:]
    return result


class _Check:
    """Checks the sum of two moves against the limits, for many start times of the second move.

    The tool speed is checked like the speed of an additional joint.
    """

    def __init__(
        self,
        first: LineMotion,
        second: LineMotion,
        limits: JointLimits,
        speed: float,
        accel: float,
        tool: tuple[Array, float] | None,
    ) -> None:
        self._first, self._second = first.pieces, second.pieces
        self._end = first.duration
        rows = [
            first.direction,
            second.direction,
            first.origin,
            limits.position_min - POSITION_TOLERANCE,
            limits.position_max + POSITION_TOLERANCE,
            limits.velocity * speed,
            limits.acceleration * accel,
            limits.jerk * accel,
        ]
        if tool is not None:
            reach, fastest = tool
            of_tool: list[float] = [
                float(np.abs(first.direction) @ reach),
                float(np.abs(second.direction) @ reach),
                0.0,
                -np.inf,
                np.inf,
                fastest,
                np.inf,
                np.inf,
            ]
            rows = [np.array([*row, extra]) for row, extra in zip(rows, of_tool, strict=True)]
        self._along, self._onward, self._origin, self._low, self._high, *bounds = rows
        self._velocity, self._acceleration, self._jerk = (
            bound * (1.0 + LIMIT_TOLERANCE_SHARE) for bound in bounds
        )

    def __call__(self, starts: Array) -> Array:
        """Return whether the sum respects the limits while both moves last, for each start time.

        `starts` and the result have the shape (m,).
        """
        start = starts[:, None]
        times = np.concatenate(
            [np.broadcast_to(self._first.times, (len(starts), 8)), self._second.times + start],
            axis=1,
        )
        times = np.sort(np.clip(times, start, self._end), axis=1)
        since, until = times[:, :-1], times[:, 1:]
        middle = (since + until) / 2.0
        states = zip(
            _states(self._first, since, middle),
            _states(self._second, since - start, middle - start),
            strict=True,
        )
        p, v, a, j = (
            one[:, :, None] * self._along + other[:, :, None] * self._onward
            for one, other in states
        )
        p = p + self._origin
        h = (until - since)[:, :, None]
        with np.errstate(divide='ignore', invalid='ignore'):
            turn = _inside(-a / j, h)
            # both zeros of v + a t + j t² / 2
            q = -(a + np.copysign(np.sqrt(np.maximum(a * a - 2.0 * j * v, 0.0)), a))
            zeros = (_inside(q / j, h), _inside(2.0 * v / q, h))
        fits = (np.abs(j) <= self._jerk) | (h == 0.0)
        for t in (0.0, h):
            fits &= np.abs(a + j * t) <= self._acceleration
        for t in (0.0, h, turn):
            fits &= np.abs(v + t * (a + j * t / 2.0)) <= self._velocity
        for t in (0.0, h, *zeros):
            position = p + t * (v + t * (a / 2.0 + j * t / 6.0))
            fits &= (position >= self._low) & (position <= self._high)
        allowed: Array = fits.all(axis=(1, 2))
        return allowed


def _states(pieces: Pieces, times: Array, middle: Array) -> tuple[Array, Array, Array, Array]:
    """Return distance, velocity, acceleration and jerk at `times`.

    `middle`: a time inside the same piece of the move, for each of the times.
    """
    piece = np.clip(np.searchsorted(pieces.times, middle, side='right') - 1, 0, 7)
    t = times - pieces.times[piece]
    s, v, a, j = (
        column[piece]
        for column in (pieces.distances, pieces.velocities, pieces.accelerations, pieces.jerks)
    )
    return (
        s + t * (v + t * (a / 2.0 + j * t / 6.0)),
        v + t * (a + j * t / 2.0),
        a + j * t,
        j,
    )


def _inside(times: Array, length: Array) -> Array:
    inside: Array = np.clip(np.nan_to_num(times, nan=0.0), 0.0, length)
    return inside
