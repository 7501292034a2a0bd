# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Conversion of SPEL+ motion statements to points for the arm."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from epson_driver.motion import Array
from epson_driver.robots.model import N_SERIES, SCARA, robot_type
from epson_driver.sim_controller.arm.executor import Point
from epson_driver.sim_controller.spel_host.legs import (
    SHORTEST_PATH,
    JointLeg,
    StraightLeg,
    jump_points,
    rest_at,
)
from epson_driver.sim_controller.spel_host.robot_points import NEAREST, UNREACHABLE
from epson_driver.sim_controller.spel_host.robot_values import RobotContext
from epson_driver.spel import ErrorNumber, MotionRequest, SpelError
from epson_driver.spel import Point as SpelPoint
from epson_driver.spel.errors import bad
from epson_driver.spel.frames import combined, within
from epson_driver.spel.words import CONSTANTS

_MM = 1000.0
ARC_SHORT, ARC_LONG = CONSTANTS['arc_short'], CONSTANTS['arc_long']


def points_of(robot: RobotContext, request: MotionRequest) -> Sequence[Point]:
    first, *others = MOVES[request.name](robot, request)
    # After Pass, a motion other than Pass starts from rest (SPEL+ manual p604).
    if robot.motion.passes and request.name != 'pass' and first.path is None:
        first = replace(first, path=JointLeg(robot, robot.motion.start, first.target).from_rest)
    return [first, *others]


def _go(robot: RobotContext, request: MotionRequest) -> Sequence[Point]:
    (point,) = _least_motion(robot, request)
    return [rest_at(robot.points.joints(point, robot.here))]


def _least_motion(robot: RobotContext, request: MotionRequest) -> list[SpelPoint]:
    """Return a statement's points, converted by its LJM parameter, if any (SPEL+ manual p479)."""
    near, result = robot.motion.start, list(request.points)
    if (number := request.numbers.get('ljm')) is not None:
        for index, point in enumerate(result):
            result[index] = robot.points.least_motion(point, near, round(number))
            near = robot.points.joints(result[index], near)
    return result


def _jump(robot: RobotContext, request: MotionRequest) -> Sequence[Point]:
    """Return the points of Jump: up to LimZ, across, and down, with stops or as one arch."""
    model = robot.controller.model
    if model.kind != SCARA:
        raise bad('Jump', f'{model.name} is not a SCARA: use Go')
    start = robot.motion.start
    target = robot.points.joints(request.points[-1], start)
    lim_z = robot.motion.lim_z
    if 'limz' in request.numbers:
        lim_z = request.numbers['limz'] / _MM
    if lim_z > model.limits.position_max[2]:
        raise bad('Jump', f'LimZ {lim_z * _MM:g} is above the range of joint 3')
    for number, what, joints in ((4005, 'the arm', start), (4006, 'the target', target)):
        if joints[2] > lim_z + SHORTEST_PATH:
            text = f'{what}, at {joints[2] * _MM:g}, is above LimZ {lim_z * _MM:g}'
            raise SpelError(number, f'Jump: {text}')
    up, across = start.copy(), target.copy()
    up[2] = across[2] = lim_z
    stops = start, up, across, target
    legs = [JointLeg(robot, first, end) for first, end in pairwise(stops)]
    return jump_points(robot, request, legs, (lim_z - start[2], lim_z - target[2]))


def _move(robot: RobotContext, request: MotionRequest) -> Sequence[Point]:
    return [_line(robot, request, request.points[-1], robot.motion.start).point]


def _line(
    robot: RobotContext, request: MotionRequest, point: SpelPoint, start: Array
) -> StraightLeg | JointLeg:
    """Return a line to a point, or an arc if the statement has an intermediate point."""
    name = request.name.capitalize()
    via = None
    if request.name in ('arc', 'arc3'):
        through = not request.numbers.keys() & {'angle', 'path'}
        for item in request.points if through else request.points[-1:]:
            if robot.points.other_hand(item, start):
                text = f'{item} has another hand (/R or /L) than the arm: Go there, or change it'
                raise bad(name, text)  # SPEL+ manual p106
        via = _arc_midpoint(robot, request, start)
    samples, path = robot.points.path_to(point, start, via, level=request.name == 'arc')
    turns = path.length < SHORTEST_PATH < path.angle
    if turns and 'rot' not in request.words:
        raise bad(name, f'only the orientation changes on the path to {point}: add ROT')
    if max(path.length, path.angle) < SHORTEST_PATH:
        return JointLeg(robot, start, start)
    turning = 'rot' in request.words and path.angle > SHORTEST_PATH  # SpeedS has no effect (p105)
    if 'rot' in request.words and not turning and request.name == 'move':
        raise bad(
            name, f'the orientation does not change on the path to {point}: remove ROT'
        )  # p551
    leg = StraightLeg(robot, point, samples, path, turning=turning)
    try:
        leg.motion(start, low_power=False)
    except ValueError as error:
        raise SpelError(UNREACHABLE, f'{name}: {error}') from error
    return leg


def _arc_midpoint(robot: RobotContext, request: MotionRequest, start: Array) -> SpelPoint:
    """Return an intermediate point of an arc.

    The statement specifies it as a point, an angle, a radius or a centre. Raises SpelError if no
    such arc exists (SPEL+ manual p104-109).
    """
    numbers, name = request.numbers, request.name.capitalize()
    if not numbers.keys() & {'angle', 'path'}:
        return robot.points.stored(request.points[0])
    ends = (robot.points.place(start), robot.points.stored(request.points[-1]))
    first, end = (np.array(item.values[:3]) for item in ends)
    level = np.array([1.0, 1.0, request.name == 'arc3'])
    chord, middle = (end - first) * level, (first + end) / 2.0
    half = float(np.linalg.norm(chord)) / 2.0
    angle, path = numbers.get('angle', 0.0), numbers.get('path', ARC_SHORT)
    if path not in (ARC_SHORT, ARC_LONG):
        raise bad(name, 'path must be ARC_SHORT or ARC_LONG')
    if 'radius' in numbers:
        radius, direction = numbers['radius'], numbers['direction']
        if radius < half or direction not in (1, -1):
            rule = f'the radius at least {half:.3f}, the direction ARC_PLUS or ARC_MINUS'
            raise bad(name, rule)
        angle = math.degrees(2.0 * math.asin(half / radius))
        angle = direction * (angle if path == ARC_SHORT else 360.0 - angle)
    elif 'angle' not in numbers:
        offset = (np.array(robot.points.stored(request.points[0]).values[:3]) - middle) * level
        offset -= chord * float(chord @ offset) / max(4.0 * half**2, SHORTEST_PATH)
        height = float(np.linalg.norm(offset))
        if height > SHORTEST_PATH:
            away = math.hypot(height, half) * (-1.0 if path == ARC_SHORT else 1.0)
            return SpelPoint('xy', (*(middle + offset + offset / height * away), 0.0, 0.0, 0.0))
        if request.name == 'arc3':
            raise bad('Arc3', 'a half circle needs a via point that determines its plane')
        angle = 180.0 if path == ARC_SHORT else -180.0
    if not 0.0 < abs(angle) < 360.0:
        raise bad(name, f'an arc cannot have {angle:g} degrees')
    aside = np.array([chord[1], -chord[0], 0.0]) * math.tan(math.radians(angle) / 4.0) / 2.0
    return SpelPoint('xy', (*(middle + aside), 0.0, 0.0, 0.0))


def _relative(robot: RobotContext, request: MotionRequest) -> MotionRequest:
    """Return a request with the absolute target of TGo, TMove, BGo or BMove.

    TGo and TMove are relative to the tool frame, BGo and BMove to the base frame.
    """
    by = robot.points.stored(request.points[-1])
    here = robot.points.place(robot.motion.start)
    if request.name[0] == 't':
        return replace(request, points=(_with_posture(robot, combined(here, by)),))
    turned = combined(replace(by, values=(0.0, 0.0, 0.0, *by.values[3:])), here)
    moved = (a + b for a, b in zip(here.values[:3], by.values[:3], strict=True))
    place = replace(turned, values=(*moved, *turned.values[3:]), flags=here.flags)
    return replace(request, points=(_with_posture(robot, place),))


def _with_posture(robot: RobotContext, place: SpelPoint) -> SpelPoint:
    """Return a point with a complete posture.

    A SCARA keeps its current posture (SPEL+ manual p163). Other arms take the nearest posture.
    """
    return place if robot.controller.model.kind == SCARA else replace(place, flags=(NEAREST,))


def _jump3(robot: RobotContext, request: MotionRequest) -> Sequence[Point]:
    """Return the points of Jump3.

    The tool moves up and down on straight lines (SPEL+ manual p476).
    """
    depart, approach, target = _least_motion(robot, request)
    rise = _line(robot, request, depart, robot.motion.start)
    span: StraightLeg | JointLeg
    if request.name == 'jump3':
        span = JointLeg(robot, rise.end, robot.points.joints(approach, rise.end))
    else:
        span = _line(robot, request, approach, rise.end)
    fall = _line(robot, request, target, span.end)
    return jump_points(robot, request, (rise, span, fall), (rise.length, fall.length))


def _jump_tlz(robot: RobotContext, request: MotionRequest) -> Sequence[Point]:
    """Return the points of JumpTLZ: along the tool's Z axis, across, and along the tool's Z axis.

    Source: SPEL+ manual p481.
    """
    model = robot.controller.model
    if robot_type(model) != N_SERIES:
        raise bad('JumpTLZ', f'{model.name} is not of the N series: use Jump3')
    here, target = robot.points.place(robot.motion.start), robot.points.stored(request.points[-1])
    step = request.numbers['tlz']
    x, y, *_ = within(here, target).values
    above = (combined(here, SpelPoint('xy', (*xy, step, 0, 0, 0))) for xy in ((0, 0), (x, y)))
    return _jump3(robot, replace(request, name='jump3', points=(*above, target)))


def _pass(robot: RobotContext, request: MotionRequest) -> Sequence[Point]:
    """Return the points of the statement Pass.

    The motion to each point starts while the motion to the previous point decelerates.
    """
    near, result = robot.motion.start, []
    for point in _least_motion(robot, request):
        near = robot.points.joints(point, near)
        result.append(replace(rest_at(near), cp=True))
    return result


def _home(robot: RobotContext, _request: MotionRequest) -> Sequence[Point]:
    """Return the home position. All joints move together, because Hordr is not simulated."""
    home = robot.controller.spel.home
    if home is None:
        text = 'Home: no home position is defined: add `setup: HomeSet PULSES, …` to spel.yaml'
        raise SpelError(ErrorNumber.NO_HOME, text)
    return _go(robot, MotionRequest('go', (SpelPoint('pulses', tuple(map(float, home))),)))


MOVES: dict[str, Callable[[RobotContext, MotionRequest], Sequence[Point]]] = {
    'go': _go,
    'pulse': _go,
    'home': _home,
    'jump': _jump,
    'move': _move,
    'arc': _move,
    'arc3': _move,
    **dict.fromkeys(('tgo', 'bgo'), lambda robot, by: _go(robot, _relative(robot, by))),
    **dict.fromkeys(('tmove', 'bmove'), lambda robot, by: _move(robot, _relative(robot, by))),
    'jump3': _jump3,
    'jump3cp': _jump3,
    'jumptlz': _jump_tlz,
    'pass': _pass,
}
