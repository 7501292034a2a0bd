# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A planned trajectory, and its checks before execution."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from math import ceil

import numpy as np
import numpy.typing as npt

from epson_driver.motion.limits import Array, JointLimits

LIMIT_TOLERANCE_SHARE = 1e-6
"""Tolerance for rounding at a limit, as a fraction of the range. It is needed because many plans
use the limits fully."""

MAX_USUAL_ANGLE_RAD = 4 * np.pi
"""Two turns. If an angle exceeds both its limit and this, the positions may be in degrees."""

BLOCK_POINTS = 2048
"""Number of points checked together, so that the memory does not grow with the trajectory."""

MAX_DURATION_S = 86_400.0

MAX_POINTS = 100_000
"""Maximum number of points of a sampled motion. A longer one would take minutes to plan."""

Mask = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.intp]

_PER = {'positions': '', 'velocities': '/s', 'accelerations': '/s²'}


@dataclass(frozen=True, eq=False)
class Trajectory:
    """A trajectory of n points of m joints.

    * times: time of each point from the start, shape (n,), s, ≥ 0 and strictly increasing.
    * positions: joint positions, shape (n, m), rad, or m for prismatic joints.
    * velocities, accelerations: shape (n, m), or None if the trajectory has none.
    """

    joint_names: tuple[str, ...]
    times: Array
    positions: Array
    velocities: Array | None = None
    accelerations: Array | None = None

    @property
    def duration(self) -> float:
        return float(self.times[-1])

    def in_order(self, joint_names: tuple[str, ...]) -> 'Trajectory':
        if joint_names == self.joint_names:
            return self
        columns = [self.joint_names.index(name) for name in joint_names]
        return Trajectory(
            joint_names,
            self.times,
            self.positions[:, columns],
            None if self.velocities is None else self.velocities[:, columns],
            None if self.accelerations is None else self.accelerations[:, columns],
        )


def sample_times(duration: float, period: float) -> Array:
    """Return times at most `period` s apart. Raises ValueError if they exceed MAX_POINTS."""
    longest = MAX_POINTS * period
    if not duration <= longest:
        raise ValueError(
            f'the motion takes {duration:.4g} s: must be at most {longest:g} s ({MAX_POINTS} '
            'points), so raise its speed or period'
        )
    return np.linspace(0.0, duration, ceil(duration / period) + 1)


def with_gaps(times: Array, longest: float) -> tuple[Array, Indices]:
    """Return times at most `longest` s apart, and the indices of the given times among them."""
    parts = np.maximum(np.ceil(np.diff(times) / longest - 1e-9), 1.0)
    own = np.append(0, np.cumsum(parts)).astype(np.intp)
    return np.interp(np.arange(own[-1] + 1), own, times), own


def problems(
    trajectory: Trajectory, limits: JointLimits, *, too_fast: bool = True
) -> Iterator[str]:
    """Yield a sentence for every reason not to execute a trajectory.

    The joints must be in the order of the limits. A sentence names the point (counted from 0), the
    joint, the value and the limit. If positions seem to be in degrees or millimetres, only the
    first of them is reported. `too_fast`: whether to check the mean speed of each segment, too.
    Accelerations must be finite, but are not checked against a limit, because the executed motion
    is smoothed.
    """
    if not len(trajectory.times):
        yield 'the trajectory has no points'
        return
    not_finite = list(_not_finite(trajectory, limits))
    yield from not_finite
    if not_finite:
        return
    low, high = limits.position_min, limits.position_max
    outside = list(_beyond(trajectory.positions, low, high, 'position', '', limits))
    if outside and _like_degrees(trajectory.positions, limits):
        yield f'{outside[0]}; these look like degrees: positions are in rad'
        return
    if outside and _like_millimetres(trajectory.positions, limits):
        yield f'{outside[0]}; these look like millimetres: positions are in m'
        return
    yield from _times(trajectory)
    yield from outside
    if trajectory.velocities is not None:
        yield from _beyond(
            trajectory.velocities, -limits.velocity, limits.velocity, 'velocity', '/s', limits
        )
    if too_fast:
        yield from _too_fast(trajectory, limits)


def _like_degrees(positions: Array, limits: JointLimits) -> bool:
    """Return whether the angles may be degrees.

    This requires that none exceeds a full turn or its limit as degrees, and that one exceeds both
    its limit and 4π rad.
    """
    turning = np.array([unit == 'rad' for unit in limits.units])
    angles = positions[:, turning]
    low, high = limits.position_min[turning], limits.position_max[turning]
    exceeds = (np.abs(angles) > MAX_USUAL_ANGLE_RAD) & ((angles < low) | (angles > high))
    most = np.maximum(np.degrees(high), 360.0)
    return bool(np.any(exceeds) and np.all(np.abs(angles) <= most))


def _like_millimetres(positions: Array, limits: JointLimits) -> bool:
    """Return whether a position of a linear joint is valid only in millimetres."""
    linear = np.array([unit == 'm' for unit in limits.units])
    values, low, high = (
        array[..., linear] for array in (positions, limits.position_min, limits.position_max)
    )
    beyond = (np.abs(values) >= 1.0) & ((values < low) | (values > high))
    return bool(np.any(beyond) and np.all((values >= 1e3 * low) & (values <= 1e3 * high)))


def _is_not_finite(values: Array, some: slice) -> Mask:
    return ~np.isfinite(values[some])


def _not_finite(trajectory: Trajectory, limits: JointLimits) -> Iterator[str]:
    times = trajectory.times[:, None]
    for index, _ in _where(len(times), partial(_is_not_finite, times)):
        yield f'point {index}: time_from_start = {trajectory.times[index]} is not finite'
    for quantity, per in _PER.items():
        values = getattr(trajectory, quantity)
        if values is not None:
            for point, joint in _where(len(values), partial(_is_not_finite, values)):
                name = trajectory.joint_names[joint]
                value = f'{values[point, joint]} {limits.units[joint]}{per}'
                yield f'point {point}, {name}: {quantity} = {value} is not finite'


def _where(count: int, mask: Callable[[slice], Mask]) -> Iterator[tuple[int, int]]:
    """Yield the point and joint index of each True in a mask, which is computed by slices."""
    for first in range(0, count, BLOCK_POINTS):
        result = mask(slice(first, min(first + BLOCK_POINTS, count)))
        if result.any():
            for point, joint in np.argwhere(result):
                yield first + int(point), int(joint)


def _not_after(times: Array) -> Iterator[int]:
    def mask(some: slice) -> Mask:
        following = slice(some.start + 1, some.stop + 1)
        return (times[following] <= times[some])[:, None]

    for index, _ in _where(len(times) - 1, mask):
        yield index + 1


def _times(trajectory: Trajectory) -> Iterator[str]:
    times = trajectory.times
    if times[0] < 0.0:
        yield f'point 0: time_from_start = {times[0]:g} s is negative'
    if times[-1] > MAX_DURATION_S:
        yield (
            f'point {len(times) - 1}: time_from_start = {times[-1]:g} s: must be '
            f'{MAX_DURATION_S:g} s, a day, at most'
        )
    for index in _not_after(times):
        yield (
            f'point {index}: time_from_start = {times[index]:g} s is not after the '
            f'{times[index - 1]:g} s of the point before: times must strictly increase'
        )


def _beyond(
    values: Array, low: Array, high: Array, quantity: str, per: str, limits: JointLimits
) -> Iterator[str]:
    slack = LIMIT_TOLERANCE_SHARE * (high - low)
    low_limit, high_limit = low - slack, high + slack

    def outside(some: slice) -> Mask:
        return (values[some] < low_limit) | (values[some] > high_limit)

    for point, joint in _where(len(values), outside):
        unit = limits.units[joint] + per
        value = f'{values[point, joint]:.6g} {unit}'
        allowed = f'{low[joint]:.6g} … {high[joint]:.6g} {unit}'
        where = f'point {point}, {limits.names[joint]}'
        yield f'{where}: {quantity} {value} is outside the limits {allowed}'


def _too_fast(trajectory: Trajectory, limits: JointLimits) -> Iterator[str]:
    times, positions = trajectory.times, trajectory.positions
    if next(_not_after(times), None) is not None:
        return
    fastest = limits.velocity * (1.0 + LIMIT_TOLERANCE_SHARE)

    def speeds(some: slice) -> Array:
        some = slice(some.start, some.stop + 1)
        return np.abs(np.diff(positions[some], axis=0)) / np.diff(times[some])[:, None]

    for segment, joint in _where(len(times) - 1, lambda some: speeds(some) > fastest):
        speed = speeds(slice(segment, segment + 1))[0, joint]
        yield (
            f'points {segment} to {segment + 1}, {limits.names[joint]}: '
            f'{speed:.6g} {limits.units[joint]}/s would be needed, '
            f'the velocity limit is {limits.velocity[joint]:.6g} {limits.units[joint]}/s'
        )
