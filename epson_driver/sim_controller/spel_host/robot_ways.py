# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What a motion statement asks of the arm: Go, Pulse, Jump of a SCARA, the lines of Move."""

import logging
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from epson_driver.motion import Array, JointLimits, LineMotion, go
from epson_driver.motion.cartesian import PosePath
from epson_driver.motion.path_motion import Curve, PathMotion, PathSpeed, go_along
from epson_driver.robots.model import SCARA
from epson_driver.sim_controller.arm.executor import Point
from epson_driver.sim_controller.spel_host.robot_points import UNREACHABLE
from epson_driver.sim_controller.spel_host.robot_values import Robot
from epson_driver.spel import ErrorNumber, MotionRequest, SpelError
from epson_driver.spel import Point as SpelPoint

_log = logging.getLogger(__name__)

_MM = 1000.0
SHORTEST_WAY = 1e-6
"""m; a straight way that is shorter is none: only the orientation changes."""

JERK_PER_ACCELERATION = 10.0
"""1/s: a ramp of 0.1 s."""

LOW_POWER_MM_S, LOW_POWER_MM_S2 = 50.0, 200.0
"""What SpeedS and AccelS are at low power at most: their defaults."""

TURN_DEGREES_S, TURN_DEGREES_S2 = 50.0, 500.0
"""SpeedR and AccelR until they are set: a guess."""


def points_of(robot: Robot, request: MotionRequest) -> Sequence[Point]:
    """Return where the arm goes for a statement, one after the other. Raises SpelError."""
    return MOVES[request.name](robot, request)


def _go(robot: Robot, request: MotionRequest) -> Sequence[Point]:
    return [_at(robot.points.joints(request.points[-1], robot.here))]


def _jump(robot: Robot, request: MotionRequest) -> Sequence[Point]:
    """Up to LimZ, across, and down: as with C7, that is without an arch."""
    model = robot.controller.model
    if model.kind != SCARA:
        text = f'Jump: only a SCARA can; {model.name} is none: use Go'
        raise SpelError(ErrorNumber.ARGUMENT, text)
    start = robot.motion.start
    target = robot.points.joints(request.points[-1], start)
    top = max(robot.motion.lim_z, float(start[2]), float(target[2]))
    if top > model.limits.position_max[2]:
        text = f'Jump: LimZ {robot.motion.lim_z * _MM:g} is above the range of joint 3'
        raise SpelError(ErrorNumber.ARGUMENT, text)
    up, across = start.copy(), target.copy()
    up[2] = across[2] = top
    return [_at(up), _at(across), _at(target)]


def _move(robot: Robot, request: MotionRequest) -> Sequence[Point]:
    point = request.points[-1]
    start = robot.motion.start
    samples, path = robot.points.straight(point, start)
    turns = path.length < SHORTEST_WAY < path.angle
    if turns and 'rot' not in request.words:
        text = f'Move: only the orientation changes to {point}: Move … ROT'
        raise SpelError(ErrorNumber.ARGUMENT, text)
    if max(path.length, path.angle) < SHORTEST_WAY:
        return [_at(start)]
    way = _Straight(robot, point, samples, path, _turning if turns else _straight)
    try:
        way(start, False)
    except ValueError as error:
        raise SpelError(UNREACHABLE, f'Move: {error}') from error
    return [replace(_at(samples[-1]), way=way.from_rest)]


MOVES: dict[str, Callable[[Robot, MotionRequest], Sequence[Point]]] = {
    'go': _go,
    'pulse': _go,
    'jump': _jump,
    'move': _move,
}
"""Statements that move this arm."""


class _Straight:
    """A straight way of Tool 0 to a point, from where the arm was, or is after a pause.

    `speed`: what is asked for on a way, at low power or not.
    """

    def __init__(
        self,
        robot: Robot,
        point: SpelPoint,
        samples: Array,
        path: PosePath,
        speed: Callable[[Robot, PosePath, bool], PathSpeed],
    ) -> None:
        self._robot = robot
        self._point = point
        self._samples = samples
        self._path = path
        self._speed = speed

    def __call__(self, start: Array, low_power: bool) -> PathMotion:
        """Return the motion. Raises SpelError, ValueError."""
        samples, path = self._samples, self._path
        if not np.allclose(start, samples[0], rtol=0.0, atol=1e-9):
            samples, path = self._robot.points.straight(self._point, start)
        speed = self._speed(self._robot, path, low_power)
        return go_along(_limits(self._robot, low_power), Curve(samples), speed)

    def from_rest(self, start: Array, low_power: bool) -> LineMotion | PathMotion:
        """Return the motion; from joint to joint, slowly, where no straight way is left."""
        try:
            return self(start, low_power)
        except (SpelError, ValueError) as error:
            _log.warning('Move goes on from joint to joint: %s', error)
            slow = self._robot.controller.profile.motion.low_power
            limits = self._robot.controller.model.limits
            return go(limits, start, self._samples[-1], slow, slow)


def _limits(robot: Robot, low_power: bool) -> JointLimits:
    limits = robot.controller.model.limits
    if not low_power:
        return limits
    share = robot.controller.profile.motion.low_power
    return replace(
        limits,
        velocity=limits.velocity * share,
        acceleration=limits.acceleration * share,
        jerk=limits.jerk * share,
    )


def _straight(robot: Robot, path: PosePath, low_power: bool) -> PathSpeed:
    """Return what SpeedS and AccelS ask for."""
    speed = robot.controller.spel.values('SpeedS')[0]
    accel = robot.controller.spel.values('AccelS')[0]
    if low_power:
        speed, accel = min(speed, LOW_POWER_MM_S), min(accel, LOW_POWER_MM_S2)
    way = max(path.length, SHORTEST_WAY) * _MM
    return _shares(robot, speed / way, accel / way)


def _turning(robot: Robot, path: PosePath, _low_power: bool) -> PathSpeed:
    """Return what SpeedR and AccelR ask for; at low power the joints' limits are low enough."""
    speed = (robot.controller.spel.values('SpeedR') or (TURN_DEGREES_S,))[0]
    accel = (robot.controller.spel.values('AccelR') or (TURN_DEGREES_S2,))[0]
    way = float(np.degrees(max(path.angle, SHORTEST_WAY)))
    return _shares(robot, speed / way, accel / way)


def _shares(robot: Robot, velocity: float, acceleration: float) -> PathSpeed:
    factor = robot.controller.spel.values('SpeedFactor')[0] / 100.0
    acceleration *= factor
    return PathSpeed(velocity * factor, acceleration, acceleration * JERK_PER_ACCELERATION)


def _at(joints: Array) -> Point:
    return Point(0, joints, 0.0, 0.0)
