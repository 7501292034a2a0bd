# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""From a line or an arc of the tool to a trajectory of the joints, or why there is none.

The whole motion is looked at before any of it is sent: each joint must keep its velocity,
acceleration and jerk limits all the way. Near a singularity some joint would have to be very fast
for a small way: that is refused with the joint and the place, or made slow enough if asked.
"""

from dataclasses import dataclass
from math import ceil

import numpy as np

from epson_driver.motion import Array, JointLimits, LineMotion, Trajectory, go
from epson_driver.motion.cartesian import PosePath, distance_from
from epson_driver.robots.joint_path import JointPath, PathError, joint_path
from epson_driver.robots.kinematics import Kinematics

PERIOD_S = 0.05
MIN_PERIOD_S = 0.01
"""Time between two points that are sent: at most, and at least."""

JERK_PER_ACCELERATION = 10.0
"""The jerk of the tool as a multiple of its acceleration, 1/s: a ramp of 0.1 s."""

MAX_STRETCH = 100.0
"""A path that would have to be so much slower than asked is refused all the same."""

SHORTEST_WAY = 1e-6
"""m or rad; a path with less of both is no motion."""


@dataclass(frozen=True, slots=True)
class ToolLimits:
    """How the tool may move. speed: m/s, acceleration: m/s²; of its turn: rad/s, rad/s².

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
    if max(path.length, path.angle) < SHORTEST_WAY:
        raise PathError('the tool is there already')
    found = joint_path(kinematics, start, path)
    law = _law(path, tool)
    stretch = _stretch(found, law, tool.slow)
    period = PERIOD_S
    while True:
        trajectory = _sampled(found, law, stretch, period)
        worst = _deviation(found, trajectory.positions)
        if worst <= tool.accuracy:
            return trajectory
        if period / 2.0 < MIN_PERIOD_S:
            raise PathError(
                f'points {period:.3g} s apart leave the path by {worst * 1e3:.3g} mm between '
                f'them: the accuracy asked for is {tool.accuracy * 1e3:.3g} mm; go slower'
            )
        period /= 2.0


def _law(path: PosePath, tool: ToolLimits) -> LineMotion:
    """Return how the share of the path grows from 0 to 1, from rest to rest."""

    def share_of(way_limit: float, turn_limit: float) -> Array:
        shares = [
            limit / way
            for limit, way in ((way_limit, path.length), (turn_limit, path.angle))
            if way >= SHORTEST_WAY
        ]
        return np.array([min(shares)])

    urge = share_of(tool.acceleration, tool.turn_acceleration)
    rules = JointLimits(
        ('path',),
        np.array([-1.0]),
        np.array([2.0]),
        share_of(tool.speed, tool.turn_speed),
        urge,
        JERK_PER_ACCELERATION * urge,
    )
    return go(rules, np.zeros(1), np.ones(1))


def _stretch(found: JointPath, law: LineMotion, slow: bool) -> float:
    """Return by what factor the motion must take longer for the joint limits: 1 or more.

    Raises PathError unless that is 1, or `slow` allows it.
    """
    limits = found.kinematics.model.limits
    first = np.gradient(found.joints, found.shares, axis=0, edge_order=2)
    second = np.gradient(first, found.shares, axis=0, edge_order=2)
    third = np.gradient(second, found.shares, axis=0, edge_order=2)
    steps = 4 * len(found.shares)
    times = np.linspace(0.0, law.duration, steps)
    share, speed, acceleration = np.array([law.at(time) for time in times.tolist()])[:, :, 0].T
    index = np.clip(np.searchsorted(found.shares, share), 0, len(found.shares) - 1)
    speed, acceleration = speed[:, None], acceleration[:, None]
    jerk = float(np.max(np.abs(law.pieces.jerks)))
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
            + np.abs(first[index]) * jerk,
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


def _sampled(found: JointPath, law: LineMotion, stretch: float, period: float) -> Trajectory:
    """Return the motion as points at most `period` s apart."""
    duration = law.duration * stretch
    times = np.linspace(0.0, duration, max(ceil(duration / period), 2) + 1)
    share, speed, _ = np.array([law.at(time / stretch) for time in times.tolist()])[:, :, 0].T
    slopes = np.gradient(found.joints, found.shares, axis=0, edge_order=2)
    slope = np.array([np.interp(share, found.shares, column) for column in slopes.T]).T
    velocities = slope * speed[:, None] / stretch
    velocities[0] = velocities[-1] = 0.0
    names = found.kinematics.model.limits.names
    return Trajectory(names, times, found.at(share), velocities)


def _deviation(found: JointPath, positions: Array) -> float:
    """Return how far the tool is from the path in the middle between two points, at most, m."""
    middles = (positions[1:] + positions[:-1]) / 2.0
    places = (found.kinematics.forward(middle)[:3, 3] for middle in middles)
    return max(distance_from(place, found.places) for place in places)
