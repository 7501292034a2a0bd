# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The fastest motion from rest to rest along a path with different limits for each part.

Speed, acceleration and jerk are limited in each part. The acceleration is 0 at the seam between
two parts. The speeds at the seams are as high as the parts before and after them allow.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from epson_driver.motion import Array, JointLimits
from epson_driver.motion.interpolation import after
from epson_driver.motion.time_parametrisation import TimeParametrisation

HALVINGS = 60
"""Number of bisection steps, which is enough for full precision."""

END_TOLERANCE = 1e-9
"""Last fraction of the path that counts as its end, because the times in it are inaccurate."""


@dataclass(frozen=True, slots=True)
class PartLimits:
    """Length of a part of a path, in any unit, and its limits, in this unit per s, s² and s³."""

    length: float
    speed: float
    acceleration: float
    jerk: float


def fraction_of_limits(
    limits: JointLimits,
    derivatives: tuple[Array, Array, Array],
    speed: Array | float,
    acceleration: Array | float,
    jerk: Array | float,
) -> Array:
    """Return the largest fraction f ≤ 1 with which a motion respects every joint limit, shape (…).

    The motion has speed · f, acceleration · f² and jerk · f³ along a path, all at the same time.
    derivatives: magnitudes of the first three derivatives of the joint positions with respect to
    the distance, shapes (…, n).
    """
    first, second, third = derivatives
    with np.errstate(divide='ignore'):
        fractions = (
            limits.velocity / (first * speed),
            np.sqrt(limits.acceleration / (second * speed**2 + first * acceleration)),
            np.cbrt(
                limits.jerk
                / (third * speed**3 + 3.0 * second * speed * acceleration + first * jerk)
            ),
        )
    return np.asarray(
        np.min([np.min(fraction, axis=-1) for fraction in fractions], axis=0).clip(max=1.0)
    )


def when(motion: TimeParametrisation, distances: Array) -> Array:
    """Return the times at which a motion reaches distances, shape (m,), s."""
    early, late = np.zeros(len(distances)), np.full(len(distances), motion.duration)
    for _ in range(HALVINGS):
        middle = (early + late) / 2.0
        before = motion.sample(middle)[0] < distances
        early, late = np.where(before, middle, early), np.where(before, late, middle)
    return np.where(distances >= motion.end * (1.0 - END_TOLERANCE), motion.duration, late)


def fastest(parts: Sequence[PartLimits]) -> TimeParametrisation:
    """Return the fastest motion along all parts, from rest to rest."""
    speeds = _seam_speeds(parts)
    columns: list[tuple[float, float, float, float, float]] = []
    time = distance = 0.0
    for part, (first, last) in zip(parts, pairwise(speeds), strict=True):
        end = distance + part.length
        speed, acceleration = first, 0.0
        for duration, jerk in _pieces(part, first, last):
            columns.append((time, distance, speed, acceleration, jerk))
            distance, speed, acceleration = after(duration, distance, speed, acceleration, jerk)
            time += duration
        distance = end  # removes the rounding of the pieces
    columns.append((time, distance, 0.0, 0.0, 0.0))
    times, distances, rates, accelerations, jerks = np.array(columns).T
    return TimeParametrisation(times, distances, rates, accelerations, jerks[:-1])


def _seam_speeds(parts: Sequence[PartLimits]) -> list[float]:
    """Return the highest possible speeds at the start, at each seam, and at the end."""
    speeds = [0.0, *(min(a.speed, b.speed) for a, b in pairwise(parts)), 0.0]
    for index, part in enumerate(parts):
        speeds[index + 1] = min(speeds[index + 1], _max_end_speed(part, speeds[index]))
    for index, part in reversed(list(enumerate(parts))):
        speeds[index] = min(speeds[index], _max_end_speed(part, speeds[index + 1]))
    return speeds


def _max_end_speed(part: PartLimits, first: float) -> float:
    if first >= part.speed:
        return part.speed
    return highest(lambda last: _ramp_length(part, first, last) <= part.length, first, part.speed)


def highest(fits: Callable[[float], bool], low: float, high: float) -> float:
    """Return the highest number in [`low`, `high`] for which `fits` is true, by bisection."""
    if fits(high):
        return high
    for _ in range(HALVINGS):
        middle = (low + high) / 2.0
        low, high = (middle, high) if fits(middle) else (low, middle)
    return low


def _pieces(part: PartLimits, first: float, last: float) -> Iterator[tuple[float, float]]:
    """Yield the duration and jerk of each piece of the fastest motion between two speeds."""

    def ramps(top: float) -> float:
        return _ramp_length(part, first, top) + _ramp_length(part, top, last)

    top = highest(lambda speed: ramps(speed) <= part.length, max(first, last), part.speed)
    yield from _ramp(part, first, top)
    remaining = part.length - ramps(top)
    if remaining > 0.0:
        yield remaining / top, 0.0
    yield from _ramp(part, top, last)


def _ramp(part: PartLimits, first: float, last: float) -> Iterator[tuple[float, float]]:
    """Yield the duration and jerk of each piece of a change of speed.

    The acceleration is 0 at the start and at the end of the change.
    """
    change = abs(last - first)
    if change == 0.0:
        return
    jerk = part.jerk if last > first else -part.jerk
    full = part.acceleration**2 / part.jerk  # a larger change of speed reaches the acceleration
    rise = part.acceleration / part.jerk if change >= full else float(np.sqrt(change / part.jerk))
    yield rise, jerk
    if change > full:
        yield change / part.acceleration - rise, 0.0
    yield rise, -jerk


def _ramp_length(part: PartLimits, first: float, last: float) -> float:
    return (first + last) / 2.0 * sum(duration for duration, _ in _ramp(part, first, last))
