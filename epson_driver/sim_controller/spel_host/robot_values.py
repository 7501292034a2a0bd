# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Table of SPEL+ functions that read the state of the controller and its robot."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from epson_driver.motion import Array, go
from epson_driver.robots.chain import REVOLUTE
from epson_driver.robots.model import robot_type
from epson_driver.sim_controller.condition.states import Mode
from epson_driver.sim_controller.core import Controller
from epson_driver.sim_controller.remote import status_words
from epson_driver.sim_controller.spel_host.robot_motion import RobotMotion
from epson_driver.sim_controller.spel_host.robot_points import RobotPoints, without_rounding
from epson_driver.spel import ErrorNumber, Point, SpelError
from epson_driver.spel.errors import bad

Arguments = Sequence[int | float | Point]
Result = int | float | Point | str

MAX_ACCEL = 100
_MM = 1000.0


class RobotContext(NamedTuple):
    controller: Controller
    motion: RobotMotion
    points: RobotPoints

    @property
    def here(self) -> Array:
        """Commanded joint positions, shape (n,), rad."""
        return self.controller.arm.commanded

    @property
    def encoders(self) -> Array:
        return self.controller.servo.position

    def joint(self, name: str, number: int | float | Point) -> int:
        """Return the index (from 0) of the joint with this number.

        Raises SpelError if it is invalid.
        """
        count = len(self.controller.model.joint_names)
        if isinstance(number, Point) or not 1 <= number <= count:
            raise bad(name, f'joint {number} is not in 1..{count}')
        return int(number) - 1


def value(robot: RobotContext, name: str, arguments: Arguments) -> Result:
    return VALUES[name](robot, arguments)


def _truth(predicate: status_words.Predicate) -> Callable[[RobotContext, Arguments], int]:
    return lambda robot, _: -1 if predicate(robot.controller) else 0


def _one(predicate: status_words.Predicate) -> Callable[[RobotContext, Arguments], int]:
    return lambda robot, _: int(predicate(robot.controller))


def _word(
    bits: dict[int, status_words.Predicate], till: int = 0, sense: int = 0
) -> Callable[[RobotContext], int]:
    return lambda robot: (
        status_words.word(bits, robot.controller)
        | till * robot.motion.till_on
        | sense * robot.motion.sensed
    )


WORDS: dict[str, dict[int, Callable[[RobotContext], int]]] = {
    'CtrlInfo': {
        1: _word(status_words.CTRL_INFO_1),
        5: lambda _: status_words.CONTROL_DEVICE,
        6: lambda _: 1,
        7: _word(status_words.CTRL_INFO_7),
    },
    'RobotInfo': {0: _word(status_words.ROBOT_INFO_0, till=0x4000, sense=0x8000)},
    'Stat': {0: _word(status_words.STAT_0), 1: _word(status_words.STAT_1, till=2, sense=1)},
}
"""Function name → numeric argument → function that returns the value."""


def _state(name: str) -> Callable[[RobotContext, Arguments], int]:
    def read(robot: RobotContext, arguments: Arguments) -> int:
        (number,) = arguments
        if number not in WORDS[name]:
            known = ', '.join(map(str, WORDS[name]))
            text = f'{name}({number}) is not simulated, only {known}'
            raise SpelError(ErrorNumber.ARGUMENT, text)
        return WORDS[name][number](robot)  # type: ignore[index]

    return read


def _setting(name: str, usual: float) -> Callable[[RobotContext, Arguments], float]:
    def read(robot: RobotContext, arguments: Arguments) -> float:
        values = robot.controller.spel.values(name) or (usual,)
        number = arguments[0] if arguments else 1
        if isinstance(number, Point) or not 1 <= number <= 6:
            raise bad(name, f'{number} is not in 1..6')
        return values[min(int(number), len(values)) - 1]

    return read


def _angle(robot: RobotContext, arguments: Arguments) -> float:
    joint = robot.joint('Agl', arguments[0])
    return without_rounding(robot.here * robot.controller.model.shown_per_unit)[joint]


def _pulses(name: str, real: bool) -> Callable[[RobotContext, Arguments], int]:
    def read(robot: RobotContext, arguments: Arguments) -> int:
        joint = robot.joint(name, arguments[0])
        angles = robot.encoders if real else robot.here
        return round(float(angles[joint] * robot.points.pulses_per_unit[joint]))

    return read


def _range(robot: RobotContext, arguments: Arguments) -> int:
    joint = robot.joint('JRange', arguments[0])
    if arguments[1] not in (1, 2):
        raise bad('JRange', f'{arguments[1]} is not 1 or 2')
    limits, per_unit = robot.controller.model.limits, robot.points.pulses_per_unit
    bounds = (limits.position_min[joint], limits.position_max[joint])
    low, high = sorted(float(bound * per_unit[joint]) for bound in bounds)
    return int(np.ceil(low) if arguments[1] == 1 else np.floor(high))


def _place(real: bool) -> Callable[[RobotContext, Arguments], Point]:
    return lambda robot, _: robot.points.place(robot.encoders if real else robot.here)


def _coordinate(axis: str) -> Callable[[RobotContext, Arguments], float]:
    return lambda robot, arguments: robot.points.coordinate(_point(arguments[0]), axis)


def _point(argument: int | float | Point) -> Point:
    if not isinstance(argument, Point):
        raise SpelError(ErrorNumber.ARGUMENT, f'{argument} is not a point')
    return argument


def _point_pulses(robot: RobotContext, arguments: Arguments) -> int:
    joint = robot.joint('PPls', arguments[1])
    return round(float(robot.points.pulses(_point(arguments[0]), robot.here)[joint]))


def _point_angle(robot: RobotContext, arguments: Arguments) -> float:
    joint = robot.joint('PAgl', arguments[1])
    return float(robot.points.degrees(_point(arguments[0]), robot.here)[joint])


def _target_ok(robot: RobotContext, arguments: Arguments) -> int:
    try:
        robot.points.joints(_point(arguments[0]), robot.here)
    except SpelError:
        return 0
    return -1


def _least_motion(robot: RobotContext, arguments: Arguments) -> Point:
    point, reference, number = arguments
    near = robot.points.joints(_point(reference), robot.here)
    return robot.points.least_motion(_point(point), near, int(number))  # type: ignore[arg-type]


def _time(robot: RobotContext, arguments: Arguments) -> float:
    """Return the duration of a Go, s, or 0 if the Go is impossible.

    It starts at the current position, or at the first of two points (SPEL+ manual p652).
    """
    start = robot.here
    try:
        for point in arguments[:-3:3]:
            start = robot.points.joints(_point(point), start)
        target = robot.points.joints(_point(arguments[-3]), start)
    except SpelError:
        return 0.0
    spel = robot.controller.spel
    return go(robot.controller.model.limits, start, target, spel.speed, spel.accel).duration


def _where(robot: RobotContext, arguments: Arguments) -> str:
    """Return the output of Where (SPEL+ manual p890). Clients depend on its columns."""
    values = _point(arguments[0]).values
    world = zip('XYZUVW', values, ('mm',) * 3 + ('deg',) * 3, strict=True)
    pulses = robot.points.pulses_per_unit * robot.here
    return '\n'.join(
        (
            'WORLD:' + ''.join(f'  {axis}:{value:9.3f} {unit}' for axis, value, unit in world),
            _joint(robot, ()),
            'PULSE:'
            + ''.join(f'  {n}:{round(value):9d} pls' for n, value in enumerate(pulses, 1)),
        )
    )


def _joint(robot: RobotContext, _: Arguments) -> str:
    model = robot.controller.model
    units = ('deg' if kind == REVOLUTE else 'mm' for kind in model.joint_types)
    shown = zip(without_rounding(robot.here * model.shown_per_unit), units, strict=True)
    return 'JOINT:' + ''.join(
        f'  {n}:{value:9.3f} {unit}' for n, (value, unit) in enumerate(shown, 1)
    )


def _find_position(robot: RobotContext, _: Arguments) -> Point:
    if robot.motion.find_position is None:
        raise SpelError(ErrorNumber.POINT_UNDEFINED, 'FindPos: no position found by Find')
    return robot.points.place(robot.motion.find_position)


def _tool(robot: RobotContext, arguments: Arguments) -> Point:
    number = arguments[0]
    tool = None if isinstance(number, Point) else robot.points.tools.get(int(number))
    if tool is None:
        raise bad('TLSet', f'tool {number} is not defined')
    return tool


def _at_home(robot: RobotContext, _: Arguments) -> int:
    home = robot.controller.spel.home
    if home is None:
        return 0
    now = np.rint(robot.encoders * robot.points.pulses_per_unit)
    return -1 if now.tolist() == list(home) else 0


VALUES: dict[str, Callable[[RobotContext, Arguments], Result]] = {
    **{name.lower(): _state(name) for name in WORDS},
    'syserr': lambda robot, _: int(robot.controller.error_number),
    'erroron': _truth(status_words.FLAGS['Error']),
    'estopon': _truth(status_words.FLAGS['EStop']),
    'safetyon': _truth(status_words.door_open),
    'pauseon': _truth(status_words.FLAGS['Paused']),
    'teachon': _truth(lambda controller: controller.condition.mode is Mode.MANUAL),
    'motor': _one(status_words.motors_on),
    'power': _one(status_words.power_high),
    'athome': _at_home,
    'where': _where,
    'joint': _joint,
    'robottype': lambda robot, _: robot_type(robot.controller.model),
    'inpos': _truth(lambda controller: not controller.in_motion),
    'js': lambda robot, _: -1 if robot.motion.sensed else 0,
    'posfound': lambda robot, _: -1 if robot.motion.find_position is not None else 0,
    'findpos': _find_position,
    'tool': lambda robot, _: robot.points.tool,
    'tlset': _tool,
    'tldef': lambda robot, arguments: -(arguments[0] in robot.points.tools),
    'arm': lambda _robot, _: 0,
    'robot': lambda _robot, _: 1,
    'robotmodel$': lambda robot, _: robot.controller.model.sales_name,
    'robotname$': lambda robot, _: robot.controller.model.name,
    'limz': lambda robot, _: robot.motion.lim_z * _MM,
    'cp': lambda robot, _: int(robot.motion.cp),
    'tillon': lambda robot, _: -1 if robot.motion.till_on else 0,
    'speed': _setting('Speed', 5),
    'accel': _setting('Accel', 5),
    'accelmax': lambda _robot, _: MAX_ACCEL,
    'speeds': _setting('SpeedS', 50),
    'accels': _setting('AccelS', 200),
    'speedfactor': _setting('SpeedFactor', 100),
    'agl': _angle,
    'pls': _pulses('Pls', real=False),
    'realpls': _pulses('RealPls', real=True),
    'jrange': _range,
    'here': _place(real=False),
    'curpos': _place(real=False),
    'realpos': _place(real=True),
    **{f'c{axis}': _coordinate(axis) for axis in 'xyzuvw'},
    'ppls': _point_pulses,
    'pagl': _point_angle,
    'targetok': _target_ok,
    'ptptime': _time,
    'ljm': _least_motion,
}
