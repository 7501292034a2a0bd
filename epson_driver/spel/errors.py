# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Problems found in a program before it starts, and errors while it runs."""

from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

from epson_driver.error_texts import load_error_texts
from epson_driver.inputs import InputError, printable

LISTED = 20
"""Maximum number of problems listed in one exception."""


SETTINGS_FILE = 'spel.yaml'
"""Name of the file in a project's folder with settings that RC+ stores outside the project."""


def to_add(key: str, line: str) -> str:
    return f'add `{line}` under `{key}:` in {SETTINGS_FILE}'


class Position(NamedTuple):
    """A position in the source: file, line and column, both counted from 1."""

    file: str
    line: int
    column: int = 1

    def __str__(self) -> str:
        return f'{printable(self.file)}:{self.line}:{self.column}'


@dataclass(frozen=True, slots=True)
class Problem:
    position: Position
    rule: str
    text: str
    warning: bool = False

    def __str__(self) -> str:
        kind = 'warning' if self.warning else 'error'
        return f'{self.position}: {kind}: {printable(self.text)} [{self.rule}]'


class ProgramError(InputError):
    """A program that cannot be started. The text lists the problems, one in each line."""

    def __init__(self, problems: list[Problem]) -> None:
        more = len(problems) - LISTED
        lines = [str(problem) for problem in problems[:LISTED]]
        super().__init__('\n'.join([*lines, f'and {more} more'] if more > 0 else lines))
        self.problems = problems


class SyntaxProblem(Exception):  # noqa: N818 - it is caught line by line, and becomes a Problem
    def __init__(self, position: Position, text: str, rule: str = 'syntax') -> None:
        super().__init__(f'{position}: {text}')
        self.problem = Problem(position, rule, text)


class ErrorNumber(IntEnum):
    """Error numbers that the language itself raises.

    Numbers from 9990 are specific to this interpreter, because the available documents do not list
    the numbers of a controller. A program must not depend on these numbers.
    """

    LOOP_LEFT = 2020
    NO_HOME = 2228
    TASK_NUMBER = 2260
    NO_SUCH_TASK = 2261
    WAIT_TIMEOUT = 2280
    RETURN_WITHOUT_GOSUB = 2383
    NO_LIBRARY = 2473
    INPUT_COUNT = 2505
    ENDLESS_LOOP = 2556
    NETWORK = 2902
    PORT_IN_USE = 2907
    PORT_NOT_OPEN = 2909
    READ_TIMEOUT = 2910
    POINT_UNDEFINED = 7007
    NO_SUCH_FILE = 7213
    OVERFLOW = 9990
    DIVISION_BY_ZERO = 9991
    INDEX = 9992
    ARGUMENT = 9993
    STRING_LENGTH = 9994
    CALL_DEPTH = 9995
    TASK_TYPE = 9996
    SYNC = 9997
    RESUME = 9998
    NOT_SIMULATED = 9999


TEXTS: dict[int, str] = {
    ErrorNumber.NO_SUCH_TASK: 'the task does not exist',
    ErrorNumber.ENDLESS_LOOP: 'an endless loop without a Wait: add a Wait of 0.01 s or more',
    ErrorNumber.NETWORK: 'network error: the peer is lost',
    ErrorNumber.PORT_IN_USE: 'the port belongs to another task',
    ErrorNumber.OVERFLOW: 'the value does not fit its type',
    ErrorNumber.DIVISION_BY_ZERO: 'division by zero: check the divisor first',
    ErrorNumber.INDEX: 'an array index is out of range: it goes from 0 to UBound',
    ErrorNumber.ARGUMENT: 'an argument is out of range',
    ErrorNumber.STRING_LENGTH: 'a string is longer than 255 characters',
    ErrorNumber.CALL_DEPTH: 'functions call each other without end',
    ErrorNumber.TASK_TYPE: 'this type of task cannot execute the statement',
    ErrorNumber.SYNC: 'SyncLock twice, or SyncUnlock by a task that has not locked',
    ErrorNumber.RESUME: 'EResume without an error',
    ErrorNumber.NOT_SIMULATED: f'not simulated: a result can be in {SETTINGS_FILE}',
}
"""Texts that explain an error better to a programmer than the table of the controller's errors."""


OWN_NUMBERS = range(9990, 9999)
USER_ERRORS = range(8000, 9000)


def meaning(number: int) -> str:
    """Return the meaning of an error number, without the messages that a project defines."""
    if number in USER_ERRORS:
        return 'an error defined by the program: handle it (OnErr), or add it to UserErrors.dat'
    result = load_error_texts('epson').get(number)
    return TEXTS.get(number) or (result.meaning if result else 'see the manual')


class SpelError(Exception):
    def __init__(self, number: int, text: str = '') -> None:
        self.number = int(number)
        self.text = text or meaning(self.number)
        super().__init__(f'error {self.number}: {self.text}')


def bad(name: str, text: str) -> SpelError:
    return SpelError(ErrorNumber.ARGUMENT, f'{name}: {text}')


@dataclass(frozen=True, slots=True)
class TaskError:
    number: int
    text: str
    position: Position
    function: str
    task: int

    def __str__(self) -> str:
        text = printable(self.text)
        return f'{self._line}: error {self.number} in {self.function} (task {self.task}): {text}'

    @property
    def details(self) -> str:
        """Return text, file, line and function, for messages that already contain the number."""
        return f'{printable(self.text)}, at {self._line} in {self.function} (task {self.task})'

    @property
    def _line(self) -> str:
        return f'{printable(self.position.file)}:{self.position.line}'
