# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The joints along a path of the tool, in one configuration, or where there are none."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from math import ceil

import numpy as np

from epson_driver.motion import Array
from epson_driver.motion.blended_path import Run
from epson_driver.robots.kinematics import Kinematics

STEP_M = 0.001
STEP_RAD = 0.01
"""How densely a path is looked at."""

MIN_STEPS = 50
"""For each line, arc and blend."""

MAX_STEPS = 5000

MAX_JOINT_STEP = 0.15
"""A joint that changes by more from one look to the next, rad or m, jumps."""


class PathError(ValueError):
    """The tool cannot follow a path; the text says where and why."""


class GivenUpError(PathError):
    """Nobody wants the motion any more: its planning ends."""

    def __init__(self) -> None:
        super().__init__('given up before it began')


GivenUp = Callable[[], bool]
"""Returns True when nobody wants the motion any more; it is asked at every look, in any thread."""


def never() -> bool:
    """Return False: it is wanted."""
    return False


@dataclass(frozen=True, eq=False)
class JointPath:
    """The joints along a run of a path, from rest to rest: at k places of it, and anywhere.

    ways: how far from its begin, m or what else it is counted in, shape (k,); joints: (k, n);
    places: of the tool, (k, 3), m. at: returns the joints after other ways, shape (m,), to all
    digits: shape (m, n). name: what to call the run.
    """

    name: str
    kinematics: Kinematics
    ways: Array
    joints: Array
    places: Array
    at: Callable[[Array], Array]

    def where(self, index: int) -> str:
        """Return a place as a clause."""
        at = ', '.join(f'{value * 1e3:.1f}' for value in self.places[index])
        return f'{self.ways[index] / self.ways[-1] * 100.0:.0f} % of {self.name}, at ({at}) mm'


def joint_path(
    kinematics: Kinematics,
    start: Array,
    run: Run,
    name: str = 'the way',
    given_up: GivenUp = never,
) -> JointPath:
    """Return the joints along a run that begins where the joints `start`, shape (n,), are.

    Raises PathError for a pose without a solution within the joint limits near the one before:
    out of reach, beyond a joint's limit, or past a singularity. KinematicsError for a chain
    without a closed form, ModuleNotFoundError that says what to install.
    """
    counts = [
        max(ceil(part.length / STEP_M), ceil(part.angle / STEP_RAD), MIN_STEPS)
        for part in run.parts
    ]
    if sum(counts) > MAX_STEPS:
        raise PathError(f'the path is longer than {MAX_STEPS} looks of {STEP_M * 1e3:g} mm')
    looks = [
        np.linspace(*seams, count, endpoint=False)
        for seams, count in zip(pairwise(run.seams), counts, strict=True)
    ]
    ways = np.concatenate([*looks, run.seams[-1:]])
    poses = [run.pose(way) for way in ways.tolist()]
    joints = np.empty((len(ways), len(start)))

    def at(others: Array) -> Array:
        near = np.array([np.interp(others, ways, column) for column in joints.T]).T
        exact = np.empty_like(near)
        for index, (way, guess) in enumerate(zip(others.tolist(), near, strict=True)):
            if given_up():
                raise GivenUpError
            solutions = kinematics.inverse(run.pose(way), guess)
            if not len(solutions) or np.max(np.abs(solutions[0] - guess)) > MAX_JOINT_STEP:
                raise PathError(f'no solution at {way / ways[-1] * 100.0:.3g} % of {name}')
            exact[index] = solutions[0]
        return exact

    found = JointPath(name, kinematics, ways, joints, np.array(poses)[:, :3, 3], at)
    before = start
    for index, pose in enumerate(poses):
        if given_up():
            raise GivenUpError
        solutions = kinematics.inverse(pose, before)
        if not len(solutions):
            if why := kinematics.hindrance(pose):
                raise PathError(f'no joints give the pose {found.where(index)}: {why}')
            raise PathError(_why_none(kinematics, before, found.where(index)))
        step = np.abs(solutions[0] - before)
        joint = int(np.argmax(step))
        if step[joint] > MAX_JOINT_STEP:
            names, units = kinematics.model.limits.names, kinematics.model.limits.units
            raise PathError(
                f'near a singularity, or at a limit, {found.where(index)}: {names[joint]} would '
                f'have to jump from {before[joint]:.4g} to {solutions[0][joint]:.4g} '
                f'{units[joint]}'
            )
        before = joints[index] = solutions[0]
    return found


def _why_none(kinematics: Kinematics, before: Array, where: str) -> str:
    """Return why a pose has no solution: the joint that is nearest to its limit is named."""
    limits = kinematics.model.limits
    room = np.minimum(before - limits.position_min, limits.position_max - before)
    joint = int(np.argmin(room))
    if room[joint] > MAX_JOINT_STEP:
        return f'out of reach {where}'
    return (
        f'out of reach {where}: {limits.names[joint]} is at {before[joint]:.4g} just before, its '
        f'limits are {limits.position_min[joint]:.4g} … {limits.position_max[joint]:.4g} '
        f'{limits.units[joint]}'
    )
