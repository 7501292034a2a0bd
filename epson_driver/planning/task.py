# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A pick-and-place task drawn from a seed.

A part on one side of the robot, its place on the other, trays, and pillars between them.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from math import cos, hypot, pi, sin

import numpy as np

from epson_driver.motion import Array
from epson_driver.planning.shapes import Cylinder, Shape, lifted, standing, tray
from epson_driver.planning.workspace import (
    GRIPPER_LENGTH_M,
    PART_HEIGHTS_M,
    TABLE,
    TRAY_M,
    Workspace,
    workspace,
)
from epson_driver.robots import RobotModel
from epson_driver.robots.kinematics import Kinematics

# Lengths in m for an arm of size 1 (workspace.py); those of a task are multiplied by the arm's.

REACH_M = (0.30, 0.46)
"""The part's distance from joint 1's axis."""

PILLAR_TO_PART_M, PILLAR_TO_PILLAR_M = 0.24, 0.11
"""From the middle of a pillar to the part and its place, and to other pillars: beside the widest
tray and the widest pillar some room is left for the hand."""


@dataclass(frozen=True, eq=False)
class Task:
    """One pick and place. Poses of the hand in base_link when it grips and lets go, (4, 4), m.

    `part`: its size, m, with a square base, so that every quarter turn of the hand will do.
    `supports`: names of what the part may stand on.
    """

    seed: int
    part: tuple[float, float, float]
    pick: Array
    place: Array
    obstacles: tuple[Shape, ...]
    supports: tuple[str, ...]


def draw_task(seed: int, model: RobotModel) -> Task:
    """Return the task of a seed for an arm, the same one for the same seed.

    Raises ValueError for a model that is neither six-axis nor a SCARA, or KinematicsError.
    """
    work = workspace(model)
    size, arm = work.size, Kinematics(model, work.hand.frame)
    random = np.random.default_rng(seed)
    width = size * random.uniform(0.035, 0.05)
    height = size * random.uniform(*PART_HEIGHTS_M)
    side = random.choice((-1.0, 1.0))
    obstacles: list[Shape] = []
    supports = [TABLE]
    poses, spots = [], []
    for name, sign in (('pick', side), ('place', -side)):
        for _ in range(100):  # an arm that turns less to one side reaches some places only
            angle = sign * random.uniform(0.6, 1.35)
            radius = size * random.uniform(*REACH_M)
            x, y = _around(work, angle, radius)
            if len(arm.inverse(gripping(x, y, work.table + height, 0.0, work.hand.length))):
                break
        yaw = random.uniform(-pi / 4, pi / 4)
        floor = 0.0
        if random.random() < 0.6:
            inside, tall = size * random.uniform(0.15, 0.2), size * random.uniform(0.04, 0.09)
            parts = tray(f'{name} tray', inside, tall, size * TRAY_M, x, y, yaw)
            obstacles += parts
            supports.append(parts[0].name)
            floor = parts[0].size[2]
        poses.append(gripping(x, y, work.table + floor + height, yaw, work.hand.length))
        spots.append((x, y))
    pillars: list[Shape] = []
    wanted = int(random.integers(2, 4))
    for _ in range(100):  # of some tasks there is no room for all of them
        pillar = _pillar(f'pillar {len(pillars) + 1}', work, random)
        others = [(other.centre[0], other.centre[1]) for other in pillars]
        if _far(pillar, spots, size * PILLAR_TO_PART_M) and _far(
            pillar, others, size * PILLAR_TO_PILLAR_M
        ):
            pillars.append(pillar)
        if len(pillars) == wanted:
            break
    standing_there = tuple(lifted(shape, work.table) for shape in (*obstacles, *pillars))
    return Task(seed, (width, width, height), poses[0], poses[1], standing_there, tuple(supports))


def _pillar(name: str, work: Workspace, random: np.random.Generator) -> Shape:
    """Return something tall in front of the robot, round or square."""
    angle, radius = random.uniform(-0.35, 0.35), work.size * random.uniform(0.36, 0.5)
    width, height = work.size * random.uniform(0.05, 0.1), random.uniform(*work.pillars)
    x, y = _around(work, angle, radius)
    if random.random() < 0.5:
        return Cylinder(name, width / 2, height, (x, y, height / 2))
    return standing(name, (width, width, height), x, y)


def _around(work: Workspace, angle: float, radius: float) -> tuple[float, float]:
    """Return the place at a distance from joint 1's axis, m, in a direction."""
    x, y = work.middle
    return x + radius * cos(angle), y + radius * sin(angle)


def _far(pillar: Shape, places: Iterable[tuple[float, float]], distance: float) -> bool:
    """Return whether a pillar's middle is further than `distance` from all places, m."""
    x, y, _ = pillar.centre
    return all(hypot(x - other[0], y - other[1]) > distance for other in places)


def gripping(
    x: float, y: float, top: float, yaw: float, length: float = GRIPPER_LENGTH_M
) -> Array:
    """Return the pose, (4, 4), of a hand that grips from above an object with its top at `top`.

    length: of its gripper, m; by default that of an arm of size 1.
    """
    pose = np.eye(4)
    pose[:3, :3] = [[cos(yaw), sin(yaw), 0.0], [sin(yaw), -cos(yaw), 0.0], [0.0, 0.0, -1.0]]
    pose[:3, 3] = x, y, top + length
    return pose


def raised(pose: Array, height: float) -> Array:
    """Return the pose raised by `height`, m."""
    higher = pose.copy()
    higher[2, 3] += height
    return higher


def quarter_turns(pose: Array) -> list[Array]:
    """Return a pose and those turned by a quarter, a half and three quarters about its own z."""
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    turned = [pose]
    for _ in range(3):
        next_pose = turned[-1].copy()
        next_pose[:3, :3] = next_pose[:3, :3] @ quarter
        turned.append(next_pose)
    return turned
