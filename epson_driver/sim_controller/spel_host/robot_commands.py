# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Table of SPEL+ statements for the robot, except motions: motors, power, speeds, tools."""

from collections.abc import Callable, Sequence

from epson_driver.sim_controller.condition.errors import ErrorNumber
from epson_driver.sim_controller.condition.spel_settings import SETTINGS
from epson_driver.sim_controller.condition.states import Event, Motors, RejectedError
from epson_driver.sim_controller.core import Controller
from epson_driver.sim_controller.spel_host.robot_values import MAX_ACCEL, RobotContext
from epson_driver.spel import Completion, Point, SpelError, Value
from epson_driver.spel import ErrorNumber as SpelNumber
from epson_driver.spel.commands import WITHOUT_EFFECT
from epson_driver.spel.errors import bad

Arguments = Sequence[Value | Point | None]
Words = tuple[str, ...]
Run = Callable[[RobotContext, Arguments, Words], Completion | None]

_IGNORED = {'fine', 'ptpboost', 'qp', 'inertia', *map(str.lower, WITHOUT_EFFECT)}


MM = 1000.0


class ConditionCompletion:
    """Progress of a statement that ends when a condition is met."""

    error: SpelError | None = None

    def __init__(self, is_met: Callable[[], bool]) -> None:
        self._is_met = is_met

    @property
    def done(self) -> bool:
        return self._is_met()

    @property
    def fraction(self) -> float:
        return float(self.done)


def command(
    robot: RobotContext, name: str, arguments: Arguments, words: Words
) -> Completion | None:
    if name == 'weight' and words:
        raise bad('Weight', f'there is no additional axis {words[0].upper()}')
    if name in SETTING_WORDS:
        _set(robot.controller, SETTING_WORDS[name], arguments)
        return None
    if name in _IGNORED:
        return None
    return COMMANDS[name](robot, arguments, words)


def apply(
    controller: Controller, event: Event, number: ErrorNumber = ErrorNumber.MOTORS_OFF
) -> None:
    try:
        controller.apply(event)
    except RejectedError as error:
        raise SpelError(number, f'{event.value}: {error}') from error


def _set(controller: Controller, name: str, arguments: Arguments) -> None:
    numbers = tuple(float(argument) for argument in arguments if isinstance(argument, int | float))
    if name == 'Accel' and max(numbers) > MAX_ACCEL:
        text = f'Accel {max(numbers):g}: this robot takes up to AccelMax, {MAX_ACCEL} %'
        raise SpelError(SpelNumber.ARGUMENT, text)
    controller.change_setting(name, numbers)


def _motor(robot: RobotContext, _: Arguments, words: Words) -> Completion:
    controller = robot.controller
    if 'on' in words:
        apply(controller, Event.MOTORS_ON)
        _reset_cp_and_lim_z(robot)
        return ConditionCompletion(lambda: True)
    apply(controller, Event.MOTORS_OFF)
    return ConditionCompletion(lambda: controller.condition.motors in (Motors.OFF, Motors.HELD))


def _reset_cp_and_lim_z(robot: RobotContext) -> None:
    """Set CP and LimZ to their initial values (SPEL+ manual p549, p686)."""
    robot.motion.lim_z, robot.motion.cp = 0.0, False


def _power(robot: RobotContext, _: Arguments, words: Words) -> None:
    high = 'high' in words
    if high and robot.controller.condition.motors is not Motors.ON:
        return  # has no effect, because switching the motors on selects low power
    apply(robot.controller, Event.PROGRAM_POWER_HIGH if high else Event.PROGRAM_POWER_LOW)


def _reset(robot: RobotContext, _: Arguments, _words: Words) -> None:
    if robot.controller.condition.estopped:
        text = 'Reset: a program cannot reset an E-stop: release it, then reset by hand'
        raise SpelError(ErrorNumber.TASK_ABORTED, text)
    apply(robot.controller, Event.RESET, ErrorNumber.TASK_ABORTED)
    _reset_cp_and_lim_z(robot)


def _quit_all(robot: RobotContext, _: Arguments, _words: Words) -> None:
    robot.motion.abort(SpelError(ErrorNumber.MOTION_ABORTED))
    robot.controller.reset_settings()
    _reset_cp_and_lim_z(robot)
    apply(robot.controller, Event.PROGRAM_POWER_LOW)


def _start_main(robot: RobotContext, _: Arguments, _words: Words) -> None:
    condition = robot.controller.condition
    if condition.estopped or robot.controller.error_number:
        text = 'StartMain: E-stop or error: reset first'
        raise SpelError(ErrorNumber.TASK_ABORTED, text)
    apply(robot.controller, Event.START, ErrorNumber.TASK_ABORTED)


def _abort_motion(robot: RobotContext, _: Arguments, _words: Words) -> None:
    if not robot.motion.abort(SpelError(ErrorNumber.MOTION_ABORTED, 'the motion was aborted')):
        raise SpelError(ErrorNumber.NO_MOTION, 'AbortMotion: no task is moving the robot')


def _wait_position(robot: RobotContext, _: Arguments, _words: Words) -> Completion:
    return ConditionCompletion(lambda: not robot.controller.in_motion)


def _cp(robot: RobotContext, _: Arguments, words: Words) -> None:
    robot.motion.cp = 'on' in words


def _lim_z(robot: RobotContext, arguments: Arguments, _words: Words) -> None:
    (height,) = (float(argument) for argument in arguments if isinstance(argument, int | float))
    robot.motion.lim_z = height / MM


def _home_set(robot: RobotContext, arguments: Arguments, _words: Words) -> None:
    numbers = tuple(
        round(float(argument)) for argument in arguments if isinstance(argument, int | float)
    )
    try:
        robot.points.joints(Point('pulses', tuple(map(float, numbers))), robot.here)
    except SpelError as error:
        raise SpelError(error.number, f'HomeSet: {error.text}') from error
    robot.controller.spel.home = numbers


def _only(name: str, number: int) -> Run:
    def run(_robot: RobotContext, arguments: Arguments, _words: Words) -> None:
        if arguments and arguments[0] != number:
            text = f'{name} {arguments[0]}: only {number} is simulated'
            raise SpelError(SpelNumber.ARGUMENT, text)

    return run


def _tool(robot: RobotContext, arguments: Arguments, _words: Words) -> None:
    robot.points.use(round(arguments[0]))  # type: ignore[arg-type]


def _define_tool(robot: RobotContext, arguments: Arguments, _words: Words) -> None:
    number, *rest = arguments
    point = rest[0] if rest else None
    robot.points.define(
        round(number),  # type: ignore[arg-type]
        point if isinstance(point, Point) else None,
    )


SETTING_WORDS = {name.lower(): name for name in SETTINGS}
COMMANDS: dict[str, Run] = {
    'motor': _motor,
    'power': _power,
    'reset': _reset,
    'quit all': _quit_all,
    'startmain': _start_main,
    'abortmotion': _abort_motion,
    'waitpos': _wait_position,
    'cp': _cp,
    'limz': _lim_z,
    'homeset': _home_set,
    'tool': _tool,
    'tlset': _define_tool,
    'tlclr': _define_tool,
    'arm': _only('Arm', 0),
    'robot': _only('Robot', 1),
}
