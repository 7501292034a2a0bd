# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Closed-form inverse kinematics of a SCARA: two arms, a vertical axis, and rotation of the tool.

All four axes are vertical, so the tool stays upright. Seen from above, the two arms and the line
from the first axis to the tool form a triangle. A reachable position therefore has two solutions,
with the elbow on one side or on the other.
"""

from dataclasses import dataclass

import numpy as np

from epson_driver.motion import Array
from epson_driver.robots.model import RobotModel
from epson_driver.robots.opw import EDGE_M, TOLERANCE, KinematicsError

UPRIGHT_RAD = 1e-6
"""Maximum tilt of a pose that counts as upright, rad. The solution ignores the tilt."""


@dataclass(frozen=True)
class ScaraParameters:
    """Parameters of the closed form.

    * lengths: lengths of both arms, seen from above, and height of link_4 at the zero pose, m.
    * base: position of joint 1's axis as a complex number x + iy, m.
    * arms: vectors of both arms at the zero pose, as complex numbers x + iy, m.
    * signs: 1 for each joint whose axis points up, else -1.
    """

    lengths: dict[str, float]
    base: complex
    arms: tuple[complex, complex]
    signs: tuple[int, ...]


def scara_parameters(model: RobotModel) -> ScaraParameters:
    """Return a SCARA's parameters. Raises KinematicsError for another geometry."""
    up = model.chain.axes[:, 2]
    for name, fraction in zip(model.joint_names, np.abs(up), strict=True):
        if abs(fraction - 1.0) > TOLERANCE:
            raise _no_scara(model, f'the axis of {name} is not vertical')
    origins = model.chain.origins
    places = (origins[0], origins[1], origins[2:].sum(axis=0))
    base, first, second = (complex(x, y) for x, y, _ in places)
    if min(abs(first), abs(second)) < TOLERANCE:
        raise _no_scara(model, 'one of its arms has no length')
    return ScaraParameters(
        lengths={
            'arm_1': abs(first),
            'arm_2': abs(second),
            'height': float(origins[:, 2].sum()),
        },
        base=base,
        arms=(first, second),
        signs=tuple(round(fraction) for fraction in up),
    )


class ScaraSolver:
    def __init__(self, model: RobotModel) -> None:
        self._parameters = scara_parameters(model)
        self._from_tool0 = np.linalg.inv(model.tool0.matrix)

    def why_unreachable(self, pose: Array) -> str:
        lean = _lean(pose @ self._from_tool0)
        if lean < UPRIGHT_RAD:
            return ''
        return f'it is tilted by {np.degrees(lean):.3g} degrees, but a SCARA tool stays upright'

    def sides(self, joints: Array) -> tuple[float, ...]:
        return (float(joints[1]),)

    def branches(self, pose: Array, near: Array) -> list[Array]:
        """Return the solutions with the elbow on each side, regardless of the joint limits."""
        last = pose @ self._from_tool0
        if _lean(last) >= UPRIGHT_RAD:
            return []
        known = self._parameters
        first, second = known.arms
        place = complex(last[0, 3], last[1, 3]) - known.base
        away, longest, shortest = abs(place), abs(first) + abs(second), abs(first) - abs(second)
        if not abs(shortest) - EDGE_M <= away <= longest + EDGE_M:
            return []
        # computed from half the angle, which keeps all digits for stretched or folded arms
        bend = 2.0 * np.arctan2(
            np.sqrt(max((longest - away) * (longest + away), 0.0)),
            np.sqrt(max((away - shortest) * (away + shortest), 0.0)),
        )
        facing = np.arctan2(last[1, 0], last[0, 0])
        straight = np.angle(first / second)  # angle of joint 2 that aligns both arms
        solutions = []
        for side in (1.0, -1.0):
            elbow = straight + side * bend
            if away < TOLERANCE:
                shoulder = known.signs[0] * near[0]
            else:
                shoulder = np.angle(place / (first + second * np.exp(1j * elbow)))
            turns = (shoulder, elbow, last[2, 3] - known.lengths['height'])
            joints = np.array([*turns, facing - shoulder - elbow]) * known.signs
            solutions.append(joints)
        return solutions


def _lean(frame: Array) -> float:
    """Return the angle between the z axis of a frame and the vertical, rad."""
    return float(np.arctan2(np.hypot(frame[0, 2], frame[1, 2]), frame[2, 2]))


def _no_scara(model: RobotModel, reason: str) -> KinematicsError:
    return KinematicsError(
        f'{model.name}: no inverse kinematics, because it is not a SCARA: {reason}'
    )
