# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Points of a SPEL+ program as joint angles of the arm, and back."""

import logging
import math
from functools import cached_property
from typing import Any

import numpy as np

from epson_driver.motion import Array
from epson_driver.robots import RobotModel
from epson_driver.robots.kinematics import Kinematics, rotation_of_uvw
from epson_driver.robots.model import SCARA
from epson_driver.robots.opw import KinematicsError
from epson_driver.sim_controller.condition.errors import ErrorNumber
from epson_driver.sim_controller.programs.points import angles_rejection, clipped
from epson_driver.spel import ErrorNumber as SpelNumber
from epson_driver.spel import Point, SpelError
from epson_driver.tool_motion.pose_path import PosePath, arc, line

UNREACHABLE = 4007
STEP_M = 0.02
STEP_RAD = 0.1
"""how densely a line is looked at; between, a spline is near it by some micrometres."""

STRAIGHT_RAD = 1e-6
"""A SCARA that is stretched out is bent to either side."""

MIN_SAMPLES, MAX_STEPS = 10, 500
MAX_JOINT_STEP = 0.3
"""A joint that changes by more from one look to the next, rad or m, jumps."""

_MM = 1000.0
_IGNORED_FLAGS = frozenset({'0', 'r', 'a', 'nf', 'j1f0', 'j2f0', 'j4f0', 'j6f0'})
"""Local 0 is the world; the others are the usual posture of a six-axis arm, the nearest one."""

_HANDS = {'r': 1.0, 'l': -1.0}
"""The side to which joint 2 of a SCARA is bent."""

ASSUMED_PULSES = 10_000.0
"""Per degree or mm, where a model does not say: no program could count its pulses otherwise."""

_log = logging.getLogger(__name__)


class RobotPoints:
    """Points and joint angles of one robot model."""

    def __init__(self, model: RobotModel) -> None:
        self._model = model
        self._kinematics = Kinematics(model)
        self.tool = 0
        self.tools: dict[int, Point] = {}
        """Tools by number, as TLSet has defined them."""

    @cached_property
    def pulses_per_unit(self) -> Array:
        """Encoder pulses per rad or m, shape (n,). A warning names those that are assumed."""
        model = self._model
        unknown = np.isnan(model.pulses_per_unit)
        if unknown.any():
            names = ', '.join(np.array(model.joint_names)[unknown])
            text = 'the encoder pulses of %s of the %s are not known: %g per degree or mm assumed'
            _log.warning(text, names, model.name, ASSUMED_PULSES)
        return np.where(unknown, ASSUMED_PULSES * model.shown_per_unit, model.pulses_per_unit)

    def use(self, tool: int) -> None:
        """Lead another tool from now on (Tool n). Raises SpelError."""
        if tool and tool not in self.tools:
            text = f'Tool {tool} is not defined: TLSet {tool}, or run --setup'
            raise SpelError(SpelNumber.ARGUMENT, text)
        self._kinematics = Kinematics(self._model, _matrix(self.tools[tool]) if tool else None)
        self.tool = tool

    def define(self, tool: int, point: Point | None) -> None:
        """Define a tool (TLSet), or none (TLClr). Raises SpelError."""
        if point is not None and point.kind != 'xy':
            raise SpelError(SpelNumber.ARGUMENT, 'TLSet: takes a place, XY(…)')
        self.tools.pop(tool, None)
        if point is not None:
            self.tools[tool] = point
        if self.tool == tool:
            self.use(tool if tool in self.tools else 0)

    def joints(self, point: Point, near: Array) -> Array:
        """Return the joint angles of a point within the limits, shape (n,), rad.

        Of a place in space: those nearest to `near`. Raises SpelError: 4001 out of range, 4007
        out of reach.
        """
        angles = self._angles(point, near)
        rejection = angles_rejection(angles, self._model.limits)
        if rejection is not None:
            raise SpelError(ErrorNumber.OUT_OF_RANGE, rejection.sentence)
        return clipped(angles, self._model.limits)

    def pulses(self, point: Point, near: Array) -> Array:
        """Return the encoder pulses of a point, shape (n,), in the range or not."""
        return np.rint(self._angles(point, near) * self.pulses_per_unit)

    def degrees(self, point: Point, near: Array) -> Array:
        """Return the angles of a point in degrees (or mm), shape (n,)."""
        return self._angles(point, near) * self._model.shown_per_unit

    def place(self, angles: Array) -> Point:
        """Return joint angles, shape (n,), rad, as a place in space."""
        where, turn = self._kinematics.epson_point(angles)
        return Point('xy', (*(where * _MM).tolist(), *np.degrees(turn).tolist()))

    def stored(self, point: Point) -> Point:
        """Return a point as P0, P1, … hold it: a place in space, without turns of the wrist."""
        if point.kind == 'xy':
            return point
        return self.place(self._angles(point, np.zeros(len(self._model.joint_names))))

    def coordinate(self, point: Point, axis: str) -> float:
        """Return x, y, z in mm, or u, v, w in degrees."""
        return self.stored(point).values['xyzuvw'.index(axis)]

    def _angles(self, point: Point, near: Array) -> Array:
        if point.kind == 'xy':
            return self._reaching(point, near)
        counted = point.kind == 'pulses'
        per_unit = self.pulses_per_unit if counted else self._model.shown_per_unit
        count = len(per_unit)
        if len(point.values) < count or any(point.values[count:]):
            text = f'{len(point.values)} values for {count} joints'
            raise SpelError(SpelNumber.ARGUMENT, f'{point}: {text}')
        return np.asarray(np.array(point.values[:count]) / per_unit)

    def path_to(
        self, point: Point, start: Array, via: Point | None = None
    ) -> tuple[Array, PosePath]:
        """Return joints along the tool's line from joints, shape (n,), to a point.

        With `via` it is an arc over that point. rad, shape (k, n), at even shares of the path.
        Raises SpelError: 4001, or 4007 for a path that
        leaves the reach or a joint's range, or on which a joint would have to jump.
        """
        here = self._kinematics.forward(start)
        if point.kind == 'xy':
            there = self._pose(point)
        else:
            there = self._kinematics.forward(self.joints(point, start))
        try:
            if via is None:
                path = line(here, there)
            else:
                path = arc(here, self._pose(self.stored(via))[:3, 3], there)
        except ValueError as error:
            raise SpelError(UNREACHABLE, f'{point}: {error}') from error
        longest = max(path.length / STEP_M, path.angle / STEP_RAD)
        count = min(max(math.ceil(longest), MIN_SAMPLES), MAX_STEPS) + 1
        samples = [start]
        for share in np.linspace(0.0, 1.0, count)[1:].tolist():
            found = self._solutions(point, path.pose(share), samples[-1])
            if not len(found) or np.max(np.abs(found[0] - samples[-1])) > MAX_JOINT_STEP:
                why = 'a joint would have to jump' if len(found) else 'it is out of reach'
                text = f'{point}: {why} at {share * 100.0:.0f} % of the way'
                raise SpelError(UNREACHABLE, text)
            samples.append(found[0])
        return np.array(samples), path

    def _reaching(self, point: Point, near: Array) -> Array:
        found = self._solutions(point, self._pose(point), near)
        side = next((_HANDS[flag] for flag in point.flags if flag in _HANDS), 0.0)
        if self._model.kind == SCARA and side:
            found = found[found[:, 1] * side >= -STRAIGHT_RAD]
        if not len(found):
            raise SpelError(UNREACHABLE, f'{point} is out of reach')
        return np.asarray(found[0])

    def _solutions(self, point: Point, pose: Array, near: Array) -> Array:
        try:
            return self._kinematics.inverse(pose, near)
        except (KinematicsError, ModuleNotFoundError) as error:
            raise SpelError(SpelNumber.ARGUMENT, f'{point}: {error}') from error

    def _pose(self, point: Point) -> Array:
        """Return where the tool is at a place in space, in base_link."""
        scara = self._model.kind == SCARA
        wanted = [
            flag
            for flag in point.flags
            if flag not in _IGNORED_FLAGS and not (scara and flag in _HANDS)
        ]
        if wanted:
            text = f'/{wanted[0].upper()} is not simulated: the nearest posture is taken'
            raise SpelError(SpelNumber.ARGUMENT, f'{point}: {text}')
        return self._kinematics.from_base(_matrix(point))


def _matrix(point: Point) -> Array:
    pose: Any = np.eye(4)
    pose[:3, 3] = np.array(point.values[:3]) / _MM
    pose[:3, :3] = rotation_of_uvw(np.radians(point.values[3:]))
    return np.asarray(pose)
