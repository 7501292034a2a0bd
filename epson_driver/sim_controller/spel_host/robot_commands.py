# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Statements that set up the robot, as one table: motors, power, speeds, stopping."""

from collections.abc import Callable, Sequence

from epson_driver.sim_controller.condition.errors import ErrorNumber
from epson_driver.sim_controller.condition.spel_settings import SETTINGS
from epson_driver.sim_controller.condition.states import Event, Motors, RejectedError
from epson_driver.sim_controller.core import Controller
from epson_driver.sim_controller.spel_host.robot_values import Robot
from epson_driver.spel import Completion, Point, SpelError, Value
from epson_driver.spel import ErrorNumber as SpelNumber

Arguments = Sequence[Value | Point | None]
Words = tuple[str, ...]
Run = Callable[[Robot, Arguments, Words], Completion | None]

WITHOUT_EFFECT = ('fine', 'arch', 'ptpboost', 'qp')
"""Taken, and nothing follows: there is nothing here that they would change."""


MM = 1000.0


class Until:
    """Something that is over once a condition holds."""

    error: SpelError | None = None

    def __init__(self, holds: Callable[[], bool]) -> None:
        self._holds = holds

    @property
    def done(self) -> bool:
        """Return whether it is over."""
        return self._holds()


def command(robot: Robot, name: str, arguments: Arguments, words: Words) -> Completion | None:
    """Execute a statement by its name in lower case. Raises SpelError.

    What is in none of the tables, unsimulated.py has refused before the program began.
    """
    if name in SETTING_WORDS:
        _set(robot.controller, SETTING_WORDS[name], arguments)
        return None
    if name in WITHOUT_EFFECT:
        return None
    return COMMANDS[name](robot, arguments, words)


def apply(
    controller: Controller, event: Event, number: ErrorNumber = ErrorNumber.MOTORS_OFF
) -> None:
    """Apply an event. Raises SpelError with the number and the reason why it is refused."""
    try:
        controller.apply(event)
    except RejectedError as error:
        raise SpelError(number, f'{event.value}: {error}') from error


def _set(controller: Controller, name: str, arguments: Arguments) -> None:
    setting = SETTINGS[name]
    numbers = tuple(float(each) for each in arguments if isinstance(each, int | float))
    for number in numbers:
        if not setting.low <= number <= setting.high:
            rule = f'must be {setting.low:g} to {setting.high:g} {setting.unit}'
            raise SpelError(SpelNumber.ARGUMENT, f'{name} {number:g}: {rule}')
    controller.change_setting(name, numbers)


def _motor(robot: Robot, _: Arguments, words: Words) -> Completion:
    controller = robot.controller
    if 'on' in words:
        apply(controller, Event.MOTORS_ON)
        return Until(lambda: True)
    apply(controller, Event.MOTORS_OFF)
    return Until(lambda: controller.condition.motors in (Motors.OFF, Motors.HELD))


def _power(robot: Robot, _: Arguments, words: Words) -> None:
    high = 'high' in words
    if high and robot.controller.condition.motors is not Motors.ON:
        return  # it would be low again with the motors
    apply(robot.controller, Event.PROGRAM_POWER_HIGH if high else Event.PROGRAM_POWER_LOW)


def _reset(robot: Robot, _: Arguments, _words: Words) -> None:
    if robot.controller.condition.estopped:
        text = 'Reset: no program can reset an E-stop: release it, then reset by hand'
        raise SpelError(ErrorNumber.TASK_ABORTED, text)
    apply(robot.controller, Event.RESET, ErrorNumber.TASK_ABORTED)


def _quit_all(robot: Robot, _: Arguments, _words: Words) -> None:
    robot.motion.abort(SpelError(ErrorNumber.MOTION_ABORTED))
    robot.controller.forget_settings()
    robot.motion.lim_z = 0.0
    apply(robot.controller, Event.PROGRAM_POWER_LOW)


def _start_main(robot: Robot, _: Arguments, _words: Words) -> None:
    """Look whether main may be started now; what starts it is the interpreter."""
    condition = robot.controller.condition
    if condition.estopped or robot.controller.error_number:
        text = 'StartMain: there is an E-stop or an error: reset first'
        raise SpelError(ErrorNumber.TASK_ABORTED, text)
    apply(robot.controller, Event.START, ErrorNumber.TASK_ABORTED)


def _abort_motion(robot: Robot, _: Arguments, _words: Words) -> None:
    if not robot.motion.abort(SpelError(ErrorNumber.MOTION_ABORTED, 'the motion was aborted')):
        raise SpelError(ErrorNumber.NO_MOTION, 'AbortMotion: no task moves the robot')


def _wait_position(robot: Robot, _: Arguments, _words: Words) -> Completion:
    return Until(lambda: not robot.controller.in_motion)


def _cp(robot: Robot, _: Arguments, words: Words) -> None:
    robot.motion.cp = 'on' in words


def _lim_z(robot: Robot, arguments: Arguments, _words: Words) -> None:
    (height,) = (float(each) for each in arguments if isinstance(each, int | float))
    robot.motion.lim_z = height / MM


def _zero_only(name: str) -> Run:
    def run(_robot: Robot, arguments: Arguments, _words: Words) -> None:
        if arguments and arguments[0] != 0:
            raise SpelError(SpelNumber.ARGUMENT, f'{name} {arguments[0]}: only 0 is simulated')

    return run


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
    'tool': _zero_only('Tool'),
}
"""By name in lower case, besides the settings and those without effect."""
