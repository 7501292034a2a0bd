# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The syntax of a program as plain data: expressions, statements, functions."""

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field, fields, is_dataclass
from functools import cache, cached_property
from typing import Any, Literal

from epson_driver.spel.errors import Position

# Expressions


@dataclass(frozen=True, slots=True)
class Number:
    value: int | float
    at: Position
    text: str = ''


@dataclass(frozen=True, slots=True)
class Text:
    value: str
    at: Position


@dataclass(frozen=True, slots=True)
class Name:
    """A variable, a constant, or a function without arguments."""

    name: str
    at: Position


@dataclass(frozen=True, slots=True)
class Argument:
    """One argument: `a`, `ByRef a`, `a()`."""

    value: 'Expression'
    by_reference: bool = False
    whole_array: bool = False


@dataclass(frozen=True, slots=True)
class Apply:
    """A name with arguments: an element of an array, or a call of a function."""

    name: str
    arguments: tuple[Argument, ...]
    at: Position


@dataclass(frozen=True, slots=True)
class Unary:
    operator: str
    operand: 'Expression'
    at: Position


@dataclass(frozen=True, slots=True)
class Binary:
    operator: str
    left: 'Expression'
    right: 'Expression'
    at: Position


@dataclass(frozen=True, slots=True)
class PointChange:
    """A point with one coordinate set (`:Z(0)`) or moved (`+Z(10)`)."""

    point: 'Expression'
    operator: str
    axis: str
    value: 'Expression'
    at: Position


@dataclass(frozen=True, slots=True)
class PointFlag:
    """A point with a posture or a local: `/L`, `/2`, `@2`, `/(i)`, `/J1A(90)`."""

    point: 'Expression'
    flag: str
    at: Position
    value: 'Expression | None' = None


Expression = Number | Text | Name | Apply | Unary | Binary | PointChange | PointFlag
Target = Name | Apply

# Statements


@dataclass(frozen=True, slots=True)
class Variable:
    name: str
    bounds: tuple[Expression, ...]
    at: Position


@dataclass(frozen=True, slots=True)
class Declaration:
    type: str
    variables: tuple[Variable, ...]
    scope: Literal['local', 'module', 'global', 'preserve']
    at: Position


@dataclass(frozen=True, slots=True)
class Assign:
    target: Target
    value: Expression
    at: Position


@dataclass(frozen=True, slots=True)
class If:
    branches: tuple[tuple[Expression, 'Block'], ...]
    otherwise: 'Block'
    at: Position


@dataclass(frozen=True, slots=True)
class CaseItem:
    operator: str
    value: Expression


@dataclass(frozen=True, slots=True)
class Select:
    subject: Expression
    cases: tuple[tuple[tuple[CaseItem, ...], 'Block'], ...]
    default: 'Block'
    at: Position


@dataclass(frozen=True, slots=True)
class Test:
    """`While c` or `Until c` of a Do or a Loop."""

    until: bool
    condition: Expression


@dataclass(frozen=True, slots=True)
class Do:
    before: Test | None
    body: 'Block'
    after: Test | None
    at: Position


@dataclass(frozen=True, slots=True)
class For:
    variable: Target
    first: Expression
    last: Expression
    step: Expression | None
    body: 'Block'
    at: Position


@dataclass(frozen=True, slots=True)
class Exit:
    what: str
    at: Position


@dataclass(frozen=True, slots=True)
class Label:
    name: str
    at: Position


@dataclass(frozen=True, slots=True)
class Jump:
    kind: Literal['goto', 'gosub']
    label: str
    at: Position


@dataclass(frozen=True, slots=True)
class Return:
    """`Return`, the end of a GoSub."""

    at: Position


@dataclass(frozen=True, slots=True)
class OnErr:
    """`OnErr GoTo label`. The label of `OnErr GoTo 0` is None."""

    label: str | None
    at: Position


@dataclass(frozen=True, slots=True)
class EResume:
    kind: Literal['again', 'next', 'label']
    label: str
    at: Position


@dataclass(frozen=True, slots=True)
class Call:
    name: str
    arguments: tuple[Argument, ...]
    at: Position


@dataclass(frozen=True, slots=True)
class Command:
    """A statement of commands.py: its arguments (None for an omitted one), and its keywords."""

    name: str
    arguments: tuple[Expression | None, ...]
    at: Position
    words: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Motion:
    """A statement that moves the arm.

    * till, find, sense: the condition, True for the stored condition, or False.
    * numbers: the values of C, LimZ, LJM and PerformMode.
    * parallel: the statements between `!` and `!`.
    """

    name: str
    points: tuple[Expression, ...]
    at: Position
    cp: bool = False
    till: Expression | bool = False
    find: Expression | bool = False
    sense: Expression | bool = False
    words: tuple[str, ...] = ()
    numbers: tuple[tuple[str, Expression], ...] = ()
    parallel: 'Block' = ()


@dataclass(frozen=True, slots=True)
class Share:
    """`D50` in parallel statements.

    The parallel statements after it start when 50 % of the motion is complete.
    """

    percent: Expression
    at: Position


@dataclass(frozen=True, slots=True)
class Stub:
    """A statement that is not simulated (vision, conveyors, windows). Its results are given.

    `indices` select one of several results: `VGet find.Blob01.RobotXYU(i)`.
    """

    name: str
    arguments: tuple[Argument, ...]
    indices: tuple[Argument, ...]
    at: Position


@dataclass(frozen=True, slots=True)
class Store:
    name: str
    condition: Expression
    at: Position


@dataclass(frozen=True, slots=True)
class Print:
    """Print to the terminal, a port or a file.

    `line` is False if the statement ends with a comma, so the printed line is not ended.
    """

    port: Expression | None
    items: tuple[Expression, ...]
    line: bool
    at: Position


@dataclass(frozen=True, slots=True)
class Input:
    port: Expression | None
    whole_line: bool
    targets: tuple[Target, ...]
    at: Position


@dataclass(frozen=True, slots=True)
class Transfer:
    name: str
    port: Expression
    value: Argument
    count: Expression | None
    at: Position


@dataclass(frozen=True, slots=True)
class Xqt:
    number: Expression | None
    function: str
    arguments: tuple[Argument, ...]
    type: str
    at: Position


@dataclass(frozen=True, slots=True)
class Wait:
    condition: Expression | None
    time: Expression | None
    at: Position


@dataclass(frozen=True, slots=True)
class Trap:
    """`Trap 1, cond GoTo|Call|Xqt name` or `Trap Emergency Xqt f`.

    The `action` '' disarms the Trap.
    """

    event: str
    number: Expression | None
    condition: Expression | None
    action: str
    target: str
    at: Position


@dataclass(frozen=True, slots=True)
class TaskCommand:
    """Quit, Halt, Resume, TaskWait or StartMain.

    The argument is a task number, a function's name, or All.
    """

    name: str
    task: Expression | None
    function: str
    at: Position


@dataclass(frozen=True, slots=True)
class Redim:
    preserve: bool
    name: str
    bounds: tuple[Expression, ...]
    at: Position


Statement = (
    Declaration
    | Assign
    | If
    | Select
    | Do
    | For
    | Exit
    | Label
    | Jump
    | Return
    | OnErr
    | EResume
    | Call
    | Command
    | Motion
    | Share
    | Stub
    | Store
    | Print
    | Input
    | Transfer
    | Xqt
    | Wait
    | Trap
    | TaskCommand
    | Redim
)
Block = tuple[Statement, ...]

# Files


@dataclass(frozen=True, slots=True)
class Parameter:
    name: str
    type: str
    by_reference: bool
    array: bool
    at: Position


@dataclass(frozen=True, eq=False)
class Function:
    """Function … Fend. `result` is the type of the function's value, or ''."""

    name: str
    parameters: tuple[Parameter, ...]
    result: str
    body: Block
    at: Position
    end: Position

    @cached_property
    def nodes(self) -> tuple[Any, ...]:
        """All nodes of the body. They are stored, because each rule of the linter reads them."""
        return tuple(walk(self.body))

    @cached_property
    def _by_kind(self) -> dict[type, list[Any]]:
        result = defaultdict(list)
        for node in self.nodes:
            result[type(node)].append(node)
        return result

    def of(self, *kinds: type) -> Iterator[Any]:
        for kind in kinds:
            yield from self._by_kind.get(kind, ())


@dataclass(frozen=True, slots=True)
class Declare:
    """A declared function of a DLL."""

    name: str
    library: str
    alias: str
    parameters: tuple[Parameter, ...]
    result: str
    at: Position


@dataclass(slots=True)
class File:
    """One program file. `marks`: forms of `lint_rules.UNPROVEN` that the nodes do not show."""

    name: str
    functions: list[Function] = field(default_factory=list)
    declarations: list[Declaration] = field(default_factory=list)
    declared: list[Declare] = field(default_factory=list)
    marks: list[tuple[str, Position]] = field(default_factory=list)


def inner_blocks(statement: Statement) -> list[Block]:
    if isinstance(statement, If):
        return [*(body for _, body in statement.branches), statement.otherwise]
    if isinstance(statement, Select):
        return [*(body for _, body in statement.cases), statement.default]
    return [statement.body] if isinstance(statement, Do | For) else []


def walk(node: Any) -> Iterator[Any]:
    """Yield a node of the syntax and all its descendants."""
    todo = [node]
    while todo:
        item = todo.pop()
        kind: Any = type(item)
        if kind is tuple or kind is list:
            todo.extend(reversed(item))
        elif parts := _parts(kind):
            yield item
            todo += [getattr(item, name) for name in parts]


@cache
def _parts(kind: type) -> list[str]:
    return [item.name for item in reversed(fields(kind))] if is_dataclass(kind) else []
