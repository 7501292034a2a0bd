# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Continuous joint positions along a path of the tool, by inverse kinematics."""

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise
from math import ceil

import numpy as np

from epson_driver.motion import Array
from epson_driver.robots.kinematics import Kinematics
from epson_driver.tool_motion.pose_path import Run

STEP_M = 0.001
STEP_RAD = 0.01
"""Maximum distance, m, and maximum angle, rad, between two samples of a path."""

MIN_STEPS = 50
"""Minimum number of samples of each line, arc and blend."""

MAX_STEPS = 5000

MAX_JOINT_STEP = 0.15
"""Maximum step of a joint between two samples, rad or m. If it is larger, samples are added."""

MAX_SUBDIVISION = 64
"""Maximum factor by which added samples reduce the spacing. If a joint's step is still too large,
the path is refused."""


class PathError(ValueError):
    """A path that the tool cannot follow. The text names the position and the reason."""


@dataclass(frozen=True, eq=False)
class ShownFrame:
    """The frame that error texts use: its name, and the pose of base_link in it, (4, 4), m."""

    name: str = 'base_link'
    base_link: Array = field(default_factory=lambda: np.eye(4))

    def text(self, position: Array) -> str:
        """Return a position in mm in this frame. `position`: in base_link, m, shape (3,)."""
        seen = self.base_link[:3, :3] @ position + self.base_link[:3, 3]
        numbers = ', '.join(f'{value * 1e3:.1f}' for value in seen)
        return f'({numbers}) mm in {self.name}'


BASE_LINK = ShownFrame()

Checkpoint = Callable[[], None]
"""Function called at every step of planning, in any thread. It may raise to cancel."""


@dataclass(frozen=True, eq=False)
class JointPath:
    """The joint positions along a run, which is a path from rest to rest.

    * name, frame: for error texts.
    * distances: distances of k samples from the start, m or another unit.
    * joints, positions: joint and tool positions at the samples.
    * joints_at: function from other distances to joint positions.
    * checkpoint: called at each sample. It may raise to cancel.
    """

    name: str
    kinematics: Kinematics
    distances: Array
    joints: Array
    positions: Array
    joints_at: Callable[[Array], Array]
    checkpoint: Checkpoint = lambda: None
    frame: ShownFrame = BASE_LINK

    def where(self, index: int) -> str:
        fraction = float(self.distances[index] / self.distances[-1])
        return _where(fraction, self.name, self.frame.text(self.positions[index]))


def joint_path(
    kinematics: Kinematics,
    start: Array,
    run: Run,
    name: str = 'the way',
    checkpoint: Checkpoint = lambda: None,
    frame: ShownFrame = BASE_LINK,
) -> JointPath:
    """Return the joint positions along a run from the joint positions `start`, shape (n,).

    Raises PathError if a pose has no solution near the previous solution: the pose is out of reach
    or beyond a joint limit, or the path passes a singularity. Raises KinematicsError if the arm
    has no closed-form inverse kinematics.
    """
    counts = [
        max(ceil(part.length / STEP_M), ceil(part.angle / STEP_RAD), MIN_STEPS)
        for part in run.parts
    ]
    if sum(counts) > MAX_STEPS:
        raise PathError(f'the path is longer than {MAX_STEPS} steps of {STEP_M * 1e3:g} mm')
    samples = [
        np.linspace(*seams, count, endpoint=False)
        for seams, count in zip(pairwise(run.seams), counts, strict=True)
    ]
    pending = np.concatenate([*samples, run.seams[-1:]]).tolist()[::-1]
    total = pending[0]
    minimum = float(np.min(np.diff(pending[::-1]))) / MAX_SUBDIVISION
    visited: list[float] = []
    rows: list[Array] = []
    positions: list[Array] = []
    previous = start
    while pending:
        checkpoint()
        distance = pending[-1]
        pose = run.pose(distance)
        where = _where(distance / total, name, frame.text(pose[:3, 3]))
        solutions = kinematics.inverse(pose, previous)
        if not len(solutions):
            if why := kinematics.why_unreachable(pose):
                raise PathError(f'no joint positions for the pose {where}: {why}')
            raise PathError(_unreachable_reason(kinematics, previous, where))
        step = np.abs(solutions[0] - previous)
        joint = int(np.argmax(step))
        if step[joint] > MAX_JOINT_STEP:
            if visited and distance - visited[-1] > minimum:
                pending.append((visited[-1] + distance) / 2.0)
                continue
            names, units = kinematics.model.limits.names, kinematics.model.limits.units
            raise PathError(
                f'near a singularity, or at a limit, {where}: {names[joint]} would '
                f'have to jump from {previous[joint]:.4g} to {solutions[0][joint]:.4g} '
                f'{units[joint]}'
            )
        visited.append(pending.pop())
        previous = solutions[0]
        rows.append(previous)
        positions.append(pose[:3, 3])
    distances, joints = np.array(visited), np.array(rows)

    def joints_at(queried: Array) -> Array:
        guesses = np.array([np.interp(queried, distances, column) for column in joints.T]).T
        exact = np.empty_like(guesses)
        for index, (distance, guess) in enumerate(zip(queried.tolist(), guesses, strict=True)):
            checkpoint()
            solutions = kinematics.inverse(run.pose(distance), guess)
            if not len(solutions) or np.max(np.abs(solutions[0] - guess)) > MAX_JOINT_STEP:
                raise PathError(
                    f'no joint positions near the previous ones at '
                    f'{distance / distances[-1] * 100.0:.3g} % of {name}'
                )
            exact[index] = solutions[0]
        return exact

    return JointPath(
        name, kinematics, distances, joints, np.array(positions), joints_at, checkpoint, frame
    )


def _where(fraction: float, name: str, position: str) -> str:
    return f'{fraction * 100.0:.0f} % of {name}, at {position}'


def _unreachable_reason(kinematics: Kinematics, previous: Array, where: str) -> str:
    limits = kinematics.model.limits
    margin = np.minimum(previous - limits.position_min, limits.position_max - previous)
    joint = int(np.argmin(margin))
    if margin[joint] > MAX_JOINT_STEP:
        return f'out of reach {where}'
    return (
        f'out of reach {where}: {limits.names[joint]} is at {previous[joint]:.4g} just before, '
        f'its limits are {limits.position_min[joint]:.4g} … {limits.position_max[joint]:.4g} '
        f'{limits.units[joint]}'
    )
