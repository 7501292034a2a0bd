# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Times a path with known joint positions, and converts it to trajectory points.

Each part of the path has limits, e.g. the limits of the tool. The joint limits are checked along
the whole path. If a joint would exceed a limit, usually near a singularity, the motion is refused,
or slowed down at this place if requested.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from epson_driver.motion import Array, Trajectory
from epson_driver.motion.time_parametrisation import TimeParametrisation
from epson_driver.motion.trajectory import MAX_POINTS, sample_times
from epson_driver.tool_motion.joint_path import JointPath, PathError
from epson_driver.tool_motion.pose_path import distance_from
from epson_driver.tool_motion.speed_profile import (
    PartLimits,
    fastest,
    fraction_of_limits,
    when,
)

PERIOD_S = 0.05
"""Maximum time between two points."""
MIN_PERIOD_S = 0.01

REST_S = 0.2
"""Duration of the rest between two runs. A controller with smooth motion rests at a point that is
repeated after this time. Without a rest it may round the corner."""

MAX_STRETCH = 100.0
"""Maximum slowdown anywhere on a path. If more is needed, the path is refused."""

LEVELS = (1, 2, 3, 5, 8)
"""Numbers of speed levels with which a path is tried. The lowest level is the speed at the slowest
point. With more levels, more speeds are near their limit, but each is held over less distance."""


@dataclass(frozen=True, eq=False)
class TimedRun:
    """Points of a motion from rest to rest. ends: end time of each segment, shape (m,), s."""

    times: Array
    positions: Array
    velocities: Array
    ends: Array

    def stretched(self, factor: float) -> 'TimedRun':
        return TimedRun(
            self.times * factor, self.positions, self.velocities / factor, self.ends * factor
        )


def timed(
    path: JointPath,
    parts: Sequence[PartLimits],
    ends: Array,
    *,
    accuracy: float,
    slow: bool,
) -> TimedRun:
    """Return the fastest motion along a path within the limits of its parts and of the joints.

    ends: distances at which the segments end. accuracy: maximum distance of the tool from the
    path, m, while the joints move straight between two points. slow: whether to slow down where a
    joint limit requires it. Raises PathError if no motion is possible.
    """
    for motion, stretch in _motions(path, parts, slow=slow):
        period = PERIOD_S
        while period >= MIN_PERIOD_S:
            times, positions, velocities = _sampled(path, motion, stretch, period)
            deviation = _deviation(path, positions)
            if deviation <= accuracy:
                return TimedRun(times, positions, velocities, when(motion, ends) * stretch)
            period /= 2.0
    raise PathError(
        f'points {period * 2.0:.3g} s apart leave the path by {deviation * 1e3:.3g} mm between '
        f'them: the required accuracy is {accuracy * 1e3:.3g} mm. Reduce the speed'
    )


def joined(names: tuple[str, ...], runs: Sequence[TimedRun]) -> tuple[Trajectory, Array]:
    """Return one trajectory of runs, with rests in between, and its segments' end times.

    Raises PathError if it would have more than MAX_POINTS.
    """
    if (count := sum(len(run.times) for run in runs)) > MAX_POINTS:
        raise PathError(f'{count} points: must be at most {MAX_POINTS}, so send fewer motions')
    first = runs[0]
    times, positions, velocities = [first.times], [first.positions], [first.velocities]
    ends = [first.ends]
    for run in runs[1:]:
        start = times[-1][-1] + REST_S  # a run starts at the last point of the previous run
        times.append(start + run.times)
        positions.append(run.positions)
        velocities.append(run.velocities)
        ends.append(start + run.ends)
    trajectory = Trajectory(
        names, np.concatenate(times), np.concatenate(positions), np.concatenate(velocities)
    )
    return trajectory, np.concatenate(ends)


def _motions(
    path: JointPath, parts: Sequence[PartLimits], *, slow: bool
) -> list[tuple[TimeParametrisation, float]]:
    """Return possible motions, the fastest first, each with its slowdown factor (`_stretch`)."""
    slopes = _slopes(path)
    motion = fastest(parts)
    stretch = _stretch(path, slopes, motion, slow=slow)
    if stretch == 1.0:
        return [(motion, 1.0)]
    candidates = [(motion, stretch)]
    fractions = _allowed_fractions(path, slopes, parts)
    for levels in LEVELS:
        motion = fastest(list(_slowed_parts(path, parts, fractions, levels)))
        candidates.append((motion, _stretch(path, slopes, motion, slow=True)))
    return sorted(candidates, key=lambda candidate: candidate[0].duration * candidate[1])


def _slopes(path: JointPath) -> Array:
    """Return the first three derivatives of the joint positions, shape (3, k, n).

    The derivatives are taken at the samples, with respect to the distance along the path.
    """
    first = np.gradient(path.joints, path.distances, axis=0, edge_order=2)
    second = np.gradient(first, path.distances, axis=0, edge_order=2)
    third = np.gradient(second, path.distances, axis=0, edge_order=2)
    return np.array([first, second, third])


def _stretch(path: JointPath, slopes: Array, motion: TimeParametrisation, *, slow: bool) -> float:
    """Return the slowdown factor, 1 or more, with which a motion respects the joint limits.

    Raises PathError if the factor is above MAX_STRETCH, or if it is above 1 and not `slow`.
    """
    limits = path.kinematics.model.limits
    first, second, third = slopes
    times = np.linspace(0.0, motion.duration, 4 * len(path.distances))
    distance, *rates = motion.sample(times)
    index = np.clip(np.searchsorted(path.distances, distance), 0, len(path.distances) - 1)
    speed, acceleration, jerk = (rate[:, None] for rate in rates)
    needed = (
        ('velocity', '/s', first[index] * speed, limits.velocity, 1),
        (
            'acceleration',
            '/s²',
            second[index] * speed**2 + first[index] * acceleration,
            limits.acceleration,
            2,
        ),
        (
            'jerk',
            '/s³',
            np.abs(third[index] * speed**3)
            + np.abs(3.0 * second[index] * speed * acceleration)
            + np.abs(first[index] * jerk),
            limits.jerk,
            3,
        ),
    )
    stretch = 1.0
    for quantity, per, values, allowed, order in needed:
        excess = np.abs(values) / allowed
        row, joint = np.unravel_index(int(np.argmax(excess)), excess.shape)
        factor = float(excess[row, joint]) ** (1.0 / order)
        if factor > (MAX_STRETCH if slow else 1.0):
            unit = limits.units[joint] + per
            a = 'an' if quantity[0] in 'aeiou' else 'a'
            raise PathError(
                f'near a singularity, or too fast, {path.where(int(index[row]))}: '
                f'{limits.names[joint]} would need {a} {quantity} of '
                f'{abs(float(values[row, joint])):.4g} {unit}, the limit is '
                f'{allowed[joint]:.4g} {unit}'
            )
        stretch = max(stretch, factor)
    return stretch


def _allowed_fractions(path: JointPath, slopes: Array, parts: Sequence[PartLimits]) -> Array:
    """Return the fraction f of the part's speed that the joints allow between samples, (k - 1,).

    Speed · f, acceleration · f² and jerk · f³ respect every joint limit, even at the same time.
    """
    limits = path.kinematics.model.limits
    of_part = np.array([(part.speed, part.acceleration, part.jerk) for part in parts])
    speed, acceleration, jerk = of_part[_part_indices(path, parts)].T[:, :, None]
    first, second, third = np.maximum(np.abs(slopes[:, 1:]), np.abs(slopes[:, :-1]))
    fraction = fraction_of_limits(limits, (first, second, third), speed, acceleration, jerk)
    padded = np.pad(fraction, 1, mode='edge')  # derivatives are differences of adjacent samples
    return np.asarray(np.min([padded[:-2], fraction, padded[2:]], axis=0))


def _slowed_parts(
    path: JointPath, parts: Sequence[PartLimits], fractions: Array, levels: int
) -> Iterator[PartLimits]:
    """Yield the parts with reduced limits, divided where the reduction changes.

    fractions: result of `_allowed_fractions`, here rounded down to one of `levels` levels.
    """
    minimum = min(float(fractions.min()), 1.0 - 1e-9)
    allowed = minimum ** (np.ceil(np.log(fractions) / np.log(minimum) * levels - 1e-9) / levels)
    indices = _part_indices(path, parts)
    cut = (np.diff(allowed) != 0.0) | (np.diff(indices) != 0)
    for start, end in pairwise([0, *(np.flatnonzero(cut) + 1).tolist(), len(fractions)]):
        part, fraction = parts[indices[start]], float(allowed[start])
        yield PartLimits(
            float(path.distances[end] - path.distances[start]),
            fraction * part.speed,
            fraction**2 * part.acceleration,
            fraction**3 * part.jerk,
        )


def _part_indices(path: JointPath, parts: Sequence[PartLimits]) -> npt.NDArray[np.intp]:
    """Return the index of the part that contains each step between two samples, (k - 1,)."""
    seams = np.cumsum([part.length for part in parts])
    middles = (path.distances[1:] + path.distances[:-1]) / 2.0
    return np.asarray(np.minimum(np.searchsorted(seams, middles), len(parts) - 1))


def _sampled(
    path: JointPath, motion: TimeParametrisation, stretch: float, period: float
) -> tuple[Array, Array, Array]:
    duration = motion.duration * stretch
    times = sample_times(duration, min(period, duration / 2.0))
    distance, speed, _, _ = motion.sample(times / stretch)
    slopes = np.gradient(path.joints, path.distances, axis=0, edge_order=2)
    slope = np.array([np.interp(distance, path.distances, column) for column in slopes.T]).T
    velocities = slope * speed[:, None] / stretch
    velocities[0] = velocities[-1] = 0.0
    return times, path.joints_at(distance), velocities


def _deviation(path: JointPath, positions: Array) -> float:
    """Return the largest distance of the tool from the path, midway between two points, m."""
    deviation = 0.0
    for middle in (positions[1:] + positions[:-1]) / 2.0:
        path.checkpoint()
        tool = path.kinematics.forward(middle)[:3, 3]
        deviation = max(deviation, distance_from(tool, path.positions))
    return deviation
