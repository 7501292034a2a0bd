# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Rules of the linter about unused code, unreachable code, and use by two tasks."""

import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping

from epson_driver.spel.code import Program
from epson_driver.spel.commands import MOVING
from epson_driver.spel.errors import Position, Problem
from epson_driver.spel.scope import constant
from epson_driver.spel.syntax import (
    Command,
    Declaration,
    Do,
    EResume,
    Exit,
    Expression,
    Function,
    If,
    Jump,
    Label,
    Motion,
    Return,
    Select,
    Statement,
    Stub,
    TaskCommand,
    inner_blocks,
    walk,
)
from epson_driver.spel.words import CONSTANTS

_MOVED = 'the robot is moved by'
_WINDOWS = frozenset({'gshow', 'gshowdialog', 'gset', 'gget'})
"""Window statements. The events of windows call functions that no program names."""


def leaves(statement: Statement) -> bool:
    """Return whether the following statement cannot be reached from this one."""
    if isinstance(statement, Exit | EResume | Return):
        return True
    if isinstance(statement, Do):
        tests = [test for test in (statement.before, statement.after) if test is not None]
        ends = any(_truth(test.condition) is not (not test.until) for test in tests)
        return not ends and not any(_leaves_loop(each) for each in walk(statement.body))
    if isinstance(statement, If | Select):
        blocks = inner_blocks(statement)
        return all(block and leaves(block[-1]) for block in blocks)
    if isinstance(statement, TaskCommand):
        return (
            statement.name.lower() == 'quit' and statement.task is None and not statement.function
        )
    return isinstance(statement, Jump) and statement.kind == 'goto'


def _truth(condition: Expression) -> bool | None:
    value = constant(condition, CONSTANTS)
    return None if value is None else value != 0


def _leaves_loop(node: object) -> bool:
    return (isinstance(node, Exit) and node.what == 'do') or isinstance(node, Jump)


def unreachable(functions: Mapping[str, Function]) -> Iterator[Problem]:
    """Yield the first statement after each statement that always jumps elsewhere."""
    for function in functions.values():
        yield from _dead(function.body)


def _dead(block: tuple[Statement, ...]) -> Iterator[Problem]:
    before: Statement | None = None
    for statement in block:
        plain = not isinstance(statement, Label | Declaration)
        if before is not None and plain and leaves(before):
            text = f'it is never reached: line {before.at.line} goes elsewhere'
            yield Problem(statement.at, 'unreachable', text, warning=True)
        for each in inner_blocks(statement):
            yield from _dead(each)
        before = statement


def unused(program: Program, files: Mapping[str, str], roots: set[str]) -> Iterator[Problem]:
    """Yield functions and variables whose name occurs once. `roots` start tasks.

    An occurrence in a comment or in an inactive #ifdef counts as a use.
    """
    times = Counter(name for text in files.values() for name in _names(text))
    functions = [each for file in program.files for each in file.functions]
    words = {node.name.lower() for node in walk(program.files) if isinstance(node, Command | Stub)}
    if 'main' in roots and not words & _WINDOWS:
        for function in functions:
            name = function.name.lower()
            if times[name] == 1 and name not in roots and not name.startswith('test'):
                text = f'nothing calls {function.name}'
                yield Problem(function.at, 'unused', text, warning=True)
    for file in program.files:
        module = [each for each in file.declarations if each.scope == 'module']
        yield from _once(module, Counter(_names(files.get(file.name, ''))))
        lines = files.get(file.name, '').split('\n')
        for function in file.functions:
            text = '\n'.join(lines[function.at.line - 1 : function.end.line])
            own = [each for each in walk(function.body) if isinstance(each, Declaration)]
            yield from _once(own, Counter(_names(text)))


def _names(text: str) -> Iterator[str]:
    """Yield the names of a text in lower case, with Pi as a possible variable."""
    for word in re.findall(r'[^\W\d]\w*\$?', text.lower()):
        yield word
        if word[0] == 'p':
            yield word[1:]


def _once(declarations: list[Declaration], times: Counter[str]) -> Iterator[Problem]:
    for declaration in declarations:
        for variable in declaration.variables:
            if times[variable.name.lower()] == 1:
                text = f'nothing uses {variable.name}'
                yield Problem(variable.at, 'unused', text, warning=True)


def shared(tasks: Mapping[str, set[str]], functions: Mapping[str, Function]) -> Iterator[Problem]:
    """Yield a second task that moves the robot, sets a timer, or switches an output.

    `tasks`: function that starts a task → the functions that it calls.
    """
    owners: dict[str, dict[str, Position]] = {}
    for root, called in tasks.items():
        of_many = any(_chooses_robot(functions[name]) for name in called)
        for name in sorted(called):
            for what, at in _owned(functions[name]):
                if of_many and what == _MOVED:
                    continue
                owners.setdefault(what, {}).setdefault(root, at)
    for what, users in owners.items():
        if len(users) > 1:
            names = ' and '.join(sorted(users))
            text = f'{what} the tasks {names}: only one should'
            yield Problem(max(users.values()), 'two-owners', text, warning=True)


def _chooses_robot(function: Function) -> bool:
    return any(
        isinstance(node, Command) and node.name.lower() == 'robot' for node in walk(function.body)
    )


def _owned(function: Function) -> Iterator[tuple[str, Position]]:
    of: dict[str, Callable[[float], str]] = {
        'tmreset': lambda number: f'timer {number:g} is set by',
        'on': lambda number: f'output {number:g} is switched by',
        'off': lambda number: f'output {number:g} is switched by',
    }
    for node in walk(function.body):
        if isinstance(node, Motion) or (isinstance(node, Command) and node.name.lower() in MOVING):
            yield _MOVED, node.at
        elif isinstance(node, Command) and node.name.lower() in of:
            first = node.arguments[0]
            number = None if first is None else constant(first, CONSTANTS)
            if number is not None:
                yield of[node.name.lower()](number), node.at
