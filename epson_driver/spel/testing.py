# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`spel test`: every function named Test… runs on a bare host, each in a machine of its own.

A test passes when it ends without an error that nothing handles: `If x <> 3 Then Error 8001`.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace

from epson_driver.spel.bare_host import BareHost
from epson_driver.spel.code import FunctionCode, Program
from epson_driver.spel.errors import Position, TaskError
from epson_driver.spel.machine import Machine
from epson_driver.spel.surroundings import Surroundings

LONGEST = 600.0
"""How long a test may take, in seconds of the controller."""


@dataclass(frozen=True, slots=True)
class TestResult:
    """What became of a test: `error` is empty if it passed. `seconds` of the controller."""

    __test__ = False

    name: str
    position: Position
    error: str
    printed: str
    seconds: float
    lines: dict[str, dict[int, bool]] = field(default_factory=dict)
    """The lines with statements by file, and whether the test has run them."""


def tests(program: Program) -> list[FunctionCode]:
    """Return the functions that are tests, in the order of the files."""
    return [code for code in program.functions if code.name.lower().startswith('test')]


def run_tests(
    program: Program,
    names: Callable[[str], bool] = lambda _: True,
    around: Surroundings | None = None,
    longest: float = LONGEST,
) -> Iterator[TestResult]:
    """Run the tests whose names are wanted and yield each result when it is there."""
    for code in tests(program):
        if names(code.name):
            yield _run(program, code, around or Surroundings(), longest)


def covered(results: Iterable[TestResult]) -> dict[str, dict[int, bool]]:
    """Return the lines with statements by file, and whether any test has run them."""
    found: dict[str, dict[int, bool]] = {}
    for result in results:
        for file, lines in result.lines.items():
            known = found.setdefault(file, {})
            for line, ran in lines.items():
                known[line] = known.get(line, False) or ran
    return found


def _run(program: Program, code: FunctionCode, around: Surroundings, longest: float) -> TestResult:
    host = BareHost()
    if code.parameters:
        error = 'a test cannot have parameters'
        return TestResult(code.name, code.at, error, '', 0.0)
    machine = Machine(program, host, around=around.fresh())
    machine.start(code.name)
    due = machine.next_time()
    while due is not None and 1 in machine.world.tasks and machine.time < longest:
        machine.advance(due)
        due = None if host.failures else machine.next_time()
    return replace(_result(code, host, machine, longest), lines=machine.lines())


def _result(code: FunctionCode, host: BareHost, machine: Machine, longest: float) -> TestResult:
    failure: TaskError | None = host.failures[0] if host.failures else None
    printed = ''.join(host.printed)
    if failure is not None:
        text = f'error {failure.number}: {failure.text}'
        return TestResult(code.name, failure.position, text, printed, machine.time)
    if 1 in machine.world.tasks:
        view = next(view for view in machine.tasks() if view.number == 1)
        error = f'not over after {longest:g} s of the controller'
        if machine.next_time() is None:
            error = 'waits for what never comes'
        where = Position(view.file, view.line)
        return TestResult(code.name, where, error, printed, machine.time)
    return TestResult(code.name, code.at, '', printed, machine.time)
