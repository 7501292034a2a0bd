# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Conversion between the points of a SPEL+ program and joint angles.

A Cartesian point (`XY(…)`) specifies the position and orientation of the tool. Flags specify the
posture of the arm.

The arm follows a line or an arc of the tool exactly. The N series turns its joints as far as
necessary (SING_VSD, SPEL+ manual p158). Other six-axis arms leave the path near a singularity of
the wrist or the hand (SING_THRU, p157), in a way that the manual does not specify. Here such a
path is refused.
"""

import logging
import math
from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from epson_driver.motion import Array
from epson_driver.robots import RobotModel
from epson_driver.robots.chain import REVOLUTE
from epson_driver.robots.kinematics import FULL_TURN, Kinematics, rotation_of_uvw
from epson_driver.robots.model import N_SERIES, RS_SERIES, SCARA, SIX_AXES, robot_type
from epson_driver.robots.opw import KinematicsError
from epson_driver.sim_controller.condition.errors import ErrorNumber, angles_rejection, clipped
from epson_driver.spel import Point, SpelError
from epson_driver.spel.errors import bad, to_add
from epson_driver.spel.functions import POSTURES
from epson_driver.tool_motion.pose_path import PosePath, arc, level_arc, line

UNREACHABLE = 4007
STRAIGHT_RAD = 1e-6
"""Distance from the boundary between two postures within which both postures apply, rad or m."""

_MM = 1000.0
_SIDES = ('hand', 'elbow', 'wrist')
"""Groups of postures, in the order of the values of `Kinematics.sides`.

A SCARA has only `hand`.
"""

_UNDETERMINED = {RS_SERIES: {'j1a': 0}, N_SERIES: {'j1a': 0, 'j4a': 3}}
"""Robot type → flag → joint that the pose may leave undetermined (SPEL+ manual p449, p455)."""

_USUAL = ('j1f0', 'j2f0')  # defaults, which are omitted when a point is shown

NEAREST = 'ljm'
"""Flag of a Cartesian point that the arm reaches in the nearest possible posture."""

_SIX = {1: ('=', '=', '', 'J4'), 2: ('=', '=', '=', ''), 3: ('=', '=', '', 'J5')}
LEAST_MOTION: dict[int, dict[int, tuple[str, str, str, str]]] = {
    SIX_AXES: {**_SIX, 4: ('=', '=', '', 'J6')},
    RS_SERIES: {1: ('', '', '', ''), 2: ('', '', '', '')},
    N_SERIES: {
        1: ('', 'a', '', 'J1 J5'), 2: ('', 'a', '', 'J1 J4'),
        3: _SIX[1], 4: _SIX[2],
        5: ('!', 'a', '', 'J5'), 6: ('!', 'a', '', 'J4'),
        7: ('', 'b', '', 'J1 J5'), 8: ('', 'b', '', 'J1 J4'),
    },
}  # fmt: skip
"""Robot type → LJM number → posture that LJM selects (SPEL+ manual p508).

A row contains hand, elbow and wrist, then the joints that move least in the selected solution.
Hand, elbow and wrist are `=` (the same as at the start of the motion), `!` (the opposite), a flag
(this posture), or empty (any posture).
"""

ASSUMED_PULSES = 10_000.0  # pulses per degree or mm, if the model has no number
_log = logging.getLogger(__name__)


class RobotPoints:
    """Converts points for one robot model with its current tool."""

    def __init__(self, model: RobotModel) -> None:
        self._model = model
        self._kinematics = Kinematics(model)
        self._type = robot_type(model)
        self.tool = 0
        self.tools: dict[int, Point] = {}  # tool number → tool, set by TLSet

    @cached_property
    def pulses_per_unit(self) -> Array:
        """Encoder pulses per rad or m, shape (n,).

        A warning is logged if these numbers are assumed.
        """
        model = self._model
        unknown = np.isnan(model.pulses_per_unit)
        if unknown.any():
            names = ', '.join(np.array(model.joint_names)[unknown])
            text = 'the encoder pulses of %s of the %s are unknown, assuming %g per degree or mm'
            _log.warning(text, names, model.name, ASSUMED_PULSES)
        return np.where(unknown, ASSUMED_PULSES * model.shown_per_unit, model.pulses_per_unit)

    def use(self, tool: int) -> None:
        if tool and tool not in self.tools:
            advice = to_add('tools', f'{tool}: [X, Y, Z, U]')
            raise bad('Tool', f'{tool} is not defined: use TLSet, or {advice}')
        self._kinematics = Kinematics(self._model, _matrix(self.tools[tool]) if tool else None)
        self.tool = tool

    def define(self, tool: int, point: Point | None) -> None:
        """Define a tool (TLSet), or clear it if `point` is None (TLClr)."""
        if point is not None and point.kind != 'xy':
            raise bad('TLSet', 'the tool must be a Cartesian point, XY(…)')
        self.tools.pop(tool, None)
        if point is not None:
            self.tools[tool] = point
        if self.tool == tool:
            self.use(tool if tool in self.tools else 0)

    def joints(self, point: Point, near: Array) -> Array:
        """Return the joint angles of a point within the limits, shape (n,), rad.

        The flags of a Cartesian point select its posture, with defaults for missing flags. If
        several solutions remain, return the one nearest to `near`. Raises SpelError with number
        4001 if a joint is out of range, or 4007 if the point is out of reach.
        """
        angles = self._angles(point, near)
        rejection = angles_rejection(angles, self._model.limits)
        if rejection is not None:
            raise SpelError(ErrorNumber.OUT_OF_RANGE, rejection.sentence)
        return clipped(angles, self._model.limits)

    def pulses(self, point: Point, near: Array) -> Array:
        """Return the encoder pulses of a point, shape (n,). The joint limits are not checked."""
        return np.rint(self._angles(point, near) * self.pulses_per_unit)

    def degrees(self, point: Point, near: Array) -> Array:
        return self._angles(point, near) * self._model.shown_per_unit

    def place(self, angles: Array) -> Point:
        where, turn = self._kinematics.epson_point(angles)
        flags = [words[0] for words in self._posture(angles)]
        if self._model.kind == SCARA:
            turn[0] = self._with_turns(float(turn[0]), angles)
        return Point(
            'xy',
            (*without_rounding(where * _MM), *without_rounding(np.degrees(turn))),
            (*(flag for flag in flags if flag not in _USUAL), *self._undetermined(angles)),
        )

    def _undetermined(self, angles: Array) -> Iterator[str]:
        """Yield flags with the angles of joints that the pose of the tool does not determine."""
        for mark, joint in _UNDETERMINED.get(self._type, {}).items():
            side = self._kinematics.sides(angles)[-1 if joint else 0]
            if abs(math.remainder(side, FULL_TURN)) < STRAIGHT_RAD:
                yield f'{mark}{math.degrees(angles[joint]):.3f}'

    def _with_turns(self, u: float, angles: Array) -> float:
        """Add the full turns of a SCARA's joints to the orientation `u`, rad."""
        axes = self._model.chain.axes[:, 2] * self._model.base.matrix[2, 2]
        revolute = np.array([kind == REVOLUTE for kind in self._model.joint_types])
        at_zero = self._kinematics.epson_point(np.zeros_like(angles))[1][0]
        total = float(angles[revolute] @ axes[revolute] + at_zero)
        return u + FULL_TURN * round((total - u) / FULL_TURN)

    def stored(self, point: Point) -> Point:
        """Return a point as stored in P0, P1, …: Cartesian, with its complete posture.

        Joint angles become such a point, too, and lose the turns of joints 4 and 6 (SPEL+ manual
        p79).
        """
        if point.kind != 'xy':
            point = self.place(self._angles(point, np.zeros(len(self._model.joint_names))))
            flags = (flag for flag in point.flags if not flag.startswith(('j4f', 'j6f')))
            point = replace(point, flags=tuple(flags))
        names = ('hand', 'elbow', 'wrist', 'j6flag', 'j4flag')
        groups = [POSTURES[name] for name in names[: 1 if self._model.kind == SCARA else None]]
        posture = [next((f for f in point.flags if f in group), group[0]) for group in groups]
        return replace(point, flags=(*posture, *(f for f in point.flags if f not in posture)))

    def other_hand(self, point: Point, joints: Array) -> bool:
        hands = next(self._posture(joints), POSTURES['hand'])
        return not {*POSTURES['hand']}.intersection(point.flags) <= {*hands}

    def coordinate(self, point: Point, axis: str) -> float:
        """Return a coordinate of a point: x, y or z in mm, or u, v or w in degrees."""
        return self.stored(point).values['xyzuvw'.index(axis)]

    def _angles(self, point: Point, near: Array) -> Array:
        if point.kind == 'xy':
            return self._reaching(point, near)
        in_pulses = point.kind == 'pulses'
        per_unit = self.pulses_per_unit if in_pulses else self._model.shown_per_unit
        count = len(per_unit)
        if len(point.values) < count or any(point.values[count:]):
            text = f'{len(point.values)} values for {count} joints'
            raise bad(str(point), text)
        return np.asarray(np.array(point.values[:count]) / per_unit)

    def path_to(
        self, point: Point, start: Array, via: Point | None = None, level: bool = False
    ) -> tuple[Array, PosePath]:
        """Return joint angles along the straight path of the tool to a point, and the path.

        `start` are the joint angles at the start, shape (n,), rad. The result has shape (k, n),
        rad, at evenly spaced fractions of the path. With `via` the path is an arc through this
        point. With `level` only X and Y of `via` are used. Raises SpelError with number 4001 if
        the point is out of range, or 4007 if the path is out of reach or a joint would have to
        jump.
        """
        here = self._kinematics.forward(start)
        if point.kind == 'xy':
            end = self._pose(point)
        else:
            end = self._kinematics.forward(self.joints(point, start))
        try:
            if via is None:
                path = line(here, end)
            else:
                arc_through = level_arc if level else arc
                path = arc_through(here, self._pose(self.stored(via))[:3, 3], end)
        except ValueError as error:
            raise SpelError(UNREACHABLE, f'{point}: {error}') from error
        try:
            return joints_along(self._kinematics, path, start, self._type == SIX_AXES), path
        except KinematicsError as error:
            raise bad(str(point), str(error)) from error
        except ValueError as error:
            raise SpelError(UNREACHABLE, f'{point}: {error}') from error

    def _reaching(self, point: Point, near: Array) -> Array:
        free = NEAREST in point.flags
        usual = near.copy()
        if not free and self._model.kind != SCARA:
            usual[3] = 0.0  # if joints 4 and 6 are in line, only joint 6 turns (SPEL+ manual p79)
        for mark, joint in _UNDETERMINED.get(self._type, {}).items():
            flag_of_joint = next((flag for flag in point.flags if flag.startswith(mark)), mark)
            usual[joint] = math.radians(float(flag_of_joint[3:] or 0))
        result = self._solutions(point, self._pose(point), usual)
        fitting = result if free else [item for item in result if self._fits(point, item)]
        if not len(fitting):
            why = ': another posture can reach it' if len(result) else ''
            raise SpelError(UNREACHABLE, f'{point} is out of reach{why}')
        return np.asarray(min(fitting, key=lambda item: float(np.linalg.norm(item - near))))

    def least_motion(self, point: Point, near: Array, number: int) -> Point:
        """Return a Cartesian point in the posture that LJM selects for the joint angles `near`.

        `near` has shape (n,), rad. Other points are returned unchanged. Raises SpelError if the
        LJM number is invalid.
        """
        rules = LEAST_MOTION.get(self._type)
        if point.kind != 'xy' or rules is None:
            return point
        if number not in rules:
            raise bad('LJM', f'{number} is not in 1..{len(rules)}')
        *sides, order = rules[number]
        first = [int(name[1]) - 1 for name in order.split()]
        now = {flag for words in self._posture(near) for flag in words}

        def matches(joints: Array) -> bool:
            has = {flag for words in self._posture(joints) for flag in words}
            signs = {'=': has & now, '!': has - now}
            return all(
                not sign or bool(signs.get(sign, {sign} & has).intersection(POSTURES[name]))
                for name, sign in zip(_SIDES, sides, strict=True)
            )

        def motion(joints: Array) -> list[float]:
            moves = np.abs(joints - near)
            return [*moves[first].round(6).tolist(), float(np.linalg.norm(moves))]

        result = [
            solution
            for solution in self._solutions(point, self._pose(point), near)
            if matches(solution)
        ]
        if result:
            best = min(result, key=motion)
            for words in (*self._posture(best), *((flag,) for flag in self._undetermined(best))):
                point = point.flagged(words[0])
        return point

    def _fits(self, point: Point, joints: Array) -> bool:
        """Return whether joint angles have the posture of a point.

        For a SCARA, the orientation U is compared, too.
        """
        if self._model.kind == SCARA:
            u = math.radians(point.values[3])
            if abs(self._with_turns(u, joints) - u) > math.pi:
                return False
        for fitting in self._posture(joints):
            group = next(words for words in POSTURES.values() if fitting[0] in words)
            if next((flag for flag in point.flags if flag in group), group[0]) not in fitting:
                return False
        return True

    def _posture(self, joints: Array) -> Iterator[tuple[str, ...]]:
        """Yield the flag of each posture group for joint angles.

        At the boundary between two postures, yield both flags.
        """
        try:
            sides = self._kinematics.sides(joints)
        except KinematicsError:
            return
        turns: tuple[tuple[int, float, int], ...] = ((6, 0.0, 127), (4, 0.0, 1), (1, 0.0, 1))
        if self._model.kind == SCARA:  # a joint of the RS series turns further
            sides = (math.remainder(sides[0], FULL_TURN),)
            turns = ((1, np.pi / 2.0, 1), (2, 0.0, 1)) if self._type == RS_SERIES else ()
        for name, side in zip(_SIDES, sides, strict=False):
            usual, other = POSTURES[name]
            over = name == 'elbow' and abs(sides[0]) < STRAIGHT_RAD  # joint 1: it bends either way
            if over or min(abs(side), abs(abs(side) - np.pi)) < STRAIGHT_RAD:
                yield usual, other
            else:
                yield (usual if side > 0.0 else other,)
        for joint, middle, maximum in turns:  # SPEL+ manual p451 to p459
            yield (f'j{joint}f{min(_half_turns(float(joints[joint - 1]) - middle), maximum)}',)

    def _solutions(self, point: Point, pose: Array, near: Array) -> Array:
        try:
            return self._kinematics.inverse(pose, near)
        except (KinematicsError, ModuleNotFoundError) as error:
            raise bad(str(point), str(error)) from error

    def _pose(self, point: Point) -> Array:
        return self._kinematics.from_base(_matrix(point))


def without_rounding(values: Array) -> list[float]:
    """Return values rounded to nine decimals, with -0 replaced by 0."""
    return [item + 0.0 for item in np.round(values, 9).tolist()]


def _half_turns(angle: float) -> int:
    """Return J4Flag or J6Flag for the angle of this joint, rad (SPEL+ manual p459)."""
    turns = abs(angle) / np.pi
    whole = round(turns)
    if abs(turns - whole) * np.pi < STRAIGHT_RAD:
        return max(whole - (angle > 0.0), 0)
    return math.floor(turns)


def _matrix(point: Point) -> Array:
    pose: Any = np.eye(4)
    pose[:3, 3] = np.array(point.values[:3]) / _MM
    pose[:3, :3] = rotation_of_uvw(np.radians(point.values[3:]))
    return np.asarray(pose)


STEP_M = 0.02
STEP_RAD = 0.1
"""Initial sample spacing along a path, m and rad. The spline between the samples then deviates
from the path by some micrometres."""

MIN_SAMPLES, MAX_SAMPLES = 10, 500
FINER = 4  # times more samples if a joint jumps between two
MAX_JOINT_STEP = 0.3  # rad or m between two samples; more is a jump

NEAR_WRIST_RAD, NEAR_HAND_M = math.radians(10.0), 0.03
"""Initial values of SingularityAngle and SingularityDist.

They are the angle of joint 5 from its singularity, rad, and the distance of the wrist from the
axis of joint 1, m.
"""


def joints_along(kinematics: Kinematics, path: PosePath, start: Array, avoids: bool) -> Array:
    """Return joint angles, shape (k, n), rad, at evenly spaced fractions of a path of the tool.

    `start`: joint angles at its start, shape (n,), rad. `avoids`: whether a real arm of this type
    leaves the path near a singularity. Raises ValueError if no solution exists, KinematicsError if
    the robot has no inverse kinematics.
    """
    longest = max(path.length / STEP_M, path.angle / STEP_RAD)
    samples = min(max(math.ceil(longest), MIN_SAMPLES), MAX_SAMPLES)
    while True:
        try:
            return _joints(kinematics, path, start, samples, avoids)
        except _JumpError:
            if samples == MAX_SAMPLES:
                raise
            samples = min(samples * FINER, MAX_SAMPLES)


class _JumpError(ValueError):
    pass


def _joints(
    kinematics: Kinematics, path: PosePath, start: Array, samples: int, avoids: bool
) -> Array:
    rows = [start]
    for number in range(1, samples + 1):
        result = kinematics.inverse(path.pose(number / samples), rows[-1])
        where = f'at {number / samples * 100.0:.0f} % of the path'
        if not len(result):
            raise ValueError(f'out of reach {where}')
        if np.max(np.abs(result[0] - rows[-1])) > MAX_JOINT_STEP:
            if avoids and any(_is_near(kinematics, joints) for joints in (rows[-1], result[0])):
                raise ValueError(f'a singularity {where}: AvoidSingularity is not simulated')
            raise _JumpError(f'a joint would have to jump {where}')
        rows.append(result[0])
    return np.array(rows)


def _is_near(kinematics: Kinematics, joints: Array) -> bool:
    hand, _, wrist = kinematics.sides(joints)
    return abs(hand) < NEAR_HAND_M or abs(wrist) < NEAR_WRIST_RAD
