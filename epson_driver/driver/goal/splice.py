# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Replace a goal without stopping: where to leave the old trajectory and how to join the new one.

The controller is told nothing of it. Points that it has taken cannot be withdrawn; of the old goal
no more are sent, and those of the new one follow with the next numbers, as if all of them were one
trajectory. So STOP, the controller's own limits and all that ends a goal are as ever.

1. A goal is left between two points: when one was acknowledged and the next is not sent yet, so
   that no reply belongs to a goal that has ended.
2. The way into the new goal begins at the last point that was taken, with the velocity that the
   old plan has there, and ends at the new goal's first point, with its velocity. It is a motion
   inside every limit (motion/segments.py), and is there when the new goal says, counted from when
   it replaces the old one, if the limits and HURRY_SHARE allow that.
3. The new goal must begin there as it otherwise must where the arm stands (`check_start`). A first
   point at 0 s is where it begins, and is left out.
4. So that this comes soon, no goal is sent farther ahead of its clock than the controller needs
   (lead.py), and long segments get more points.
5. Where that cannot be, or comes too late, the goal is replaced as ever: by STOP, rest, start.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from epson_driver.driver.delivery.trajectory_points import with_velocities
from epson_driver.driver.goal.goal import check_limits, listed
from epson_driver.driver.outcome import ErrorCode, GoalRejectedError
from epson_driver.motion import Array, JointLimits, Trajectory
from epson_driver.motion.segments import divided
from epson_driver.simple_message import JointTrajPt, Message

MIN_WAY_S = 1e-3
"""Time for the way to a trajectory's only point if that is at 0 s, s: it takes what it needs."""

HURRY_SHARE = 0.5
"""The new goal's clock begins when it replaces the old one, and what is left of that one's points
takes some of the time to its first point. For the way in there is so much at least of the time
that it would have at the speed from where the arm was: it is hurried no more."""

MIN_WAY_RAD = 1e-6
"""A shorter way has no speed, rad or m."""

MIN_AHEAD_S = 1e-6
"""A point that is so little ahead is where the arm is, s."""

LATEST_SHARE = 2.0
"""An arm that could leave its goal no sooner than this many times the largest lead is stopped."""


def check_start(
    trajectory: Trajectory, actual: Array, limits: JointLimits, tolerance: float
) -> None:
    """Raise GoalRejectedError INVALID_GOAL unless the trajectory starts where the arm is.

    A first point at time 0 must be within `tolerance` (rad) of `actual` (shape (n,), rad); a later
    one must be reachable from there in its time.
    """
    offset = np.abs(trajectory.positions[0] - actual)
    time = float(trajectory.times[0])
    found = [
        f'{name}: the trajectory starts at {start:.6g} {unit}, '
        f'the joint is at {value:.6g} {unit}: '
        + (
            f'{difference:.6g} {unit} apart, the limit is {tolerance:g} {unit}'
            if time == 0.0
            else f'to be there after {time:g} s it would need {difference / time:.6g} {unit}/s, '
            f'the velocity limit is {velocity:.6g} {unit}/s'
        )
        for name, unit, start, value, difference, velocity in zip(
            trajectory.joint_names,
            limits.units,
            trajectory.positions[0],
            actual,
            offset,
            limits.velocity,
            strict=True,
        )
        if difference > max(tolerance, velocity * time)
    ]
    if found:
        raise GoalRejectedError(ErrorCode.INVALID_GOAL, listed(found))


@dataclass(frozen=True, eq=False)
class SplicePoint:
    """Where a goal is left.

    trajectory: its own, as it is executed; taken: the index of the last point that the controller
    has of it; sequence: the number of that one on the wire; sent_until: when it is reached, by the
    loop's clock, s. time: where the goal's clock is, s; seen: when it was there, by the loop's
    clock, s; position, velocity: of the plan there, shape (n,), rad, rad/s; factors: with which
    each point was sent.
    """

    trajectory: Trajectory
    taken: int
    sequence: int
    sent_until: float
    time: float
    seen: float
    position: Array
    velocity: Array
    factors: Sequence[float]


@dataclass(frozen=True, eq=False)
class SplicedTrajectory:
    """The trajectory of a spliced goal: the rest of the old points, the way in, the new points.

    It begins at 0 s where the old goal's clock was. `first` is the index of the first point that
    the controller does not have yet; factors: with which those before were sent.
    """

    trajectory: Trajectory
    first: int
    factors: Sequence[float]


def spliced(
    old: SplicePoint, new: Trajectory, limits: JointLimits, start_tolerance: float
) -> SplicedTrajectory:
    """Join a new trajectory to one that is left at a splice point.

    Raises GoalRejectedError if it begins elsewhere, or if no way inside the limits leads there.
    """
    known = with_velocities(old.trajectory)
    assert known.velocities is not None  # noqa: S101 - for the type checker
    position, velocity = known.positions[old.taken], known.velocities[old.taken]
    check_start(new, position, limits, start_tolerance)
    begin = max(float(known.times[old.taken]) - old.time, 0.0)
    try:
        left = _time_left(old, new, position, begin)
        way_in = divided(_from(position, velocity, new, left), limits, moving=True)
    except ValueError as error:
        raise GoalRejectedError(ErrorCode.INVALID_GOAL, str(error)) from error
    assert way_in.velocities is not None  # noqa: S101 - for the type checker
    # what the controller has, from where the clock is now to where the way in begins
    ahead = np.flatnonzero(known.times[: old.taken + 1] > old.time + MIN_AHEAD_S)
    if len(ahead):
        times = [np.zeros(1), known.times[ahead] - old.time, begin + way_in.times[1:]]
        positions = [old.position[None, :], known.positions[ahead], way_in.positions[1:]]
        velocities = [old.velocity[None, :], known.velocities[ahead], way_in.velocities[1:]]
    else:
        times, positions, velocities = [way_in.times], [way_in.positions], [way_in.velocities]
    trajectory = Trajectory(
        new.joint_names,
        np.concatenate(times),
        np.concatenate(positions),
        np.concatenate(velocities),
    )
    check_limits(way_in, limits, may_end_moving=True)
    factors = [1.0, *(old.factors[index] for index in ahead.tolist())]
    return SplicedTrajectory(trajectory, len(factors), factors)


def begun(
    new: Trajectory, start: Array, limits: JointLimits, tolerance: float, *, leavable: bool
) -> Trajectory:
    """Return the trajectory to execute from where the arm stands, shape (n,), rad or m.

    `leavable`: it can be left on the way. Raises GoalRejectedError as `check_start` does.
    """
    check_start(new, start, limits, tolerance)
    return from_rest(new, start, limits) if leavable else new


def from_rest(new: Trajectory, start: Array, limits: JointLimits) -> Trajectory:
    """Return the trajectory to execute from rest at `start`, shape (n,), rad or m.

    It can be left on the way. It begins at 0 s, at its first point or, if that comes later, at
    `start`.
    """
    if new.times[0] > 0.0:
        new = _from(start, np.zeros_like(start), new, float(new.times[0]))
    return divided(with_velocities(new), limits)


def numbered(messages: Sequence[Message], first: int, sequence: int) -> list[Message]:
    """Number the messages of a spliced trajectory, the one at `first` after `sequence`."""
    return [
        replace(message, sequence=sequence + 1 + index - first)
        if isinstance(message, JointTrajPt)
        else message
        for index, message in enumerate(messages)
    ]


def _time_left(old: SplicePoint, new: Trajectory, position: Array, passed: float) -> float:
    """Return the time left for the way in to a new goal's first point, s.

    So much of it has `passed` where the way in begins, at `position`.
    """
    index = min(int(np.argmax(new.times > 0.0)), len(new.times) - 1)
    planned, point = float(new.times[index]), new.positions[index]
    whole = float(np.max(np.abs(point - old.position)))
    rest = float(np.max(np.abs(point - position)))
    share = HURRY_SHARE * rest / max(whole, HURRY_SHARE * rest, MIN_WAY_RAD)
    return max(planned - passed, share * planned, MIN_WAY_S)


def _from(position: Array, velocity: Array, new: Trajectory, left: float) -> Trajectory:
    """Return a trajectory from a state at 0 s to the first point after that, and on.

    `left`: the time to that point, s.
    """
    later = new.times > 0.0
    if later.any():
        times = np.concatenate([[0.0], new.times[later] - new.times[later][0] + left])
    else:  # one point, at 0 s: where it goes, as fast as that may be
        later = np.array([True])
        times = np.array([0.0, left])
    positions = np.vstack([position, new.positions[later]])
    whole = Trajectory(new.joint_names, times, positions)
    if new.velocities is None:
        velocities = with_velocities(whole).velocities
        assert velocities is not None  # noqa: S101 - for the type checker
        velocities[0] = velocity
    else:
        velocities = np.vstack([velocity, new.velocities[later]])
    return replace(whole, velocities=velocities)
