# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Where an arm works: its table, its gripper, and the position in which it begins and ends.

Lengths grow with the arm. A SCARA's shaft moves up and down a little only: its table is as high as
its gripper reaches, below the foot or far below a base that hangs, and pillars are lower than its
arms, so that the hand has to go around them.
"""

from dataclasses import dataclass
from math import cos, pi, sqrt

import numpy as np

from epson_driver.motion import Array
from epson_driver.planning.shapes import Box
from epson_driver.robots import RobotModel
from epson_driver.robots.kinematics import Kinematics
from epson_driver.robots.model import SCARA, SIX_AXIS
from epson_driver.robots.scara import scara_parameters

REACH_OF_SIZE_1_M = {SIX_AXIS: 0.665, SCARA: 0.6}
"""Reach of an arm whose size is 1, m: the C3's, and that of a SCARA for the same table."""

HOME_RAD = (0.0, pi / 6, -pi / 12, 0.0, -7 * pi / 12, 0.0)
"""Where a six-axis arm begins and ends, rad: leaning back, the tool down."""

FOLDED_RAD = np.radians(50.0)
"""At the elbow of a SCARA at home, rad: the hand is in front, nearer than the pillars."""

GRIPPER_LENGTH_M, GRIPPER_RADIUS_M = 0.08, 0.018
"""A suction cup, m, for an arm of size 1: no product, just something that grips from above."""

MIN_PART_HEIGHT_M = 0.03
"""The lowest part, m, for an arm of size 1."""

PILLAR_HEIGHTS_M = (0.3, 0.55)
"""Of pillars around a six-axis arm of size 1, m."""

STROKE_MARGIN_M = 0.005
"""So far from the ends of its stroke a SCARA's shaft stays, m."""

TABLE = 'table'


@dataclass(frozen=True, eq=False)
class Hand:
    """A gripper, m. frame: its pose in tool0, shape (4, 4); its z points to the part."""

    length: float
    radius: float
    frame: Array


@dataclass(frozen=True, eq=False)
class Workspace:
    """What tasks and scenes of one arm have in common; heights in base_link, m.

    size: lengths of a task are those for the C3 times this. home: joints, shape (n,). fixed: the
    table, whose top is at `table`, and what the arm stands on or hangs from. pillars: lowest and
    highest, above the table. metric: JointLimits.rad_per_unit, shape (n,).
    """

    size: float
    home: Array
    hand: Hand
    table: float
    fixed: tuple[Box, ...]
    pillars: tuple[float, float]
    metric: Array


def workspace(model: RobotModel) -> Workspace:
    """Return the workspace of a model. Raises ValueError if it is neither six-axis nor a SCARA."""
    if model.kind not in REACH_OF_SIZE_1_M:
        kinds = ' or '.join(REACH_OF_SIZE_1_M)
        raise ValueError(f'{model.name} ({model.kind}): tasks are drawn for {kinds} arms')
    size = round(float(model.reach[0]) / REACH_OF_SIZE_1_M[model.kind], 6)
    metric = model.limits.rad_per_unit
    length, radius = size * GRIPPER_LENGTH_M, size * GRIPPER_RADIUS_M
    if model.kind == SIX_AXIS:
        low, high = PILLAR_HEIGHTS_M
        return Workspace(
            size,
            np.array(HOME_RAD),
            Hand(length, radius, np.eye(4)),
            0.0,
            (_table(size, 0.0, depth=1.3, ahead=0.15),),
            (size * low, size * high),
            metric,
        )
    lengths = scara_parameters(model).lengths
    lowest, highest = _heights(model, lengths['height'])
    lower = lowest - size * MIN_PART_HEIGHT_M  # the lowest part stands so far below tool0, or more
    hangs = model.chain.origins[1, 2] < 0.0
    if not hangs:
        length = max(length, lower)  # the table is no higher than the foot
    hand = Hand(length, radius, np.diag([1.0, -1.0, -1.0, 1.0]))
    table = lower - length
    one, two = lengths['arm_1'], lengths['arm_2']
    away = sqrt(one**2 + two**2 - 2.0 * one * two * cos(FOLDED_RAD))
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[:3, 3] = away, 0.0, highest
    home = Kinematics(model, hand.frame).inverse(pose)[0]
    depth, ahead = (1.6, 0.0) if hangs else (1.3, 0.15)
    held_up = _gantry(model, table) if hangs else _stand(model, table)
    return Workspace(
        size,
        home,
        hand,
        table,
        (_table(size, table, depth=depth, ahead=ahead), *held_up),
        (highest - 0.75 * length - table, highest - table),
        metric,
    )


def _heights(model: RobotModel, height: float) -> tuple[float, float]:
    """Return the lowest and the highest z of a SCARA's tool0, m; `height`: with its shaft at 0."""
    up = model.chain.axes[2, 2]
    ends = np.array([model.limits.position_min[2], model.limits.position_max[2]])
    low, high = np.sort(height + up * ends)
    return float(low) + STROKE_MARGIN_M, float(high) - STROKE_MARGIN_M


def _table(size: float, top: float, *, depth: float, ahead: float) -> Box:
    thick = size * 0.03
    return Box(TABLE, (size * depth, size * 1.4, thick), (size * ahead, 0.0, top - thick / 2))


def _stand(model: RobotModel, table: float) -> tuple[Box, ...]:
    """Return what lifts the foot of a SCARA above its table."""
    if table > -1e-3:
        return ()
    # as large as the foot, which generate/scara_links.py makes in proportion to this
    size = float(np.clip(sqrt(model.chain.origins[0, 2] / 0.156), 0.8, 1.4))
    return (Box('stand', (size * 0.23, size * 0.145, -table), (size * -0.04, 0.0, table / 2)),)


def _gantry(model: RobotModel, table: float) -> tuple[Box, ...]:
    """Return what a SCARA hangs from: a beam above its base, and a post behind it."""
    size = float(np.clip(sqrt(np.linalg.norm(model.chain.origins[2, :2]) / 0.175), 0.8, 1.4))
    under = float(model.chain.origins[0, 2]) + size * 0.101  # where the base plate ends
    thick, wide, behind = 0.04, size * 0.2, 1.15 * float(model.reach[0])
    tall, middle = under + thick - table, wide / 4 - behind / 2
    return (
        Box('beam', (behind + wide / 2, wide, thick), (middle, 0.0, under + thick / 2)),
        Box('post', (thick, wide, tall), (-behind - thick / 2, 0.0, table + tall / 2)),
    )
