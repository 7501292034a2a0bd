# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`spel check`: errors in a program, and likely problems on a controller.

An error is code that a controller of the selected version refuses, or that fails on it. A warning
is code that the language does not define, or that usually fails. Each rule has a name and a row in
docs/spel.md.
"""

import re
from collections import defaultdict
from collections.abc import Callable, Container, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from epson_driver.inputs.rc_files import RcFileError, header_fault, parsed
from epson_driver.spel.code import Program
from epson_driver.spel.commands import (
    COMMANDS,
    TASK_TYPE_WORDS,
    TRAP_EVENTS,
    TYPES,
    TaskType,
    forbidden,
)
from epson_driver.spel.errors import Position, Problem, to_add
from epson_driver.spel.functions import FUNCTIONS
from epson_driver.spel.lint_rules import (
    UNPROVEN,
    arrays,
    included,
    leaves,
    literals,
    shared,
    unproven,
    unreachable,
    unused,
)
from epson_driver.spel.project import Parsed, build_with, reserved_names
from epson_driver.spel.project_data import INCLUDE, PROGRAM, PROJECT, encoded, listed_files
from epson_driver.spel.scope import ONE_WHEN_ON, constant
from epson_driver.spel.settings import Settings
from epson_driver.spel.syntax import (
    Apply,
    Assign,
    Binary,
    Block,
    Call,
    Command,
    Declaration,
    Do,
    Expression,
    For,
    Function,
    If,
    Input,
    Jump,
    Label,
    Motion,
    Name,
    Number,
    OnErr,
    Print,
    Statement,
    Store,
    Stub,
    TaskCommand,
    Transfer,
    Trap,
    Wait,
    Xqt,
    inner_blocks,
    walk,
)
from epson_driver.spel.syntax import Variable as VariableName
from epson_driver.spel.words import CONSTANTS, WORDS

LONGEST_LINE = 512
LONGEST_NAME = 32
LONGEST_FUNCTION_NAME = 64
MAX_WAIT_VARIABLES = 64
_LAST = {'<': -1, '<=': 0, '>': 1, '>=': 0}
"""Comparison operator → difference between the limit and the last value for which it is true. The
last value is the largest one for `<` and `<=`, and the smallest one for `>` and `>=`."""

DEEPEST_FOR = 10

RULES = {
    'syntax': 'unreadable source text',
    'unknown': 'an unknown name',
    'not-simulated': 'a word or a port that needs a line in `spel.yaml` to run',
    'type': 'a wrong type: a number instead of a string, ByRef of another type, no As, …',
    'arguments': 'too many or too few arguments',
    'declaration': 'a name that is declared twice, or an array whose bounds are not constants',
    'array-size': 'an array with more elements than its scope allows',
    'array-index': 'an index that the array does not have',
    'overflow': 'a constant that does not fit its type',
    'string-length': 'a string of more than 255 characters',
    'label': 'a missing or duplicate label',
    'wait-condition': 'a value that Wait, Till and Trap cannot evaluate: a local, array or real',
    'preprocessor': 'an invalid directive, such as #else without #ifdef',
    'include': 'a missing file, or an #include in a function',
    'project-file': 'a file of RC+ that cannot be read, or has a wrong header',
    'line-length': 'a line of more than 512 characters',
    'reserved': 'a name that is a reserved word of SPEL+, or a predefined constant',
    'name-length': 'a variable or label over 32 characters, or a function over 64',
    'version': 'a word that the version of the controller does not have',
    'task-type': 'a statement that this type of task cannot execute',
    'wait-by-reference': 'a variable of a Wait condition that is passed ByRef',
    'wait-variables': 'more than 64 variables in Wait conditions',
    'for-depth': 'more than 10 nested For loops',
    'endless-loop': 'a loop without a Wait (error 2556)',
    'goto-out-of-loop': 'a GoTo that leaves a loop (error 2020 after many times)',
    'handler': 'an error handler that is reached without an error',
    'port-shared': 'a port that two tasks use (ChkNet -2)',
    'true-compare': 'a comparison with True, which may mean any value but 0 (p420), or -1 (p995)',
    'and-guard': 'an index that And does not guard, because both sides are evaluated',
    'real-to-integer': 'a conversion to an integer whose rounding is not documented',
    'integer-range': 'a Long value or a For loop that may exceed the range of an Integer',
    'declaration-in-loop': 'a declaration that may be executed again',
    'range': 'a number that no controller accepts: Speed 120, 5 / 0, TmReset 99',
    'unreachable': 'an unreachable statement, or a duplicate Case',
    'unused': 'an unused function or variable',
    'two-owners': 'two tasks that move the robot, set a timer, or switch an output',
    'hex': 'a number above &H7FFFFFFF, whose sign is not documented',
    'portable': 'a form that is neither in the manual nor in known programs: '
    + ', '.join(form.form for form in UNPROVEN),
}
"""Rule name → description of the problem."""

_WAITING_COMMANDS = frozenset(
    {'waitsig', 'waitnet', 'synclock', 'msgbox', 'waitpos', 'home', 'taskwait'}
)


def check(
    files: Mapping[str, str],
    version: int = 8,
    settings: Settings | None = None,
    cache: Parsed | None = None,
) -> list[Problem]:
    """Return all problems of a project on a controller with `version`, sorted by position.

    If `settings` is None, the settings are unknown, so no missing setting is reported. `cache`:
    the dictionary of the last check, so that only changed files are parsed.
    """
    problems: list[Problem] = []
    program = build_with(files, problems, problems, cache)
    lint = _Lint(program, version, files)
    for name, text in files.items():
        if name.lower().endswith((PROGRAM, INCLUDE)):
            problems.extend(_long_lines(name, text))
        elif name.lower().endswith(PROJECT):
            with suppress(RcFileError):  # build_with reports it
                problems.extend(_missing(name, text, files))
        elif fault := min((header_fault(item) for item in encoded(text)), key=len):
            problems.append(Problem(Position(name, 1), 'project-file', fault, warning=True))
    for rule in lint.rules:
        problems.extend(rule())
    if settings is not None:
        answered = {word.split()[0].lower() for word in settings.stubs}
        problems = [problem for problem in problems if not _answered(problem, answered)]
        problems.extend(lint.missing_ports(settings.ports))
    lines = {name: text.split('\n') for name, text in files.items()}
    active = (problem for problem in set(problems) if not _switched_off(problem, lines))
    return sorted(active, key=lambda problem: (problem.position, problem.rule, problem.text))


def _answered(problem: Problem, words: set[str]) -> bool:
    return problem.rule == 'not-simulated' and problem.text.split()[0].lower() in words


def _asks_for_error(handler: Block) -> bool:
    """Return whether an error handler has an If that depends on Err.

    Without an error, Err is 0.
    """
    copies = {'err'}
    for node in walk(handler):
        if isinstance(node, Assign) and getattr(node.value, 'name', '').lower() == 'err':
            copies.add(node.target.name.lower())
    tests = [test for node in walk(handler) if isinstance(node, If) for test, _ in node.branches]
    return any(getattr(item, 'name', '').lower() in copies for item in walk(tests))


def _switched_off(problem: Problem, files: Mapping[str, list[str]]) -> bool:
    """Return whether a comment in the problem's line disables the warning.

    The comment has the form `' check off: rule, …`.
    """
    lines = files.get(problem.position.file, [''])
    if not problem.warning or not 0 < problem.position.line <= len(lines):
        return False
    result = re.search(r"'.*\bcheck off:([a-z, -]*)", lines[problem.position.line - 1])
    return result is not None and problem.rule in result[1].replace(',', ' ').split()


def _missing(name: str, text: str, files: Mapping[str, str]) -> Iterator[Problem]:
    there = {file.lower() for file in files}
    for listed in listed_files(parsed(name, text)):
        if listed.lower().endswith(PROGRAM) and listed.lower() not in there:
            message = f'{listed} is missing: all .prg files are built'
            yield Problem(Position(name, 1), 'project-file', message, warning=True)


def _long_lines(name: str, text: str) -> Iterator[Problem]:
    for number, line in enumerate(text.split('\n'), 1):
        if len(line) > LONGEST_LINE:
            message = f'the line has {len(line)} characters: RC+ accepts {LONGEST_LINE}'
            yield Problem(Position(name, number, LONGEST_LINE + 1), 'line-length', message)


def _task_names(function: Function) -> Iterator[Any]:
    """Yield the nodes that contain a function's name as the name of a task.

    Examples: `TaskState(main)`, `Quit main`.
    """
    for node in function.of(TaskCommand):
        yield from walk(node.task)
    for node in function.of(Apply):
        rule = FUNCTIONS.get(node.name.lower())
        if rule is not None and rule.arguments.startswith('t') and node.arguments:
            yield from walk(node.arguments[0])


def _instead(function: str) -> bool:
    """Return whether a function is named like a start function other than main, such as main7."""
    return function.startswith('main') and function[4:].isdigit()


def _waits(node: Any) -> bool:
    if isinstance(node, Command | TaskCommand):
        return node.name.lower() in _WAITING_COMMANDS
    if isinstance(node, Print):
        return node.port is not None
    return isinstance(node, Wait | Motion | Input | Transfer | Stub)


def _closure(names: Iterable[str], following: Mapping[str, Iterable[str]]) -> set[str]:
    """Return `names`, and all names that `following` reaches from them directly or indirectly."""
    result: set[str] = set()
    todo = list(names)
    while todo:
        name = todo.pop()
        if name not in result:
            result.add(name)
            todo.extend(following.get(name, ()))
    return result


@dataclass(frozen=True)
class _Root:
    function: str
    type: TaskType
    at: Position


class _Lint:
    def __init__(self, program: Program, version: int, files: Mapping[str, str]) -> None:
        self.program = program
        self.files = files
        self.version = version
        self.functions: dict[str, Function] = {
            function.name.lower(): function
            for file in program.files
            for function in file.functions
        }
        self.rules: list[Callable[[], Iterator[Problem]]] = [
            self._names,
            self._versions,
            self._task_types,
            self._ports,
            self._loops,
            self._gotos,
            self._handlers,
            self._wait_variables,
            self._comparisons,
            self._nesting,
            self._numbers,
            lambda: literals(program),
            lambda: unreachable(self.functions),
            lambda: unproven(program),
            lambda: included(program, files),
            self._use,
        ]
        self._shared = {
            variable.name.lower(): variable
            for file in program.files
            for declaration in file.declarations
            for variable in declaration.variables
        }

    def _nodes(self, *kinds: type) -> Iterator[Any]:
        for function in self.functions.values():
            yield from function.of(*kinds)

    def _everywhere(self, *kinds: type) -> Iterator[Any]:
        """Yield the nodes of `kinds` in declarations and in functions."""
        for file in self.program.files:
            yield from (node for node in walk(file.declarations) if isinstance(node, kinds))
            for function in file.functions:
                yield from function.of(*kinds)

    # The call graph

    @cached_property
    def _called(self) -> dict[str, set[str]]:
        result: dict[str, set[str]] = {}
        for name, function in self.functions.items():
            named = set(map(id, _task_names(function)))
            calls = (
                node.name.lower()
                for node in function.of(Call, Apply, Name)
                if id(node) not in named
            )
            result[name] = self.functions.keys() & set(calls)
        return result

    def _reached(self, root: str) -> set[str]:
        return _closure([root], self._called) if root in self.functions else set()

    @cached_property
    def _roots(self) -> list[_Root]:
        roots: dict[tuple[str, TaskType], _Root] = {}
        todo: list[_Root] = []
        for name, function in self.functions.items():
            if name == 'main' or _instead(name):
                todo.append(_Root(name, TaskType.NORMAL, function.at))
            elif name == 'bgmain':
                todo.append(_Root(name, TaskType.BACKGROUND, function.at))
        while todo:
            root = todo.pop()
            if (root.function, root.type) in roots:
                continue
            roots[root.function, root.type] = root
            for name in self._reached(root.function):
                for node in self.functions[name].of(Xqt, Trap):
                    started = self._started(node, root.type)
                    if started is not None:
                        todo.append(started)
        return list(roots.values())

    def _started(self, node: Any, kind: TaskType) -> _Root | None:
        if isinstance(node, Xqt):
            own = TASK_TYPE_WORDS[node.type]
            background = kind is TaskType.BACKGROUND
            return _Root(
                node.function.lower(), TaskType.BACKGROUND if background else own, node.at
            )
        if isinstance(node, Trap) and node.target and node.action != 'goto':
            own = TRAP_EVENTS.get(node.event, TaskType.TRAP)
            return _Root(node.target.lower(), own, node.at)
        return None

    # Rules

    def _use(self) -> Iterator[Problem]:
        roots = [root.function for root in self._roots]
        reached = {root: self._reached(root) for root in roots}
        yield from unused(self.program, self.files, set(roots))
        traps = {node.target.lower() for node in self._nodes(Trap) if node.action != 'goto'}
        tasks = {root: reached[root] for root in roots if not _instead(root) and root not in traps}
        yield from shared(tasks, self.functions)

    def _names(self) -> Iterator[Problem]:
        for file in self.program.files:
            yield from reserved_names(file, (self.version, 99))
        for function in self.functions.values():
            yield from _long(function.name, LONGEST_FUNCTION_NAME, function.at)
            for parameter in function.parameters:
                yield from _long(parameter.name, LONGEST_NAME, parameter.at)
        for node in self._everywhere(Label, VariableName):
            yield from _long(node.name, LONGEST_NAME, node.at)

    def _versions(self) -> Iterator[Problem]:
        for file in self.program.files:
            for function in file.functions:
                for parameter in function.parameters:
                    yield from self._new(parameter.type, TYPES[parameter.type], parameter.at)
                if function.result:
                    yield from self._new(function.result, TYPES[function.result], function.at)
        for node in self._everywhere(Declaration):
            yield from self._new(node.type, TYPES[node.type], node.at)
        for node in self._everywhere(Command, Motion, Stub):
            yield from self._new(node.name, WORDS[node.name.lower()].since[0], node.at)
        for node in self._everywhere(Name, Apply):
            rule = FUNCTIONS.get(node.name.lower())
            if rule is not None and node.name.lower() not in self._shared:
                yield from self._new(node.name, rule.since, node.at)

    def _new(self, name: str, since: int, at: Position) -> Iterator[Problem]:
        if since > self.version:
            text = f'{name} exists from version {since} on, not on version {self.version}'
            yield Problem(at, 'version', text)

    def _task_types(self) -> Iterator[Problem]:
        for root in self._roots:
            for name in sorted(self._reached(root.function)):
                kinds = (Command, Motion, Store, TaskCommand, Xqt, Trap)
                for node in self.functions[name].of(*kinds):
                    rule = COMMANDS[getattr(node, 'name', type(node).__name__).lower()]
                    if forbidden(rule, getattr(node, 'words', ()), root.type):
                        kind = root.type.name.lower().replace('_', ' ')
                        text = f'{rule.name} cannot run in a task {kind}: {root.function} is one '
                        text += f'({root.at.file}:{root.at.line})'
                        yield Problem(node.at, 'task-type', text)

    def _ports(self) -> Iterator[Problem]:
        users: dict[int, dict[str, Position]] = defaultdict(dict)
        for root in self._roots:
            for name in () if _instead(root.function) else self._reached(root.function):
                for port, at in self._used_ports(self.functions[name]):
                    users[port].setdefault(root.function, at)
        for port, tasks in sorted(users.items()):
            if len(tasks) > 1:
                names = ' and '.join(sorted(tasks))
                text = f'port {port} is used by tasks {names}: only its opener can use it'
                yield Problem(max(tasks.values()), 'port-shared', text, warning=True)

    def _used_ports(self, function: Function) -> Iterator[tuple[int, Position]]:
        for node in function.of(Print, Input, Transfer, Command):
            expression: Expression | None = None
            if isinstance(node, Print | Input | Transfer):
                expression = node.port
            elif isinstance(node, Command) and node.name.lower() in ('opennet', 'waitnet'):
                expression = node.arguments[0]
            port = constant(expression, CONSTANTS) if expression is not None else None
            if isinstance(port, int):
                yield port, node.at

    def missing_ports(self, known: Container[int]) -> Iterator[Problem]:
        """Yield a problem for each opened port that has neither a SetNet nor known settings."""
        set_up: set[int | float | None] = set()
        opened: dict[int, Position] = {}
        for node in self._nodes(Command):
            name, port = node.name.lower(), None
            if name in ('setnet', 'opennet') and node.arguments[0] is not None:
                port = constant(node.arguments[0], CONSTANTS)
            if name == 'setnet':
                set_up.add(port)
            elif name == 'opennet' and isinstance(port, int):
                opened.setdefault(port, node.at)
        for port, at in opened.items():
            if port not in known and not set_up & {port, None}:
                advice = to_add('ports', f'{port}: ADDRESS:PORT')
                text = f'port {port} has no TCP port: to run it, {advice}'
                yield Problem(at, 'not-simulated', text, warning=True)

    @cached_property
    def _waiting(self) -> set[str]:
        """Names of the functions that wait, or that call a function that waits."""
        callers: dict[str, set[str]] = defaultdict(set)
        for name, function in self.functions.items():
            for node in function.of(Call, Apply):
                callers[node.name.lower()].add(name)
        waiting = [
            name for name, function in self.functions.items() if any(map(_waits, function.nodes))
        ]
        return _closure(waiting, callers)

    def _loops(self) -> Iterator[Problem]:
        for node in self._nodes(Do):
            tests = [test for test in (node.before, node.after) if test is not None]
            polls = any(self._asks(test.condition) for test in tests)
            if (polls or not tests) and not any(map(self._is_wait, walk(node.body))):
                text = 'the loop has no Wait: add a Wait of 0.01 s or more'
                yield Problem(node.at, 'endless-loop', text, warning=True)

    def _is_wait(self, node: Any) -> bool:
        return _waits(node) or (
            isinstance(node, Call | Apply) and node.name.lower() in self._waiting
        )

    def _asks(self, condition: Expression) -> bool:
        for node in walk(condition):
            if isinstance(node, Name | Apply):
                rule = FUNCTIONS.get(node.name.lower())
                if rule is not None and rule.by != 'value':
                    return True
        return False

    def _gotos(self) -> Iterator[Problem]:
        for loop in self._nodes(Do, For):
            inside = {n.name.lower() for n in walk(loop.body) if isinstance(n, Label)}
            for node in walk(loop.body):
                if not isinstance(node, Jump) or node.kind != 'goto':
                    continue
                if node.label.lower() not in inside:
                    text = f'GoTo {node.label} leaves the loop of line {loop.at.line}: '
                    text += 'use Exit Do or Exit For'
                    yield Problem(node.at, 'goto-out-of-loop', text, warning=True)

    def _handlers(self) -> Iterator[Problem]:
        for function in self.functions.values():
            handlers = {
                node.label.lower() for node in function.of(OnErr) if node.label is not None
            }
            yield from self._fallen_into(function.body, handlers)

    def _fallen_into(self, block: tuple[Statement, ...], handlers: set[str]) -> Iterator[Problem]:
        before: Statement | None = None
        for place, statement in enumerate(block):
            handler = isinstance(statement, Label) and statement.name.lower() in handlers
            starts = isinstance(before, OnErr) and before.label is not None  # OnErr GoTo it
            fallen = handler and before is not None and not starts and not leaves(before)
            if fallen and not _asks_for_error(block[place:]):
                text = 'the error handler is reached without an error: put Exit Function above it'
                yield Problem(statement.at, 'handler', text, warning=True)
            for item in inner_blocks(statement):
                yield from self._fallen_into(item, handlers)
            before = statement

    def _wait_variables(self) -> Iterator[Problem]:
        watched: dict[str, Position] = {}
        handed: dict[str, Position] = {}
        for function in self.functions.values():
            for node in function.nodes:
                condition = None
                if isinstance(node, Wait | Trap | Store):
                    condition = node.condition
                elif isinstance(node, Motion) and not isinstance(node.till, bool):
                    condition = node.till
                for item in walk(condition) if condition is not None else ():
                    if isinstance(item, Name) and item.name.lower() in self._shared:
                        watched.setdefault(item.name.lower(), item.at)
                for argument in getattr(node, 'arguments', ()):
                    if getattr(argument, 'by_reference', False):
                        value = argument.value
                        if isinstance(value, Name):
                            handed.setdefault(value.name.lower(), value.at)
        for name in sorted(set(watched) & set(handed)):
            at = watched[name]
            text = (
                f'{name} is in a Wait condition in {at.file}:{at.line}: it cannot be passed ByRef'
            )
            yield Problem(handed[name], 'wait-by-reference', text)
        if len(watched) > MAX_WAIT_VARIABLES:
            text = f'{len(watched)} variables in Wait conditions: a controller accepts '
            text += f'{MAX_WAIT_VARIABLES}'
            yield Problem(max(watched.values()), 'wait-variables', text)

    def _comparisons(self) -> Iterator[Problem]:
        booleans = self._booleans()
        for function, bounds in arrays(self.program):
            for node in function.of(Binary):
                if node.operator in ('=', '<>'):
                    yield from self._true(node, booleans | {function.name.lower()})
                elif node.operator == 'and':
                    yield from self._guard(node, bounds)

    def _booleans(self) -> set[str]:
        match = set()
        for node in self._everywhere(Declaration):
            if node.type == 'boolean':
                match |= {variable.name.lower() for variable in node.variables}
        for file in self.program.files:
            for function in file.functions:
                match |= {p.name.lower() for p in function.parameters if p.type == 'boolean'}
                if function.result == 'boolean':
                    match.add(function.name.lower())
        return match

    def _true(self, node: Binary, booleans: set[str]) -> Iterator[Problem]:
        for one, other in ((node.left, node.right), (node.right, node.left)):
            if not isinstance(one, Name) or one.name.lower() != 'true':
                continue
            if not isinstance(other, Name | Apply) or other.name.lower() in booleans:
                continue
            name = other.name.lower()
            if name in FUNCTIONS and name not in ONE_WHEN_ON:
                continue
            text = f'{other.name} = True holds for any value but 0 (p420), or for -1 (p995): '
            text += f'write {other.name} <> 0, or = On'
            yield Problem(node.at, 'true-compare', text, warning=True)

    def _guard(self, node: Binary, arrays: Mapping[str, tuple[int, ...]]) -> Iterator[Problem]:
        """Yield a problem for `i <= 3 And a(i) = 1` if 3 is the upper bound of a.

        SPEL+ evaluates both sides, so it also evaluates a(4).
        """
        guarded: dict[str, set[int]] = {}
        for item in walk(node.left):
            if isinstance(item, Binary) and item.operator in _LAST and isinstance(item.left, Name):
                limit = constant(item.right, CONSTANTS)
                if isinstance(limit, int):
                    last = limit + _LAST[item.operator]
                    guarded.setdefault(item.left.name.lower(), set()).add(last)
        for item in walk(node.right):
            bounds = arrays.get(item.name.lower(), ()) if isinstance(item, Apply) else ()
            if not bounds or len(bounds) != len(item.arguments):
                continue
            for argument, bound in zip(item.arguments, bounds, strict=True):
                index = argument.value
                if isinstance(index, Name) and guarded.get(index.name.lower(), set()) & {bound, 0}:
                    text = f'And evaluates both sides: it does not guard {item.name}({index.name})'
                    yield Problem(item.at, 'and-guard', text, warning=True)

    def _nesting(self) -> Iterator[Problem]:
        for function in self.functions.values():
            yield from _nested(function.body, 0, False)

    def _numbers(self) -> Iterator[Problem]:
        for node in self._nodes(Number):
            if node.text[:2] in ('&H', '&h') and node.value > 0x7FFF_FFFF:
                text = f'{node.text}: its sign is not documented'
                yield Problem(node.at, 'hex', text, warning=True)
        for node in self._nodes(For):
            limit = constant(node.last, CONSTANTS)
            if isinstance(limit, int | float) and limit >= 32_767:
                text = f'For up to {limit}: its variable must be a Long'
                yield Problem(node.at, 'integer-range', text, warning=True)


def _nested(block: tuple[Statement, ...], depth: int, loop: bool) -> Iterator[Problem]:
    for statement in block:
        if isinstance(statement, Declaration) and loop:
            text = 'whether a declaration in a loop clears its variables is not documented: '
            text += 'put it at the start of the function'
            yield Problem(statement.at, 'declaration-in-loop', text, warning=True)
        within = depth + isinstance(statement, For)
        if within > DEEPEST_FOR and isinstance(statement, For):
            text = f'more than {DEEPEST_FOR} nested For loops'
            yield Problem(statement.at, 'for-depth', text)
        for item in inner_blocks(statement):
            yield from _nested(item, within, loop or isinstance(statement, Do | For))


def _long(name: str, most: int, at: Position) -> Iterator[Problem]:
    if len(name) > most:
        text = f'{name[:80]} has {len(name)} characters: at most {most} are allowed'
        yield Problem(at, 'name-length', text)
