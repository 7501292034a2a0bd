# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Inverse kinematics of a six-axis arm with an ortho-parallel basis and a spherical wrist (OPW).

The closed form is from M. Brandstötter, A. Angerer and M. Hofbaur: An Analytical Solution of the
Inverse Kinematics Problem of Industrial Serial Manipulators with an Ortho-parallel Basis and a
Spherical Wrist, 2014.

The seven lengths of the closed form are computed from the chain, so a model file contains each
length once. With all angles of the closed form 0, the arm is upright and the tool frame is
parallel to base_link. The joints of the model differ by sign and offset: angle = sign · joint -
offset.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from math import acos, atan2, copysign, cos, hypot, pi, sin, sqrt

import numpy as np

from epson_driver.motion import Array
from epson_driver.robots.chain import REVOLUTE, rotation_about
from epson_driver.robots.model import RobotModel

TOLERANCE = 1e-9
"""Tolerance for parallel axes (1 - cosine), and for intersecting axes (m)."""


STRAIGHT_WRIST_RAD = 2e-6
"""Angle of joint 5, rad, below which only the sum of the angles of joints 4 and 6 matters. The
error of the solution is at most this angle."""

ROUNDING = 1e-12
"""Relative rounding tolerance of the wrist's distance from joint 1's axis."""

EDGE_M = 2e-6
"""Distance beyond the edge of the workspace that counts as reachable, m. RC+ rounds coordinates to
0.001 mm and 0.001°, so the coordinates of a stretched arm may be slightly outside."""


class KinematicsError(ValueError):
    """A model whose chain has no closed-form inverse, with the reason as its text."""


_Y, _Z = np.eye(3)[1:]


@dataclass(frozen=True)
class OpwParameters:
    """The parameters of the closed form.

    * lengths, m: a1 is from joint 1's axis to joint 2's axis, a2 the elbow offset, b the sideways
      offset of the wrist, c1 the height of joint 2, c2 the upper arm, c3 from the elbow to the
      wrist, and c4 from the wrist to Tool 0.
    * offsets, signs: offset, rad, and sign, 1 or -1, of each joint.
    """

    lengths: dict[str, float]
    offsets: tuple[float, ...]
    signs: tuple[int, ...]


def opw_parameters(model: RobotModel) -> OpwParameters:
    """Return a model's parameters.

    Raises KinematicsError if the arm has no closed-form inverse.
    """
    _check_joints(model)
    axes = model.chain.axes
    origins = np.cumsum(model.chain.origins, axis=0)
    _check_axes(model, origins[0])
    tool = origins[5] + model.tool0.xyz
    # the wrist's centre is on joint 5's axis, and joint 4's axis determines where
    wrist = origins[4] + _Y * ((origins[3] - origins[4]) @ _Y)
    for joint in (3, 5):
        _check_on_axis(model, joint, origins[joint], wrist, 'where joints 4, 5 and 6 should meet')
    _check_on_axis(model, 5, origins[5], tool, 'Tool 0')
    upper = (origins[2] - origins[1]) * (1.0, 0.0, 1.0)
    lower, hand = wrist - origins[2], tool - wrist
    if min(np.linalg.norm(upper), np.linalg.norm(hand)) < TOLERANCE:
        raise _no_opw(model, 'the upper arm or the hand has no length')
    fore = axes[3] if axes[3] @ lower >= 0.0 else -axes[3]
    out = hand / np.linalg.norm(hand)
    standing, for_folding_arm, pointing = _from_up(upper), _from_up(fore), _from_up(out)
    rest = rotation_about(_Y, pointing).T @ model.tool0.matrix[:3, :3]  # what joint 6 has to turn
    if abs(rest[2, 2] - 1.0) > TOLERANCE:
        raise _no_opw(model, 'the z axis of tool0 is not along joint 6')
    turned = float(np.arctan2(rest[1, 0], rest[0, 0]))
    across = np.cross(_Y, fore)
    directions = (_Z, _Y, _Y, fore, _Y, out)
    return OpwParameters(
        lengths={
            'a1': float(origins[1][0]),
            'a2': float(lower @ across),
            'b': float(wrist[1]),
            'c1': float(origins[1][2]),
            'c2': float(np.linalg.norm(upper)),
            'c3': float(lower @ fore),
            'c4': float(np.linalg.norm(hand)),
        },
        offsets=(
            0.0,
            -standing,
            standing - for_folding_arm,
            0.0,
            for_folding_arm - pointing,
            -turned,
        ),
        signs=tuple(round(a @ direction) for a, direction in zip(axes, directions, strict=True)),
    )


def _check_joints(model: RobotModel) -> None:
    for name, kind in zip(model.joint_names, model.joint_types, strict=True):
        if kind != REVOLUTE:
            raise _no_opw(model, f'{name} is {kind}')
    if len(model.joint_names) != 6:
        raise _no_opw(model, f'it has {len(model.joint_names)} joints')


def _check_axes(model: RobotModel, first: Array) -> None:
    axes = model.chain.axes
    for joint, along, letter in ((0, _Z, 'z'), (1, _Y, 'y'), (2, _Y, 'y'), (4, _Y, 'y')):
        if abs(abs(axes[joint] @ along) - 1.0) > TOLERANCE:
            raise _no_opw(model, f'the axis of joint {joint + 1} is not parallel to {letter}')
    if float(np.hypot(first[0], first[1])) > TOLERANCE:
        raise _no_opw(model, 'the axis of joint 1 does not pass through base_link')
    if abs(axes[3] @ _Y) > TOLERANCE:
        raise _no_opw(model, "the axis of joint 4 is not in the arm's plane")


def _check_on_axis(model: RobotModel, joint: int, origin: Array, point: Array, what: str) -> None:
    away = float(np.linalg.norm(np.cross(model.chain.axes[joint], point - origin)))
    if away > TOLERANCE:
        raise _no_opw(model, f'{what} is {away:g} m off the axis of joint {joint + 1}')


def _no_opw(model: RobotModel, reason: str) -> KinematicsError:
    return KinematicsError(
        f'{model.name}: no inverse kinematics, because it is not an upright six-axis arm '
        f'with a spherical wrist: {reason}'
    )


def _from_up(direction: Array) -> float:
    """Return the angle about y that rotates z to a direction in the arm's plane, rad."""
    return float(np.arctan2(direction[0], direction[2]))


class OpwSolver:
    def __init__(self, model: RobotModel) -> None:
        parameters = opw_parameters(model)
        self._lengths = parameters.lengths
        self._signs, self._offsets = np.array(parameters.signs), np.array(parameters.offsets)

    def why_unreachable(self, _pose: Array) -> str:
        return ''

    def sides(self, joints: Array) -> tuple[float, ...]:
        """Return the wrist's distance in front of joint 1's axis, m, and bends of elbow and wrist.

        Their signs are inverted if the arm is upside down.
        """
        _, second, third, _, fifth, _ = (self._signs * joints - self._offsets).tolist()
        a1, a2, _, c1, c2, c3, _ = self._lengths.values()
        bend = (third + atan2(a2, c3) + pi) % (2.0 * pi) - pi
        front = a1 + c2 * sin(second) + hypot(a2, c3) * sin(second + bend)
        upright = copysign(1.0, c1)
        return front, upright * copysign(bend, bend * front), upright * fifth

    def branches(self, pose: Array, near: Array) -> list[Array]:
        """Return up to eight solutions, regardless of the joint limits.

        Some solutions may be equal.
        """
        first, _, _, fourth, _, _ = (self._signs * near - self._offsets).tolist()
        angles = [
            (*arm, *wrist)
            for arm in self._arms(pose[:3, 3] - self._lengths['c4'] * pose[:3, 2], first)
            for wrist in _wrists(arm, pose[:3, :3], fourth)
        ]
        return [self._signs * (np.array(angle) + self._offsets) for angle in angles]

    def _arms(self, wrist: Array, free: float) -> Iterator[tuple[float, float, float]]:
        """Yield the angles of joints 1 to 3 that bring the wrist's centre to a position."""
        a1, a2, b, c1, c2, c3, _ = self._lengths.values()
        x, y, up = float(wrist[0]), float(wrist[1]), float(wrist[2]) - c1
        square = x * x + y * y - b * b
        if square < -ROUNDING * (x * x + y * y + b * b):
            return
        out = sqrt(max(square, 0.0))
        around = atan2(y, x) if hypot(x, y) > TOLERANCE else free
        fore, elbow = hypot(a2, c3), atan2(a2, c3)
        for first, ahead in (
            (around - atan2(b, out), out - a1),
            (around + atan2(b, out) - pi, -out - a1),  # over the shoulder
        ):
            away = hypot(ahead, up)
            if not abs(c2 - fore) - EDGE_M <= away <= c2 + fore + EDGE_M:
                continue
            bend = (away * away - c2 * c2 - fore * fore) / (2.0 * c2 * fore)
            third = acos(min(max(bend, -1.0), 1.0))
            for turn in (third, -third):
                second = atan2(ahead, up) - atan2(fore * sin(turn), c2 + fore * cos(turn))
                yield first, second, turn - elbow


def _wrists(
    arm: tuple[float, float, float], turn: Array, fourth: float
) -> Iterator[tuple[float, float, float]]:
    """Yield the angles of joints 4 to 6 that give the hand the orientation `turn`.

    `fourth`: angle of joint 4 if the wrist is straight, because any angle is then possible.
    """
    (c1, s1), (c23, s23) = ((cos(item), sin(item)) for item in (arm[0], arm[1] + arm[2]))
    forearm = np.array([[c1 * c23, s1 * c23, -s23], [-s1, c1, 0.0], [c1 * s23, s1 * s23, c23]])
    r = (forearm @ turn).tolist()
    fifth = atan2(hypot(r[0][2], r[1][2]), r[2][2])
    if fifth < STRAIGHT_WRIST_RAD:
        yield fourth, 0.0, atan2(r[1][0], r[1][1]) - fourth
        return
    a, b = atan2(r[1][2], r[0][2]), atan2(r[2][1], -r[2][0])
    yield a, fifth, b
    yield a + pi, -fifth, b + pi
