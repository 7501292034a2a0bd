# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The seven lengths of a six-axis arm with an ortho-parallel basis and a spherical wrist (OPW).

They follow from the chain, so a model file has each length once. In the OPW pose, all angles 0,
the arm stands upright and the tool frame is parallel to base_link; the model's zero pose differs
from it by the offsets: angle = sign · joint - offset.
"""

from dataclasses import dataclass

import numpy as np

from epson_driver.motion import Array
from epson_driver.robots.chain import REVOLUTE, rotation_about
from epson_driver.robots.model import RobotModel

TOLERANCE = 1e-9
"""How far axes may be from parallel (1 - cosine) or from crossing each other (m)."""


class KinematicsError(ValueError):
    """A model whose chain has no closed-form inverse. The text says why."""


_Y, _Z = np.eye(3)[1:]


@dataclass(frozen=True)
class OpwParameters:
    """The parameters of the closed form.

    lengths, m: a1 from joint 1's axis to joint 2's, a2 elbow offset, b sideways offset of the
    wrist, c1 height of joint 2, c2 upper arm, c3 elbow to wrist, c4 wrist to Tool 0. offsets: rad,
    one per joint. signs: 1 or -1, one per joint.
    """

    lengths: dict[str, float]
    offsets: tuple[float, ...]
    signs: tuple[int, ...]


def opw_parameters(model: RobotModel) -> OpwParameters:
    """Return the OPW lengths of a model. Raises KinematicsError that says why it has none."""
    _check_joints(model)
    axes = model.chain.axes
    at = np.cumsum(model.chain.origins, axis=0)
    _check_axes(model, at[0])
    tool = at[5] + model.tool0.xyz
    # the wrist's centre is somewhere along joint 5's axis; joint 4's axis tells where
    wrist = at[4] + _Y * ((at[3] - at[4]) @ _Y)
    for joint in (3, 5):
        _check_on_axis(model, joint, at[joint], wrist, 'where joints 4, 5 and 6 should meet')
    _check_on_axis(model, 5, at[5], tool, 'Tool 0')
    upper, lower, hand = (at[2] - at[1]) * (1.0, 0.0, 1.0), wrist - at[2], tool - wrist
    if min(np.linalg.norm(upper), np.linalg.norm(hand)) < TOLERANCE:
        raise _no_opw(model, 'the upper arm or the hand has no length')
    fore = axes[3] if axes[3] @ lower >= 0.0 else -axes[3]
    out = hand / np.linalg.norm(hand)
    standing, bent, pointing = _from_up(upper), _from_up(fore), _from_up(out)
    rest = rotation_about(_Y, pointing).T @ model.tool0.matrix[:3, :3]  # what joint 6 has to turn
    if abs(rest[2, 2] - 1.0) > TOLERANCE:
        raise _no_opw(model, 'the z axis of tool0 is not along joint 6')
    turned = float(np.arctan2(rest[1, 0], rest[0, 0]))
    across = np.cross(_Y, fore)
    directions = (_Z, _Y, _Y, fore, _Y, out)
    return OpwParameters(
        lengths={
            'a1': float(at[1][0]),
            'a2': float(lower @ across),
            'b': float(wrist[1]),
            'c1': float(at[1][2]),
            'c2': float(np.linalg.norm(upper)),
            'c3': float(lower @ fore),
            'c4': float(np.linalg.norm(hand)),
        },
        offsets=(0.0, -standing, standing - bent, 0.0, bent - pointing, -turned),
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
        f'{model.name}: no inverse kinematics, as its chain is not that of an upright six-axis '
        f'arm with a spherical wrist: {reason}'
    )


def _from_up(direction: Array) -> float:
    """Return the angle about y that turns z into a direction in the arm's plane, rad."""
    return float(np.arctan2(direction[0], direction[2]))
