# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A compiled program: functions as lists of instructions, and the variables they share."""

from dataclasses import dataclass, field

from epson_driver.spel.errors import Position
from epson_driver.spel.project_data import ProjectData
from epson_driver.spel.syntax import Declare, File, Parameter
from epson_driver.spel.values import Value

WAITING = -1
"""Return value of an instruction if the task itself decides how to continue after it."""


@dataclass(frozen=True, slots=True)
class Variable:
    """A variable of the program.

    * place: the list that contains it, 'v' for the variables of a call, 'g' for shared variables.
    * slot: the variable's index in this list.
    * bounds: the upper bounds of an array. An array parameter is the caller's array.
    * by_reference: whether the list contains a reference to the caller's variable, a pair (list,
      index), instead of a value.
    * preserved: whether the variable keeps its value when the program restarts (`Global
      Preserve`).
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
    """A compiled function. The first four lists have an entry for each instruction.

    * lines: the position of the instruction in the program.
    * starts: the first instruction of the same statement.
    * following: the instruction that normally follows.
    * source: the Python function of the instruction, with the name o<index>_<pc>.
    * passed_over: jumps to the end of an If or Select. They may never be executed, because a jump
      to such a jump goes directly to the end.
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
    """All functions of a project, its shared variables, and the Python text made from them.

    The text is divided into portions (`source`), which are compiled separately.
    """

    functions: list[FunctionCode]
    by_name: dict[str, FunctionCode]
    variables: list[Variable]
    libraries: list[Declare]
    files: list[File]
    source: tuple[str, ...]
    data: ProjectData = field(default_factory=ProjectData)
    shared: dict[str, Variable] = field(default_factory=dict)
    """The Global variables by name in lower case."""
