# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""From lines and arcs of the tool to a trajectory of the joints, or why there is none.

The whole motion is looked at before any of it is sent: each joint must keep its velocity,
acceleration and jerk limits all the way. Near a singularity some joint would have to be very fast
for a small way: that is refused with the joint and the place, or made slow enough if asked.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil

import numpy as np

from epson_driver.motion import Array, Trajectory
from epson_driver.motion.blended_path import BlendError, Run, runs, size_of
from epson_driver.motion.cartesian import PosePath, distance_from
from epson_driver.motion.path_speed import PartLimits, PathMotion, fastest
from epson_driver.robots.joint_path import JointPath, PathError, joint_path
from epson_driver.robots.kinematics import Kinematics

PERIOD_S = 0.05
MIN_PERIOD_S = 0.01
"""Time between two points that are sent: at most, and at least."""

JERK_PER_ACCELERATION = 10.0
"""The jerk of the tool as a multiple of its acceleration, 1/s: a ramp of 0.1 s."""

REST_S = 0.2
"""How long the tool rests between two runs: controllers that go smoothly through points take one
that is repeated so much later for a rest, and others for a corner that may be rounded."""

MAX_STRETCH = 100.0
"""A path that would have to be so much slower than asked is refused all the same."""

SIDEWAYS_SHARE = 0.8
"""How much of the acceleration a bend may take at most. At right angles to it, 0.6 are left for
speeding up and slowing down."""

TINY = 1e-12
"""Less of a derivative counts as this much."""

BEND_LOOKS = 33
"""At how many places of a part its bend is looked at."""


@dataclass(frozen=True, slots=True)
class ToolLimits:
    """How the tool may move. speed: m/s, acceleration: m/s²; of its turn: rad/s, rad/s².

    Both are kept in bends as well, where the speed is less for it.

    accuracy: how far the straight way in joint space between two points that are sent may be from
    the path, m. slow: go slower, all the way, where a joint limit asks for it.
    """

    speed: float = 0.1
    acceleration: float = 1.0
    turn_speed: float = 1.0
    turn_acceleration: float = 10.0
    accuracy: float = 1e-4
    slow: bool = False


def cartesian_trajectory(
    kinematics: Kinematics, start: Array, path: PosePath, tool: ToolLimits
) -> Trajectory:
    """Return the joints' way along a path that begins where the joints, shape (n,), are.

    It has velocities, and begins and ends at rest. Raises PathError that says what is in the way,
    at which place and for which joint; and as `joint_path`.
    """
    try:
        return runs_trajectory(kinematics, start, runs([path], []), tool)
    except BlendError as error:
        raise PathError(str(error)) from error


def runs_trajectory(
    kinematics: Kinematics, start: Array, path: Sequence[Run], tool: ToolLimits
) -> Trajectory:
    """Return the joints' way along the runs of a path, with a rest of REST_S after each.

    The rest is as in `cartesian_trajectory`.
    """
    times, positions, velocities = [np.zeros(1)], [start[None, :]], [np.zeros((1, len(start)))]
    for run in path:
        if len(times) > 1:
            times.append(times[-1][-1:] + REST_S)
            positions.append(positions[-1][-1:])
            velocities.append(velocities[-1][-1:])
        name = 'the way' if len(path) == 1 else f'the way to points[{run.last}]'
        found = joint_path(kinematics, positions[-1][-1], run, name)
        moments, rows, speeds = _run_points(found, tool)
        times.append(times[-1][-1] + moments[1:])
        positions.append(rows[1:])
        velocities.append(speeds[1:])
    names = kinematics.model.limits.names
    return Trajectory(
        names, np.concatenate(times), np.concatenate(positions), np.concatenate(velocities)
    )


def _run_points(found: JointPath, tool: ToolLimits) -> tuple[Array, Array, Array]:
    """Return times, positions and velocities along a run, from rest to rest."""
    motion = fastest([_part_limits(part, tool) for part in found.run.parts])
    stretch = _stretch(found, motion, tool.slow)
    period = PERIOD_S
    while True:
        points = _sampled(found, motion, stretch, period)
        worst = _deviation(found, points[1])
        if worst <= tool.accuracy:
            return points
        if period / 2.0 < MIN_PERIOD_S:
            raise PathError(
                f'points {period:.3g} s apart leave the path by {worst * 1e3:.3g} mm between '
                f'them: the accuracy asked for is {tool.accuracy * 1e3:.3g} mm; go slower'
            )
        period /= 2.0


def _part_limits(part: PosePath, tool: ToolLimits) -> PartLimits:
    """Return the limits of the way along a part, so that tool and turn keep theirs in bends."""
    size = size_of(part)
    powers = size ** np.arange(1, 4)[:, None]
    looks = np.array(
        [part.derivatives(share) / powers for share in np.linspace(0.0, 1.0, BEND_LOOKS).tolist()]
    )
    # per m (rad) of the way, its square and its cube: of the tool's place, and of its turn
    most = np.linalg.norm(looks.reshape(BEND_LOOKS, 3, 2, 3), axis=-1).max(axis=0)
    most = np.maximum(most, TINY)
    speed_limits = np.array([tool.speed, tool.turn_speed])
    urges = np.array([tool.acceleration, tool.turn_acceleration])
    speed = float(
        np.min(
            [
                speed_limits / most[0],
                np.sqrt(SIDEWAYS_SHARE * urges / most[1]),
                np.cbrt(JERK_PER_ACCELERATION * urges / most[2]),
            ]
        )
    )
    sideways = min(float(np.max(speed**2 * most[1] / urges)), SIDEWAYS_SHARE)
    acceleration = float(np.min(urges / most[0])) * np.sqrt(1.0 - sideways**2)
    return PartLimits(size, speed, acceleration, JERK_PER_ACCELERATION * acceleration)


def _stretch(found: JointPath, motion: PathMotion, slow: bool) -> float:
    """Return by what factor the motion must take longer for the joint limits: 1 or more.

    Raises PathError unless that is 1, or `slow` allows it.
    """
    limits = found.kinematics.model.limits
    first = np.gradient(found.joints, found.ways, axis=0, edge_order=2)
    second = np.gradient(first, found.ways, axis=0, edge_order=2)
    third = np.gradient(second, found.ways, axis=0, edge_order=2)
    times = np.linspace(0.0, motion.duration, 4 * len(found.ways))
    way, *rates = motion.at(times)
    index = np.clip(np.searchsorted(found.ways, way), 0, len(found.ways) - 1)
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
            raise PathError(
                f'near a singularity, or too fast, {found.where(int(index[row]))}: '
                f'{limits.names[joint]} would need a {quantity} of '
                f'{abs(float(values[row, joint])):.4g} {unit}, the limit is '
                f'{allowed[joint]:.4g} {unit}'
            )
        stretch = max(stretch, factor)
    return stretch


def _sampled(
    found: JointPath, motion: PathMotion, stretch: float, period: float
) -> tuple[Array, Array, Array]:
    """Return times, positions and velocities of the motion, at most `period` s apart."""
    duration = motion.duration * stretch
    times = np.linspace(0.0, duration, max(ceil(duration / period), 2) + 1)
    way, speed, _, _ = motion.at(times / stretch)
    slopes = np.gradient(found.joints, found.ways, axis=0, edge_order=2)
    slope = np.array([np.interp(way, found.ways, column) for column in slopes.T]).T
    velocities = slope * speed[:, None] / stretch
    velocities[0] = velocities[-1] = 0.0
    return times, found.at(way), velocities


def _deviation(found: JointPath, positions: Array) -> float:
    """Return how far the tool is from the path in the middle between two points, at most, m."""
    middles = (positions[1:] + positions[:-1]) / 2.0
    places = (found.kinematics.forward(middle)[:3, 3] for middle in middles)
    return max(distance_from(place, found.places) for place in places)
