# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Points between those of a trajectory: where they are far apart, and out of a moving state.

Each segment that gets some is one jerk-limited motion of its own, checked by its exact extrema,
from the state at its beginning to the one at its end.
"""

from math import ceil

import numpy as np

from epson_driver.motion.joint_motion import JointMotion, State, move_into
from epson_driver.motion.limits import Array, JointLimits
from epson_driver.motion.trajectory import Trajectory

SPACING_S = 0.1
"""Time between two points at most in a segment that gets more of them, s."""

MIN_DIVIDED_S = 0.2
"""A shorter segment stays as it is, s: a jerk-limited motion between moving states needs about
twice the time in which the acceleration builds up, and is a detour in less."""

ROUNDING_SHARE = 1e-6
"""How much longer than planned a divided segment may take, as a share, for rounding."""


def divided(trajectory: Trajectory, limits: JointLimits, *, moving: bool = False) -> Trajectory:
    """Return a trajectory with points at most SPACING_S apart, as far as its limits allow that.

    It must have velocities and begin at 0 s. Its own points stay, and so do their times. A segment
    that cannot keep its time inside the limits stays as it is.

    `moving`: the arm passes the first point with its velocity. The first segment is replaced by a
    motion inside the limits then, which takes longer where they need that: all later points come
    as much later; and it ends at rest where that is sooner. Raises ValueError if there is none.
    """
    if trajectory.velocities is None:
        raise ValueError('the trajectory has no velocities')
    times = [trajectory.times[:1]]
    positions = [trajectory.positions[:1]]
    velocities = [trajectory.velocities[:1]]
    shift = 0.0
    for index in range(1, len(trajectory.times)):
        begin, end = trajectory.times[index - 1 : index + 1].tolist()
        velocity = trajectory.velocities[index]
        start = _state(trajectory, index - 1)
        if moving and index == 1:
            motion, velocity = _led_in(start, trajectory, limits)
            shift = motion.duration - (end - begin)
            inside = _inside(motion)
        else:
            inside = _between(start, trajectory, index, limits)
        for values, found in zip((times, positions, velocities), inside, strict=True):
            values.append(found)
        times[-1] = times[-1] + float(times[-2][-1])
        times.append(np.array([end + shift]))
        positions.append(trajectory.positions[index : index + 1])
        velocities.append(velocity[None, :])
    return Trajectory(
        trajectory.joint_names,
        np.concatenate(times),
        np.concatenate(positions),
        np.concatenate(velocities),
    )


def _state(trajectory: Trajectory, index: int) -> State:
    assert trajectory.velocities is not None  # noqa: S101 - for the type checker
    velocity = trajectory.velocities[index]
    return trajectory.positions[index], velocity, np.zeros_like(velocity)


def _led_in(
    start: State, trajectory: Trajectory, limits: JointLimits
) -> tuple[JointMotion, Array]:
    """Return the motion into a trajectory's second point, and the velocity there, shape (n,)."""
    planned, velocity, _ = _state(trajectory, 1)
    duration = float(trajectory.times[1] - trajectory.times[0])
    found: list[tuple[JointMotion, Array]] = []
    for wanted in (velocity, np.zeros_like(velocity)):
        motion = move_into(limits, start, planned, wanted, duration)
        if motion is not None:
            found.append((motion, wanted))
    if not found:
        raise ValueError('no motion inside the limits leads from its way into the new one')
    return min(found, key=lambda each: each[0].duration)


def _between(
    start: State, trajectory: Trajectory, index: int, limits: JointLimits
) -> tuple[Array, Array, Array]:
    """Return times since the segment's beginning, positions and velocities inside of it."""
    none = np.zeros((0, trajectory.positions.shape[1]))
    duration = float(trajectory.times[index] - trajectory.times[index - 1])
    if duration < MIN_DIVIDED_S:
        return np.zeros(0), none, none
    end, velocity, _ = _state(trajectory, index)
    motion = move_into(limits, start, end, velocity, duration)
    if motion is None or motion.duration > duration * (1.0 + ROUNDING_SHARE):
        return np.zeros(0), none, none
    return _inside(motion)


def _inside(motion: JointMotion) -> tuple[Array, Array, Array]:
    """Return times, positions and velocities of a motion, without its beginning and its end."""
    parts = ceil(motion.duration / SPACING_S - ROUNDING_SHARE)
    times = motion.duration * np.arange(1, parts) / max(parts, 1)
    states = [motion.at(time) for time in times.tolist()]
    count = motion.end.shape[0]
    positions = np.array([state[0] for state in states]).reshape(-1, count)
    velocities = np.array([state[1] for state in states]).reshape(-1, count)
    return times, positions, velocities
