# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The legs of a motion statement: straight in joint space, or a line or arc of the tool."""

import logging
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from epson_driver.motion import Array, JointLimits, LineMotion, go
from epson_driver.sim_controller.arm.arch import Arch, changed
from epson_driver.sim_controller.arm.executor import Point
from epson_driver.sim_controller.arm.low_power import LOW_POWER, low_power_caps
from epson_driver.sim_controller.spel_host.robot_values import RobotContext
from epson_driver.spel import MotionRequest, SpelError
from epson_driver.spel import Point as SpelPoint
from epson_driver.tool_motion.curve_motion import (
    MIN_SAMPLES,
    Curve,
    CurveMotion,
    CurveSpeed,
    go_along,
)
from epson_driver.tool_motion.pose_path import PosePath

_log = logging.getLogger(__name__)

_MM = 1000.0
SHORTEST_PATH = 1e-6
"""Shortest translation, m, or rotation, rad, of a path. A smaller one is ignored."""

JERK_PER_ACCELERATION = 10.0
"""Ratio of the tool's jerk to its acceleration, 1/s. An acceleration ramp then takes 0.1 s."""

LOW_POWER_MM_S, LOW_POWER_MM_S2 = 50.0, 200.0  # maximum SpeedS, mm/s, and AccelS, mm/s²

TURN_DEGREES_S, TURN_DEGREES_S2 = 50.0, 500.0  # assumed initial SpeedR and AccelR


class JointLeg:
    """A straight line in joint space between two positions, shape (n,), rad.

    Both positions may be equal.
    """

    length = 0.0

    def __init__(self, robot: RobotContext, start: Array, end: Array) -> None:
        self._model, self._spel = robot.controller.model, robot.controller.spel
        self.start, self.end = start, end
        self.curve = Curve(np.linspace(start, end, MIN_SAMPLES))

    @property
    def point(self) -> Point:
        return rest_at(self.end)

    def limits_and_speed(self, low_power: bool, fraction: float) -> tuple[JointLimits, CurveSpeed]:
        displacement = np.abs(self.end - self.start)
        limits = _scaled(
            self._model.limits, *self._speed_and_accel(displacement, low_power, fraction)
        )
        with np.errstate(divide='ignore'):
            v, a, j = (
                np.min(item / displacement)
                for item in (limits.velocity, limits.acceleration, limits.jerk)
            )
        return limits, CurveSpeed(float(v), float(a), float(j))

    def from_rest(self, start: Array, low_power: bool) -> LineMotion:
        speed, accel = self._speed_and_accel(self.end - start, low_power, 1.0)
        return go(self._model.limits, start, self.end, speed, accel)

    def _speed_and_accel(
        self, displacement: Array, low_power: bool, fraction: float
    ) -> tuple[float, float]:
        speed, accel = self._spel.speed, self._spel.accel
        if not low_power:
            return speed, accel
        caps = low_power_caps(self._model.reach, fraction)
        return min(speed, caps.speed(self._model.limits, displacement)), min(accel, caps.fraction)


class StraightLeg:
    """A line or an arc of the tool to the point `target`.

    `samples` are joint positions along `path`, shape (k, n), rad. `turning`: whether SpeedR and
    AccelR limit the motion, instead of SpeedS and AccelS.
    """

    def __init__(
        self,
        robot: RobotContext,
        target: SpelPoint,
        samples: Array,
        path: PosePath,
        *,
        turning: bool,
    ) -> None:
        self._robot = robot
        self._target = target
        self._path = path
        self._speed = _turning if turning else _straight
        self.curve = Curve(samples)
        self.start, self.end, self.length = samples[0], samples[-1], path.length

    @property
    def point(self) -> Point:
        return replace(rest_at(self.end), path=self.from_rest)

    def limits_and_speed(self, low_power: bool, fraction: float) -> tuple[JointLimits, CurveSpeed]:
        return _limits(self._robot, low_power), self._speed(self._robot, self._path, low_power)

    def motion(self, start: Array, low_power: bool) -> CurveMotion:
        """Return the motion from rest at `start`, shape (n,), rad.

        After a pause, `start` is inside the leg. The motion then follows a new straight line from
        there to the target. Raises SpelError or ValueError if this line is not possible.
        """
        curve, path = self.curve, self._path
        if not np.allclose(start, self.start, rtol=0.0, atol=1e-9):
            samples, path = self._robot.points.path_to(self._target, start)
            curve = Curve(samples)
        speed = self._speed(self._robot, path, low_power)
        return go_along(_limits(self._robot, low_power), curve, speed)

    def from_rest(self, start: Array, low_power: bool) -> LineMotion | CurveMotion:
        """Return the motion from rest at `start`.

        If the tool cannot move on a straight line, the motion is slow and straight in joint space.
        """
        try:
            return self.motion(start, low_power)
        except (SpelError, ValueError) as error:
            _log.warning('Move continues in joint space: %s', error)
            limits = self._robot.controller.model.limits
            return go(limits, start, self.end, LOW_POWER, LOW_POWER)


def jump_points(
    robot: RobotContext,
    request: MotionRequest,
    legs: Sequence[JointLeg | StraightLeg],
    heights: tuple[float, float],
) -> Sequence[Point]:
    """Return the points of a jump: one rounded arch, or a stop at the end of each leg.

    legs: the moves up, across and down. heights: heights of the moves up and down, m. A statement
    selects an arch such as `C0`, which has a depart and an approach distance. The jump is an arch
    only if the heights exceed these distances (SPEL+ manual p477).
    """
    arch = [request.numbers.get(item, math.inf) / _MM for item in ('depart', 'approach')]
    points = [leg.point for leg in legs]
    no_span = np.allclose(legs[1].start, legs[1].end, rtol=0.0, atol=SHORTEST_PATH)
    if not (arch[0] < heights[0] and arch[1] < heights[1]) or no_span:
        return points
    arch_legs = legs[:2] if request.sense else legs  # Sense is evaluated above the target
    path = Arch(
        robot.controller.model.limits, arch_legs, arch[0] / heights[0], 1.0 - arch[1] / heights[1]
    )
    try:
        path.check()
    except ValueError as error:
        _log.info('%s stops at its corners: %s', request.name.capitalize(), error)
        return points
    return [replace(rest_at(arch_legs[-1].end), path=path), *points[len(arch_legs) :]]


def rest_at(joints: Array) -> Point:
    return Point(0, joints, 0.0, 0.0)


def _limits(robot: RobotContext, low_power: bool) -> JointLimits:
    fraction = LOW_POWER if low_power else 1.0
    return _scaled(robot.controller.model.limits, fraction, fraction)


def _scaled(limits: JointLimits, speed: float, accel: float) -> JointLimits:
    return changed(limits, lambda kind, limit: limit * (speed if kind == 'velocity' else accel))


def _straight(robot: RobotContext, path: PosePath, low_power: bool) -> CurveSpeed:
    speed = robot.controller.spel.values('SpeedS')[0]
    accel = robot.controller.spel.values('AccelS')[0]
    if low_power:
        speed, accel = min(speed, LOW_POWER_MM_S), min(accel, LOW_POWER_MM_S2)
    length = max(path.length, SHORTEST_PATH) * _MM
    return _with_speed_factor(robot, speed / length, accel / length)


def _turning(robot: RobotContext, path: PosePath, low_power: bool) -> CurveSpeed:
    speed = (robot.controller.spel.values('SpeedR') or (TURN_DEGREES_S,))[0]
    accel = (robot.controller.spel.values('AccelR') or (TURN_DEGREES_S2,))[0]
    angle = math.degrees(max(path.angle, SHORTEST_PATH))
    length = max(path.length, SHORTEST_PATH) * _MM
    if low_power:
        speed = min(speed, LOW_POWER_MM_S / length * angle)
        accel = min(accel, LOW_POWER_MM_S2 / length * angle)
    return _with_speed_factor(robot, speed / angle, accel / angle)


def _with_speed_factor(robot: RobotContext, velocity: float, acceleration: float) -> CurveSpeed:
    factor = robot.controller.spel.values('SpeedFactor')[0] / 100.0
    acceleration *= factor
    return CurveSpeed(velocity * factor, acceleration, acceleration * JERK_PER_ACCELERATION)
