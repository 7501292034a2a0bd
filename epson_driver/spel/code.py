# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A compiled program: functions as lists of instructions, and their shared data."""

from dataclasses import dataclass, field

from epson_driver.spel.errors import Position
from epson_driver.spel.project_data import ProjectData
from epson_driver.spel.syntax import Declare, File, Parameter
from epson_driver.spel.values import Value

WAITING = -1
"""Return value of an instruction after which the task itself decides how to continue."""


@dataclass(frozen=True, slots=True)
class Variable:
    """A variable: its storage, its type, and its bounds if it is an array.

    `slot` is its index in the list `place`: 'v' for the variables of a call, 'g' for shared ones.
    If `by_reference`, the element is the pair (list, index) of the caller's variable. An array
    parameter is the caller's array.
    """

    name: str
    type: str
    place: str
    slot: int
    bounds: tuple[int, ...] = ()
    array: bool = False
    by_reference: bool = False
    preserved: bool = False
    at: Position = field(default=Position('', 0), compare=False)


@dataclass
class FunctionCode:
    """A compiled function. `source` has a Python function o<index>_<pc> for each instruction.

    The other lists have an entry for each instruction: `lines` its position in the program,
    `starts` the first instruction of its statement, `following` the next instruction. Instructions
    in `passed_over` only jump to the end of an If or Select. Jumps to them go directly to that
    end.
    """

    name: str
    index: int
    parameters: tuple[Parameter, ...]
    result: str
    at: Position
    end: Position
    result_slot: int = 0
    lines: list[Position] = field(default_factory=list)
    starts: list[int] = field(default_factory=list)
    following: list[int] = field(default_factory=list)
    passed_over: set[int] = field(default_factory=set)
    blanks: list[Value] = field(default_factory=list)
    arrays: list[Variable] = field(default_factory=list)
    source: list[str] = field(default_factory=list)


@dataclass
class Program:
    """All functions of a project, its shared variables, and the generated Python in portions."""

    functions: list[FunctionCode]
    by_name: dict[str, FunctionCode]
    variables: list[Variable]
    libraries: list[Declare]
    files: list[File]
    source: tuple[str, ...]
    data: ProjectData = field(default_factory=ProjectData)
    shared: dict[str, Variable] = field(default_factory=dict)
    """The Global variables by name in lower case."""
