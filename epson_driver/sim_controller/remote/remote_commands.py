# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Table of EPSON's Remote Ethernet commands, and their execution.

A command is one line, and so is its answer. `$Cmd,parameters` is answered with `#Cmd,value` or
`!Cmd,error`. The answer repeats the client's spelling of the name. The value is 0 for commands
without a value. `$Execute` is answered when its statement has ended. Names, acceptance and answers
follow the RC+ user's guides, Remote Ethernet, and EPSON's client for Node-RED. `$Sim,…`
(sim_commands.py) exists in the simulation only.
"""

import logging
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from epson_driver.remote_ethernet.client import RemoteErrorNumber
from epson_driver.robots.model import robot_type
from epson_driver.sim_controller.condition.errors import ErrorNumber as Shown
from epson_driver.sim_controller.condition.errors import Rejection
from epson_driver.sim_controller.condition.states import Event, Power, RejectedError
from epson_driver.sim_controller.core import Controller
from epson_driver.sim_controller.io.io_points import BYTE_BITS, WORD_BITS, IoError
from epson_driver.sim_controller.remote import remote_acceptance as requirements
from epson_driver.sim_controller.remote import status_words
from epson_driver.sim_controller.remote.remote_acceptance import (
    CommandError,
    Requirement,
    check,
    expect,
    hexadecimal,
    parameter_error,
    robot,
    switch,
    whole,
)
from epson_driver.sim_controller.remote.sim_commands import simulate
from epson_driver.simple_message import IoType
from epson_driver.spel import ErrorNumber, ProgramError, SpelError
from epson_driver.spel.errors import OWN_NUMBERS

_log = logging.getLogger(__name__)

_MAX_ADDRESS = 65_535
MAX_CHARACTERS = 4060
"""Maximum length of the text of $Execute, and of its output (RC+ 7.0 user's guide)."""

_SIMULATED = 'simulated'

_PREFERENCES = f'{1 << 14 | 1:023b}'
"""The answer to `GetContSettings`: background tasks and advanced commands are enabled."""


@dataclass(slots=True)
class Dialogue:
    """The state of one client's session.

    `why` is the reason why the last command was refused. `send` is called with the answer to a
    command that takes time, without its terminator.
    """

    controller: Controller
    send: Callable[[str], None]
    enter: Callable[[], None] = lambda: None
    """Function called before a login.

    It raises ConnectionRefusedError if another client is logged in.
    """
    logged_in: bool = False
    why: str = ''
    spelt: str = ''


Run = Callable[[Dialogue, list[str]], str | None]


@dataclass(frozen=True, slots=True)
class Command:
    """A remote command. Surplus parameters are ignored, because real clients send `$GetStatus,0`.

    * `usage`, `text`: the parameters, and a description.
    * `run`: function that executes the command and returns its value, if any.
    * `event`: event that is applied after `run`. In this case `run` only checks the parameters.
    * `whole`: whether all text after the first comma is one parameter.
    * `always`: whether the command is accepted even while `$Execute` is executing.
    """

    usage: str
    text: str
    requirements: tuple[Requirement, ...]
    run: Run
    event: Event | None = None
    whole: bool = False
    always: bool = False

    @property
    def max_parameters(self) -> int | None:
        if self.usage.endswith('…'):
            return None
        return len(self.usage.split(',')) if self.usage else 0


class _LaterError(Exception):
    """Raised by a command that takes time, so that its answer is sent later."""


def answer(dialogue: Dialogue, line: str) -> str | None:
    """Execute one line and return the answer, both without their terminator.

    Return None if the command takes time. `dialogue.send` is then called with the answer.
    """
    spelt, comma, rest = line.removeprefix('$').partition(',')
    dialogue.spelt = spelt = spelt.strip()
    name = _CANONICAL.get(spelt.lower(), spelt)
    try:
        return f'#{spelt},{_run_command(dialogue, line, name, rest if comma else None)}'
    except _LaterError:
        return None
    except CommandError as error:
        return _refused(dialogue, spelt, error)
    except RejectedError as rejection:
        refusal = CommandError(RemoteErrorNumber.NOT_READY, str(rejection))
        return _refused(dialogue, spelt, refusal)


def _refused(dialogue: Dialogue, spelt: str, error: CommandError) -> str:
    dialogue.why = str(error)
    # A driver asks all the time, and every answer during a motion is this one.
    level = logging.DEBUG if error.number == RemoteErrorNumber.EXECUTING else logging.WARNING
    _log.log(level, 'remote command %s refused (%d): %s', spelt, error.number, error)
    return f'!{spelt},{error.number:d}'


def _run_command(dialogue: Dialogue, line: str, name: str, rest: str | None) -> str:
    if not line.startswith('$'):
        raise CommandError(RemoteErrorNumber.NO_DOLLAR, 'the command does not start with $')
    command = COMMANDS.get(name)
    if command is None:
        raise CommandError(RemoteErrorNumber.BAD_COMMAND, f'unknown command {name}')
    if not dialogue.logged_in and name not in ('Login', 'Sim'):
        raise CommandError(RemoteErrorNumber.BAD_COMMAND, 'no client is logged in')
    required = command.requirements
    if dialogue.controller.command_window.executes:
        if not command.always:
            text = 'a statement is being executed: wait for its end, or Abort'
            raise CommandError(RemoteErrorNumber.EXECUTING, text)
        required = tuple(item for item in required if item is not requirements.READY)
    parameters = [] if rest is None else [rest] if command.whole else rest.split(',')
    if not command.whole:
        parameters = [part.strip() for part in parameters[: command.max_parameters]]
    value = None
    if command.event is not None:
        command.run(dialogue, parameters)
    check(dialogue.controller, required, command.event)
    if command.event is not None:
        dialogue.controller.apply(command.event)
    else:
        value = command.run(dialogue, parameters)
    return '0' if value is None else value


def _login(dialogue: Dialogue, parameters: list[str]) -> None:
    password = dialogue.controller.profile.remote.password
    if password and ''.join(parameters) != password:
        raise CommandError(RemoteErrorNumber.PASSWORD, 'the password is wrong')
    if not dialogue.logged_in:
        dialogue.enter()
    dialogue.logged_in = True


def _logout(dialogue: Dialogue, _: list[str]) -> None:
    dialogue.logged_in = False


def _plain(_dialogue: Dialogue, _: list[str]) -> None:
    """Accept any parameters, because the command uses none."""


def _robot(_dialogue: Dialogue, parameters: list[str]) -> None:
    robot(parameters)


def _start(_dialogue: Dialogue, parameters: list[str]) -> None:
    expect(parameters, 1)
    if whole('function', parameters[0], 0, 63) != 0:
        raise parameter_error('function', parameters[0], 'must be 0, main')


def _set_cur_robot(_dialogue: Dialogue, parameters: list[str]) -> None:
    expect(parameters, 1)
    robot(parameters)


def _home(dialogue: Dialogue, parameters: list[str]) -> None:
    robot(parameters)
    _start_statement(dialogue, 'Home')


def _get_io(io_type: IoType, width: int, dialogue: Dialogue, parameters: list[str]) -> str:
    expect(parameters, 1)
    index = whole('address', parameters[0], 0, _MAX_ADDRESS)
    try:
        value = dialogue.controller.io.read_port(io_type, index, width)
    except IoError as error:
        raise CommandError(RemoteErrorNumber.PARAMETER, str(error)) from error
    return f'{value:0{max(width // 4, 1)}X}'


def _set_io(io_type: IoType, width: int, dialogue: Dialogue, parameters: list[str]) -> None:
    expect(parameters, 2)
    index = whole('address', parameters[0], 0, _MAX_ADDRESS)
    text = parameters[1]
    value = switch('value', text) if width == 1 else hexadecimal('value', text, 2**width - 1)
    try:
        dialogue.controller.io.write_port(io_type, index, width, int(value))
    except IoError as error:
        raise CommandError(RemoteErrorNumber.PARAMETER, str(error)) from error


def _variable(minimum: int, maximum: int, _dialogue: Dialogue, parameters: list[str]) -> None:
    expect(parameters, minimum, maximum)
    raise parameter_error(
        'variable', parameters[0], 'the program has no Global Preserve variables'
    )


def _get_status(dialogue: Dialogue, _: list[str]) -> str:
    return f'{status_words.flags(dialogue.controller)},{dialogue.controller.error_number:04d}'


def _execute(dialogue: Dialogue, parameters: list[str]) -> str | None:
    """Execute the text between the first and the last quote. It may contain further quotes."""
    text = parameters[0] if parameters else ''
    if len(text) < 2 or not text.startswith('"') or not text.rstrip().endswith('"'):
        raise CommandError(RemoteErrorNumber.FORMAT, 'statements must be in double quotes')
    if len(text) > MAX_CHARACTERS:
        text = f'statements and their output may have {MAX_CHARACTERS} characters'
        raise CommandError(RemoteErrorNumber.FORMAT, text)
    return _start_statement(dialogue, text.rstrip()[1:-1])


def _start_statement(dialogue: Dialogue, text: str) -> str | None:
    """Start a statement and return its output.

    Raises _LaterError if the statement takes time.
    """
    over: list[str | SpelError] = []
    answers_later, spelt = False, dialogue.spelt

    def ended(value: str | SpelError) -> None:
        over.append(value)
        if answers_later:
            try:
                dialogue.send(f'#{spelt},{_printed(dialogue, value) or 0}')
            except CommandError as error:
                dialogue.send(_refused(dialogue, spelt, error))

    try:
        dialogue.controller.command_window.execute(text, ended)
    except ProgramError as error:
        problem = error.problems[0]
        numbers = {'syntax': RemoteErrorNumber.FORMAT}
        number = numbers.get(problem.rule, RemoteErrorNumber.PARAMETER)
        raise CommandError(number, problem.text) from error
    if over:
        return _printed(dialogue, over[0])
    answers_later = True
    raise _LaterError


def _printed(dialogue: Dialogue, value: str | SpelError) -> str | None:
    if isinstance(value, SpelError):
        if value.number == ErrorNumber.TASK_TYPE:
            raise CommandError(RemoteErrorNumber.NOT_READY, value.text)
        if value.number == ErrorNumber.NOT_SIMULATED:
            raise CommandError(RemoteErrorNumber.PARAMETER, value.text)
        if value.number not in (*OWN_NUMBERS, Shown.MOTION_ABORTED, ErrorNumber.NO_HOME):
            dialogue.controller.errors.enter(Rejection(value.number, value.text))
        raise CommandError(RemoteErrorNumber.SYSTEM, f'error {value.number}: {value.text}')
    return f'"{value[:MAX_CHARACTERS]}"' if value else None


def _abort(dialogue: Dialogue, _: list[str]) -> None:
    dialogue.controller.command_window.abort_command('the command was aborted by Abort')


def _get_motor(dialogue: Dialogue, parameters: list[str]) -> str:
    robot(parameters)
    condition = dialogue.controller.condition
    return f'1,{condition.powered:d},{condition.power is Power.HIGH:d}'


def _get_robot_info(dialogue: Dialogue, _: list[str]) -> str:
    model = dialogue.controller.model
    return f'1,{robot_type(model)},{model.sales_name}'


def _get_robot_name(dialogue: Dialogue, parameters: list[str]) -> str:
    robot(parameters)
    return f'1,{dialogue.controller.model.name}'


def _get_robot_serial(_dialogue: Dialogue, parameters: list[str]) -> str:
    robot(parameters)
    return f'1,{_SIMULATED}'


def _get_err_msg(dialogue: Dialogue, parameters: list[str]) -> str:
    expect(parameters, 1, 2)
    number = whole('error', parameters[0], 0, 9999)
    if len(parameters) > 1:
        whole('language', parameters[1], 0, 5)
    return dialogue.controller.error_text(number)


def _get_err_func(_dialogue: Dialogue, parameters: list[str]) -> str:
    expect(parameters, 1)
    whole('error', parameters[0], 0, 9999)
    return '0'


def _fixed(value: str) -> Run:
    def run(_dialogue: Dialogue, _: list[str]) -> str:
        return value

    return run


def _get_cont_type(dialogue: Dialogue, _: list[str]) -> str:
    return dialogue.controller.profile.name.upper()


def _get_hofs(dialogue: Dialogue, parameters: list[str]) -> str:
    robot(parameters)
    return ','.join('0' for _ in dialogue.controller.model.limits.names)


def _sim(dialogue: Dialogue, parameters: list[str]) -> str | None:
    if [part.lower() for part in parameters] == ['why']:
        return dialogue.why
    if parameters and parameters[0].lower() == 'print':
        if dialogue.controller.command_window.executes:
            raise CommandError(RemoteErrorNumber.EXECUTING, 'a statement is being executed')
        printed = _start_statement(dialogue, f'Print {",".join(parameters[1:])}')
        return printed and printed[1:-1]
    return simulate(dialogue.controller, parameters)


_FREE: tuple[Requirement, ...] = ()
_AUTO = (requirements.AUTO,)
_IDLE = (requirements.AUTO, requirements.READY)
_OFF = (requirements.AUTO, requirements.NO_PROGRAM)
_SAFE = (requirements.AUTO, requirements.NO_ESTOP, requirements.NO_SAFEGUARD, requirements.READY)
_SOUND = (
    requirements.AUTO,
    requirements.NO_ESTOP,
    requirements.NO_SAFEGUARD,
    requirements.NO_ERROR,
    requirements.READY,
)
"""Requirements of commands. The first requirement that is not met is reported as the reason."""


_SPACES = {
    'IO': (IoType.DIGITAL_INPUT, 'input', IoType.DIGITAL_OUTPUT, 'output'),
    'MemIO': (IoType.FLAG, 'memory', IoType.FLAG, 'memory'),
}
_SIZES = {'': (1, 'bit'), 'Byte': (BYTE_BITS, 'port'), 'Word': (WORD_BITS, 'word')}
_SET_WHEN_READY = ('SetIO', 'SetIOByte')
"""Commands for I/O that only require Ready. The other commands that set I/O also require AUTO."""


def _io_commands() -> dict[str, Command]:
    rows = {}
    for space, (readable, source, writable, target) in _SPACES.items():
        for size, (width, address) in _SIZES.items():
            name = f'Set{space}{size}'
            rows[f'Get{space}{size}'] = Command(
                address, f'read {source} {address}', _FREE, partial(_get_io, readable, width)
            )
            rows[name] = Command(
                f'{address},value',
                f'set {target} {address}',
                (requirements.READY,) if name in _SET_WHEN_READY else _IDLE,
                partial(_set_io, writable, width),
                always=True,
            )
    return rows


COMMANDS: dict[str, Command] = {
    'Login': Command('password', 'log in, needed first', _FREE, _login, whole=True, always=True),
    'Logout': Command('', 'end', _FREE, _logout),
    'Start': Command('0', 'start the tasks', _SOUND, _start, Event.START),
    'Stop': Command('', 'stop the tasks', _AUTO, _plain, Event.STOP),
    'Pause': Command('', 'pause the tasks', (*_AUTO, requirements.TASKS_RUN), _plain, Event.PAUSE),
    'Continue': Command('', 'resume tasks', (*_AUTO, requirements.PAUSED), _plain, Event.CONTINUE),
    'Reset': Command('', 'clear E-stop and error', _IDLE, _plain, Event.RESET),
    'SetMotorsOn': Command('robot', 'motors on', _SAFE, _robot, Event.MOTORS_ON),
    'SetMotorsOff': Command('robot', 'motors off', _OFF, _robot, Event.MOTORS_OFF),
    'SetCurRobot': Command('robot', 'select the robot', _IDLE, _set_cur_robot),
    'GetCurRobot': Command('', 'the selected robot', _FREE, _fixed('1')),
    'Home': Command('robot', 'move to the home position', _SOUND, _home),
    **_io_commands(),
    'GetVariable': Command('name,…', 'no variables here', _FREE, partial(_variable, 1, 3)),
    'SetVariable': Command('name,value,…', 'no variables here', _IDLE, partial(_variable, 2, 3)),
    'GetStatus': Command('', 'flags, error number', _FREE, _get_status, always=True),
    'Execute': Command('"statement"', 'execute statements', _SOUND, _execute, whole=True),
    'Abort': Command('', 'end the execution', _AUTO, _abort, always=True),
    'GetMotor': Command('robot', 'robots, motors on, power high', _FREE, _get_motor),
    'GetRobotInfo': Command('', 'robots, type, model', _FREE, _get_robot_info),
    'GetRobotName': Command('robot', 'robots, name', _FREE, _get_robot_name),
    'GetRobotSerial': Command('robot', 'robots, serial number', _FREE, _get_robot_serial),
    'GetErrMsg': Command('error,language', 'text of an error', _FREE, _get_err_msg),
    'GetErrFunc': Command('error', '0: the function is unknown', _FREE, _get_err_func),
    'GetContName': Command('', '0: it has no name', _FREE, _fixed('0')),
    'GetContNo': Command('', 'serial number', _FREE, _fixed(_SIMULATED)),
    'GetContVer': Command('', 'firmware', _FREE, _fixed(_SIMULATED)),
    'GetContType': Command('', 'controller', _FREE, _get_cont_type),
    'GetContDev': Command(
        '', 'device in control', _FREE, _fixed(str(status_words.CONTROL_DEVICE))
    ),
    'GetContSettings': Command('', 'preferences, bits', _FREE, _fixed(_PREFERENCES)),
    'GetContMacAdd': Command('', 'MAC address', _FREE, _fixed('00-00-00-00-00-00')),
    'GetSubnetMask': Command('', 'subnet mask', _FREE, _fixed('255.255.255.0')),
    'GetDefaultGateway': Command('', 'default gateway', _FREE, _fixed('0.0.0.0')),  # noqa: S104 - not bound
    'GetCpuLoad': Command('', 'processor load, %', _FREE, _fixed('0')),
    'GetHofs': Command('robot', '0 for each joint', _FREE, _get_hofs),
    'GetHealthCont': Command('', '-1: no health data', _FREE, _fixed('-1')),
    'GetHealthRB': Command('robot,part,joint', '-1: no health data', _FREE, _fixed('-1')),
    'GetPartWarning': Command('robot', 'no warnings of six parts', _FREE, _fixed('0,0,0,0,0,0')),
    'GetPrjName': Command('', 'project', _FREE, _fixed('epson_driver')),
    'Sim': Command('…', 'only in the simulation', _FREE, _sim, always=True),
}
_CANONICAL = {name.lower(): name for name in COMMANDS}
