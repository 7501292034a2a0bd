# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What of SPEL+ the simulated controller does not do is refused before a program starts."""

from collections.abc import Iterator
from dataclasses import fields, is_dataclass

from epson_driver.sim_controller.spel_host.robot_commands import (
    COMMANDS,
    SETTING_WORDS,
    WITHOUT_EFFECT,
)
from epson_driver.sim_controller.spel_host.robot_ways import MOVES
from epson_driver.spel import Problem, Program, ProgramError
from epson_driver.spel.commands import COMMANDS as STATEMENTS
from epson_driver.spel.syntax import Command, Motion

RULE = 'not-simulated'


def refuse_unsimulated(program: Program) -> None:
    """Raise ProgramError with name, file and line of each statement that is not simulated."""
    problems = [
        Problem(found.at, RULE, f'{found.name} is not simulated by this controller')
        for found in _statements(program.files)
        if not _simulated(found)
    ]
    if problems:
        raise ProgramError(problems)


def _simulated(found: Command | Motion) -> bool:
    name = found.name.lower()
    if isinstance(found, Motion):
        return name in MOVES and not found.find and not found.sense
    rule = STATEMENTS.get(name)
    own = rule is None or not rule.robot
    return own or name in COMMANDS or name in SETTING_WORDS or name in WITHOUT_EFFECT


def _statements(node: object) -> Iterator[Command | Motion]:
    """Yield the statements of the table that stand in a tree."""
    if isinstance(node, Command | Motion):
        yield node
    if isinstance(node, tuple | list):
        for each in node:
            yield from _statements(each)
    elif is_dataclass(node):
        for field in fields(node):
            yield from _statements(getattr(node, field.name))
