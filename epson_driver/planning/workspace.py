# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Where an arm works: its table, its gripper, and the position in which it begins and ends.

Lengths grow with the arm. One that hangs has its table far below its base. A SCARA's shaft moves
up and down a little only: its table is as high as its gripper reaches, and pillars are lower than
its arms, so that the hand has to go around them.
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
"""Where a six-axis arm begins and ends, rad, if its upper arm is upright at zero: leaning back,
the tool down."""

HUNG_SHOULDER_M = 0.45
"""How high joint 2 of a six-axis arm that hangs is above the table, m, for an arm of size 1."""

HUNG_HOME_M, HUNG_RAD = (0.24, 0.22), (0.0, pi / 6, -pi / 3, 0.0, 2 * pi / 3, 0.0)
"""Where tool0 of such an arm begins and ends, m: in front of joint 1's axis and above the table,
for an arm of size 1; and joints near there, rad."""

HUNG_PILLAR_HEIGHTS_M = (0.25, 0.42)
"""Of pillars under such an arm, m, for an arm of size 1."""

FOLDED_RAD, FOLD_MARGIN_RAD = np.radians((50.0, 5.0))
"""At the elbow of a SCARA at home, rad, the hand in front, nearer than the pillars; where joint 2
does not turn so far, so much less than it can."""

GRIPPER_LENGTH_M, GRIPPER_RADIUS_M = 0.08, 0.018
"""A suction cup, m, for an arm of size 1: no product, just something that grips from above."""

PART_HEIGHTS_M = (0.03, 0.07)
"""Of the lowest and the highest part, m, for an arm of size 1."""

TRAY_M = 0.006
"""How thick the floor and walls of a tray are, m, for an arm of size 1."""

APPROACH_M = 0.10
"""From so far above the arm goes straight down to the part, and straight up again, m, for an arm
of size 1; a SCARA from where its stroke ends if that is lower.
"""

PILLAR_HEIGHTS_M = (0.3, 0.55)
"""Of pillars around a six-axis arm of size 1, m."""

STROKE_MARGIN_M = 0.005
"""So far from the ends of its stroke a SCARA's shaft stays, m."""

TABLE = 'table'


@dataclass(frozen=True, eq=False)
class Hand:
    """A gripper, m. frame: its pose in tool0, shape (4, 4), with z to the part."""

    length: float
    radius: float
    frame: Array


@dataclass(frozen=True, eq=False)
class Workspace:
    """The workspace that tasks and scenes of one arm share, with heights in base_link, m.

    size: lengths of a task are those for the C3 times this. middle: x and y of joint 1's axis,
    about which tasks are drawn. home: joints, shape (n,). fixed: the table, whose top is at
    `table`, and what the arm stands on or hangs from. pillars: lowest and highest, above the
    table. approach: from so far above the arm goes straight down. metric:
    JointLimits.rad_per_unit, shape (n,).
    """

    size: float
    middle: tuple[float, float]
    home: Array
    hand: Hand
    table: float
    fixed: tuple[Box, ...]
    pillars: tuple[float, float]
    approach: float
    metric: Array


def workspace(model: RobotModel) -> Workspace:
    """Return the workspace of a model. Raises ValueError if it is neither six-axis nor a SCARA."""
    if model.kind not in REACH_OF_SIZE_1_M:
        kinds = ' or '.join(REACH_OF_SIZE_1_M)
        raise ValueError(f'{model.name} ({model.kind}): tasks are drawn for {kinds} arms')
    return (_six_axis if model.kind == SIX_AXIS else _scara)(model)


def _six_axis(model: RobotModel) -> Workspace:
    size = _size(model)
    x, y, _ = map(float, model.chain.origins[0])
    shoulder = float(model.chain.origins[:2, 2].sum())
    hand = Hand(size * GRIPPER_LENGTH_M, size * GRIPPER_RADIUS_M, np.eye(4))
    if shoulder > 0.0:
        home, table, pillars = model.bent(HOME_RAD), 0.0, PILLAR_HEIGHTS_M
        fixed: tuple[Box, ...] = (_table(size, (x + 0.15 * size, y, table), 1.3),)
    else:
        table, pillars = shoulder - size * HUNG_SHOULDER_M, HUNG_PILLAR_HEIGHTS_M
        pose = np.diag([1.0, -1.0, -1.0, 1.0])
        pose[:3, 3] = x + size * HUNG_HOME_M[0], y, table + size * HUNG_HOME_M[1]
        home = Kinematics(model).inverse(pose, np.array(HUNG_RAD))[0]
        fixed = (_table(size, (x, y, table), 1.6), *_gantry(model, table))
    low, high = pillars
    return Workspace(
        size,
        (x, y),
        home,
        hand,
        table,
        fixed,
        (size * low, size * high),
        size * APPROACH_M,
        model.limits.rad_per_unit,
    )


def _scara(model: RobotModel) -> Workspace:
    size = _size(model)
    x, y, _ = map(float, model.chain.origins[0])
    lengths = scara_parameters(model).lengths
    lowest, highest = _heights(model, lengths['height'])
    lower = lowest - size * PART_HEIGHTS_M[0]  # the lowest part stands so far below tool0, or more
    length, hangs = size * GRIPPER_LENGTH_M, lengths['height'] < 0.0
    if not hangs:
        length = max(length, lower)  # the table is no higher than the foot
    hand = Hand(length, size * GRIPPER_RADIUS_M, np.diag([1.0, -1.0, -1.0, 1.0]))
    table = lower - length
    one, two = lengths['arm_1'], lengths['arm_2']
    farthest = float(max(-model.limits.position_min[1], model.limits.position_max[1]))
    folded = max(FOLDED_RAD, pi - farthest + FOLD_MARGIN_RAD)
    away = sqrt(one**2 + two**2 - 2.0 * one * two * cos(folded))
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[:3, 3] = x + away, y, highest
    home = Kinematics(model, hand.frame).inverse(pose)[0]
    if hangs:
        fixed = (_table(size, (x, y, table), 1.6), *_gantry(model, table))
    else:
        fixed = (_table(size, (x + 0.15 * size, y, table), 1.3), *_stand(model, table))
    return Workspace(
        size,
        (x, y),
        home,
        hand,
        table,
        fixed,
        (highest - 0.75 * length - table, highest - table),
        min(size * APPROACH_M, highest - lower - size * (PART_HEIGHTS_M[1] + TRAY_M)),
        model.limits.rad_per_unit,
    )


def _size(model: RobotModel) -> float:
    return round(float(model.reach[0]) / REACH_OF_SIZE_1_M[model.kind], 6)


def _heights(model: RobotModel, height: float) -> tuple[float, float]:
    """Return the lowest and highest z of a SCARA's tool0, m, from the `height` at 0."""
    up = model.chain.axes[2, 2]
    ends = np.array([model.limits.position_min[2], model.limits.position_max[2]])
    low, high = np.sort(height + up * ends)
    return float(low) + STROKE_MARGIN_M, float(high) - STROKE_MARGIN_M


def _table(size: float, top: tuple[float, float, float], depth: float) -> Box:
    """Return a table by the middle of its top and its depth for an arm of size 1."""
    x, y, z = top
    thick = size * 0.03
    return Box(TABLE, (size * depth, size * 1.4, thick), (x, y, z - thick / 2))


def _stand(model: RobotModel, table: float) -> tuple[Box, ...]:
    """Return the stand that lifts a SCARA above its table."""
    if table > -1e-3:
        return ()
    # as large as the foot, which urdf/scara.xacro makes in proportion to this
    size = float(np.clip(sqrt(model.chain.origins[0, 2] / 0.156), 0.8, 1.4))
    return (Box('stand', (size * 0.23, size * 0.145, -table), (size * -0.04, 0.0, table / 2)),)


def _gantry(model: RobotModel, table: float) -> tuple[Box, ...]:
    """Return the gantry of a hanging arm: a beam above its base, and a post behind it."""
    x, y, under = map(float, model.chain.origins[0])
    size = float(np.clip(sqrt(np.linalg.norm(model.chain.origins[2, :2]) / 0.175), 0.8, 1.4))
    passes_under = model.kind == SCARA and model.chain.origins[1, 2] < 0.0
    under = under + size * 0.101 if passes_under else 0.0  # the base plate, as urdf/ makes it
    thick, wide, behind = 0.04, size * 0.2, 1.15 * float(model.reach[0])
    tall, middle = under + thick - table, wide / 4 - behind / 2
    return (
        Box('beam', (behind + wide / 2, wide, thick), (x + middle, y, under + thick / 2)),
        Box('post', (thick, wide, tall), (x - behind - thick / 2, y, table + tall / 2)),
    )
