# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Rules of the linter about what is written as a number: ranges, divisors, indices, cases."""

from collections.abc import Iterator
from math import inf

from epson_driver.spel.code import Program
from epson_driver.spel.errors import Position, Problem
from epson_driver.spel.expressions import is_point_literal
from epson_driver.spel.scope import constant
from epson_driver.spel.syntax import (
    Apply,
    Binary,
    Command,
    Declaration,
    Expression,
    Function,
    Input,
    Motion,
    Name,
    Number,
    Print,
    Redim,
    Select,
    Transfer,
    Wait,
    Xqt,
    walk,
)
from epson_driver.spel.words import CONSTANTS

_PORTS = (201, 216)
_FILES = (30, 63)
_BACKGROUND = range(65, 81)
_MOST = 32767
"""Where the manual has no end: Accel above 100 depends on the robot (p68), bits on the boards."""

RANGES: dict[str, tuple[tuple[float, float] | None, ...]] = {
    name: ranges
    for names, ranges in (
        ('speed', ((1, 100),) * 3),
        ('speedfactor', ((1, 100),)),
        ('speeds', ((0.1, 2000),) * 3),
        ('speedr', ((0.1, 1000),)),
        ('accel', ((1, _MOST),) * 6),
        ('accels', ((0.1, 25000),) * 6),
        ('accelr', ((0.1, 5000),) * 2),
        ('on off', ((0, _MOST), (0, inf))),
        ('sw oport in inw inbcd setsw ctr ctreset', ((0, _MOST),)),
        ('setin', ((0, _MOST), (0, 255))),
        ('setinw', ((0, _MOST), (-32768, 65535))),
        ('tool pallet palletclr', ((0, 15),)),
        ('tlset tlclr local localclr', ((1, 15),)),
        ('box boxclr boxdef insidebox getrobotinsidebox', ((1, 15),)),
        ('plane planeclr planedef insideplane getrobotinsideplane', ((1, 15),)),
        ('arch', ((0, 6),)),
        ('columns rows', ((1, _MOST),)),
        ('redim', ((0, inf),)),
        ('arch(', ((0, 6), (1, 2))),
        ('box(', ((1, 15), (1, 2))),
        ('tmreset tmr signal syncunlock', ((0, 63),)),
        ('waitsig synclock', ((0, 63), (0, inf))),
        ('wait', ((0, inf),)),
        ('memon memoff memsw', ((0, 1023),)),
        ('memout', ((0, 127), (0, 255))),
        ('memin', ((0, 127),)),
        ('memoutw', ((0, 63), (-32768, 65535))),
        ('meminw', ((0, 63),)),
        ('out', ((0, _MOST), (0, 255))),
        ('outw', ((0, _MOST), (-32768, 65535))),
        ('opbcd', ((0, _MOST), (0, 99))),
        ('setnet opennet closenet chknet lof', (_PORTS,)),
        ('waitnet', (_PORTS, (0, inf))),
        ('aopen bopen ropen uopen wopen', (None, _FILES)),
        ('close flush eof', (_FILES,)),
        ('seek', (_FILES, (0, inf))),
        ('p plabel', ((0, 999),)),
        ('hand elbow wrist', (None, (1, 2))),
        ('j1flag j4flag', (None, (0, 1))),
        ('j2flag j6flag', (None, (0, 127))),
        ('plocal', (None, (0, 15))),
        ('sqr', ((0, inf),)),
        ('asin acos', ((-1, 1),)),
        ('lshift rshift bset bclr btst', (None, (0, 31))),
        ('lshift64 rshift64 bset64 bclr64 btst64', (None, (0, 63))),
        ('chr$', ((1, 255),)),
        ('space$ tab$', ((0, 255),)),
        ('left$ right$ lset$ rset$', (None, (0, 255))),
        ('mid$', (None, (1, inf), (0, 255))),
        ('time', ((0, 2),)),
        ('taskinfo', (None, (0, 4))),
        ('xqt', ((1, 32),)),
        ('c', ((0, 7),)),
        ('d', ((0, 100),)),
    )
    for name in names.split()
}
"""What the arguments of statements and functions can be, by name in lower case.

With a bracket behind it, it is the function alone.
"""

SIMULATED = {
    'arm': (0,),
    'robot': (1,),
    'ctrlinfo': (1, 5, 6, 7),
    'robotinfo': (0,),
    'stat': (0, 1),
}
"""For which first arguments there is a simulation, where not for all."""


def _number(expression: Expression | None) -> int | float | None:
    return None if expression is None else constant(expression, CONSTANTS)


def _outside(name: str, place: int, given: Expression | None) -> Iterator[Problem]:
    ranges = RANGES.get(name.lower(), ())
    limits = ranges[place] if place < len(ranges) else None
    value = _number(given)
    if given is None or value is None:
        return
    if limits is not None and not limits[0] <= value <= limits[1]:
        low, high = limits
        rule = f'is not in {low:g}..{high:g}' if high < inf else f'is below {low:g}'
        text = f'{name.removesuffix("(")}: {value:g} {rule}'
        yield Problem(given.at, 'range', text)
    known = SIMULATED.get(name.lower())
    if known is not None and place == 0 and value not in known:
        text = f'{name} {value:g} is not simulated, only {", ".join(map(str, known))}'
        yield Problem(given.at, 'not-simulated', text, warning=True)


def literals(program: Program, functions: list[Function]) -> Iterator[Problem]:
    """Yield numbers that are out of range, divisors that are 0, indices beyond an array."""
    resized = _resized(program)
    for function in functions:
        bounds = _bounds(program, function, resized)
        for node in walk(function.body):
            if isinstance(node, Command):
                for place, given in enumerate(node.arguments):
                    yield from _outside(node.name, place, given)
                if node.name.lower() == 'pallet' and len(node.arguments) > 2:
                    for name, given in zip(('columns', 'rows'), node.arguments[-2:], strict=True):
                        yield from _outside(name, 0, given)
            elif isinstance(node, Wait):  # a number alone is a time
                yield from _outside('Wait', 0, node.condition if node.time is None else node.time)
            elif isinstance(node, Name) and is_point_literal(node.name):
                yield from _outside('P', 0, Number(int(node.name[1:]), node.at))
            elif isinstance(node, Redim):
                for given in node.bounds:
                    yield from _outside('Redim', 0, given)
            elif isinstance(node, Xqt) and _number(node.number) not in _BACKGROUND:
                yield from _outside('Xqt', 0, node.number)
            elif isinstance(node, Motion):
                for name, value in node.numbers:
                    yield from _outside(name.upper(), 0, value)
            elif isinstance(node, Input | Print | Transfer):
                yield from _device(node.port)
            elif isinstance(node, Apply):
                name = node.name.lower()
                if name in bounds:
                    yield from _index(node, bounds[name])
                else:
                    called = f'{name}(' if f'{name}(' in RANGES else node.name
                    for place, argument in enumerate(node.arguments):
                        yield from _outside(called, place, argument.value)
            elif isinstance(node, Binary) and node.operator in ('/', 'mod'):
                if _number(node.right) == 0:
                    yield Problem(node.at, 'range', f'{node.operator.capitalize()} by 0')
            elif isinstance(node, Select):
                yield from _twice(node)


def _device(port: Expression | None) -> Iterator[Problem]:
    """Yield a port that is neither of a display, serial, file, network nor database."""
    value = _number(port)
    known = ((0, 24), (30, 63), _PORTS, (501, 508), (1001, 1008))
    if value is not None and port is not None and not any(a <= value <= b for a, b in known):
        yield Problem(port.at, 'range', f'there is no port or file {value:g}')


def _bounds(program: Program, function: Function, resized: set[str]) -> dict[str, tuple[int, ...]]:
    """Return the upper bounds of the arrays that a function sees, but of those that change."""
    found: dict[str, tuple[int, ...]] = {}
    seen = [
        declaration
        for file in program.files
        for declaration in file.declarations
        if declaration.scope != 'module' or function in file.functions
    ]
    seen += [each for each in walk(function.body) if isinstance(each, Declaration)]
    for declaration in seen:
        for variable in declaration.variables:
            numbers = [_number(each) for each in variable.bounds]
            name = variable.name.lower()
            found.pop(name, None)
            if numbers and all(isinstance(each, int) for each in numbers):
                found[name] = tuple(int(each) for each in numbers if each is not None)
    for name in {*resized, *(each.name.lower() for each in function.parameters)}:
        found.pop(name, None)
    return found


def _resized(program: Program) -> set[str]:
    """Return the arrays that Redim and ParseStr change."""
    found = set()
    for node in walk([file.functions for file in program.files]):
        if isinstance(node, Redim):
            found.add(node.name.lower())
        elif isinstance(node, Command | Apply) and node.name.lower() == 'parsestr':
            found |= {getattr(each, 'name', '').lower() for each in walk(node.arguments)}
    return found


def _index(node: Apply, bounds: tuple[int, ...]) -> Iterator[Problem]:
    for argument, bound in zip(node.arguments, bounds, strict=False):
        index = _number(argument.value)
        if index is not None and index > bound:
            text = f'{node.name}: index {index:g} is above {bound}'
            yield Problem(argument.value.at, 'array-index', text)


def _twice(select: Select) -> Iterator[Problem]:
    seen: dict[int | float, Position] = {}
    for items, _ in select.cases:
        for item in items:
            value = _number(item.value) if item.operator == '=' else None
            if value is None:
                continue
            if value in seen:
                text = f'Case {value:g} stands in line {seen[value].line} already'
                yield Problem(item.value.at, 'unreachable', text, warning=True)
            seen.setdefault(value, item.value.at)
