# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Linter rules: unused code, unreachable code, use by several tasks, literal numbers."""

import re
from collections import ChainMap, Counter
from collections.abc import Callable, Iterator, Mapping
from itertools import chain
from typing import NamedTuple

from epson_driver.spel import syntax
from epson_driver.spel.code import Program
from epson_driver.spel.errors import Position, Problem
from epson_driver.spel.expressions import is_point_literal
from epson_driver.spel.ranges import FILES, PORTS, key_of, outside
from epson_driver.spel.scope import constant
from epson_driver.spel.words import CONSTANTS

_MOVED = 'the robot is moved by'
_OWNED = {
    'tmreset': 'timer {:g} is set by',
    'on': 'output {:g} is switched by',
    'off': 'output {:g} is switched by',
}
_WINDOWS = frozenset({'gshow', 'gshowdialog', 'gset', 'gget'})
"""Statements for windows. The events of a window call functions that no statement names."""


def leaves(statement: syntax.Statement) -> bool:
    """Return whether execution never continues at the statement that follows `statement`."""
    if isinstance(statement, syntax.Exit | syntax.EResume | syntax.Return):
        return True
    if isinstance(statement, syntax.Do):
        tests = [test for test in (statement.before, statement.after) if test is not None]
        ends = any(_truth(test.condition) is not (not test.until) for test in tests)
        return not ends and not any(_leaves_loop(item) for item in syntax.walk(statement.body))
    if isinstance(statement, syntax.If | syntax.Select):
        blocks = syntax.inner_blocks(statement)
        return all(block and leaves(block[-1]) for block in blocks)
    if isinstance(statement, syntax.TaskCommand):
        return (
            statement.name.lower() == 'quit' and statement.task is None and not statement.function
        )
    return isinstance(statement, syntax.Jump) and statement.kind == 'goto'


def _truth(condition: syntax.Expression) -> bool | None:
    value = constant(condition, CONSTANTS)
    return None if value is None else value != 0


def _leaves_loop(node: object) -> bool:
    return (isinstance(node, syntax.Exit) and node.what == 'do') or isinstance(node, syntax.Jump)


def unreachable(functions: Mapping[str, syntax.Function]) -> Iterator[Problem]:
    for function in functions.values():
        yield from _dead(function.body)


def _dead(block: tuple[syntax.Statement, ...]) -> Iterator[Problem]:
    before: syntax.Statement | None = None
    for statement in block:
        plain = not isinstance(statement, syntax.Label | syntax.Declaration)
        if before is not None and plain and leaves(before):
            text = f'unreachable: line {before.at.line} leaves this path'
            yield Problem(statement.at, 'unreachable', text, warning=True)
        for item in syntax.inner_blocks(statement):
            yield from _dead(item)
        before = statement


class Form(NamedTuple):
    """A syntax that the interpreter accepts, but that neither the manual nor a known program uses.

    * manual: the syntax in the manual.
    * find: yields the positions of the syntax in a function. Without it, the parser marks them.
    """

    form: str
    manual: str
    instead: str
    find: Callable[[syntax.Function], Iterator[Position]] | None = None


def _elements_by_reference(function: syntax.Function) -> Iterator[Position]:
    for node in function.of(syntax.Argument):
        if node.by_reference and isinstance(node.value, syntax.Apply):
            yield node.value.at


def _negated_waits(function: syntax.Function) -> Iterator[Position]:
    for node in function.of(syntax.Wait):
        for item in syntax.walk(node.condition):
            if isinstance(item, syntax.Unary) and item.operator == 'not':
                yield item.at


def _masks_elsewhere(function: syntax.Function) -> Iterator[Position]:
    waits = function.of(syntax.Wait, syntax.Store, syntax.Motion, syntax.Trap)
    allowed = {id(item) for node in waits for item in syntax.walk(node)}
    for node in function.of(syntax.Binary):
        if node.operator == 'mask' and id(node) not in allowed:
            yield node.at


UNPROVEN = (
    Form('`Case 1, 2`', 'one value (p714)', 'write a Case for each'),
    Form(
        '`ByRef a(1)`',
        'variables and whole arrays (p184)',
        'pass a() and the index',
        _elements_by_reference,
    ),
    Form(
        '`Do While a` with `Loop Until b`',
        'one condition, after Do or after Loop (p289)',
        'use If and Exit Do',
    ),
    Form('`For a(1) = …`', 'a variable (p344)', 'copy the element'),
    Form(
        'a parameter of another motion (`Go P1 ROT`)',
        'the parameters of each motion on its page, and one of Till, Find and Sense',
        'omit it',
    ),
    Form(
        '`Go P1 !Speed 5!`, `Go Here !On 1!`',
        'I/O, Signal, WaitSig, Wait and Print in !…!, and no Here before it (p55 to p57)',
        'split it',
    ),
    Form('`Go P1, CP`', 'blanks between the parameters (p353)', 'remove the comma'),
    Form('`Wait Not Sw(1)`', 'And, Or, Xor and Mask (p881)', 'compare with Off', _negated_waits),
    Form('`Motor 1`, `CP 1`, `QP 1`', 'On and Off (p549)', 'use If'),
    Form('`PLocal P1, 2`', '`PLocal(P1) = 2` (p634)', 'assign'),
    Form(
        '`Else Print 1`',
        'Else, ElseIf … Then and Default as whole lines (p419, p714)',
        'start a new line',
    ),
    Form('`WOpen "a" As 30`', '# before the number (p892)', 'add it'),
    Form('`Trap 1, a Call f()`', 'the name alone (p851)', 'remove the brackets'),
    Form(
        '`If In(0) Mask 3 = 1`',
        'Mask in conditions of Wait, Till, Find, Sense and Trap (p527)',
        'write And',
        _masks_elsewhere,
    ),
    Form('`Declare f, "a.dll"`', 'As and a type (p278)', 'add them'),
)
"""Syntax that neither the manual nor 46,212 lines in 44 public folders contain."""


def unproven(program: Program) -> Iterator[Problem]:
    for form in UNPROVEN:
        text = f'{form.form}: the manual has {form.manual}: {form.instead}'
        for file in program.files:
            places = [at for name, at in file.marks if name == form.form]
            if form.find is not None:
                places += chain.from_iterable(map(form.find, file.functions))
            yield from (Problem(at, 'portable', text, warning=True) for at in places)


def included(program: Program, files: Mapping[str, str]) -> Iterator[Problem]:
    for function in (function for file in program.files for function in file.functions):
        lines = files[function.at.file].split('\n')
        for number in range(function.at.line, function.end.line):
            if re.match(r'\s*#\s*include\b', lines[number], re.IGNORECASE):
                at = Position(function.at.file, number + 1)
                text = f'#include in the function {function.name}: put it above (p62)'
                yield Problem(at, 'include', text, warning=True)


def unused(program: Program, files: Mapping[str, str], roots: set[str]) -> Iterator[Problem]:
    """Yield functions and variables whose name occurs only once.

    The functions in `roots` start tasks, so they count as used. An occurrence in a comment or in
    an inactive #ifdef is a use, too.
    """
    times = Counter(name for text in files.values() for name in _names(text))
    functions = [element for file in program.files for element in file.functions]
    words = {
        node.name.lower()
        for function in functions
        for node in function.of(syntax.Command, syntax.Stub)
    }
    if 'main' in roots and not words & _WINDOWS:
        for function in functions:
            name = function.name.lower()
            if times[name] == 1 and name not in roots and not name.startswith('test'):
                text = f'{function.name} is never called'
                yield Problem(function.at, 'unused', text, warning=True)
    for file in program.files:
        module = [
            declaration for declaration in file.declarations if declaration.scope == 'module'
        ]
        if module:
            yield from _once(module, Counter(_names(files.get(file.name, ''))))
        lines = files.get(file.name, '').split('\n')
        for function in file.functions:
            if own := list(function.of(syntax.Declaration)):
                text = '\n'.join(lines[function.at.line - 1 : function.end.line])
                yield from _once(own, Counter(_names(text)))


def _names(text: str) -> Iterator[str]:
    """Yield the names in a text, in lower case.

    For `Pi` also yield `i`, because `Pi` may mean `P(i)`.
    """
    for word in re.findall(r'[^\W\d]\w*\$?', text.lower()):
        yield word
        if word[0] == 'p':
            yield word[1:]


def _once(declarations: list[syntax.Declaration], times: Counter[str]) -> Iterator[Problem]:
    for declaration in declarations:
        for variable in declaration.variables:
            if times[variable.name.lower()] == 1:
                text = f'{variable.name} is never used'
                yield Problem(variable.at, 'unused', text, warning=True)


def shared(
    tasks: Mapping[str, set[str]], functions: Mapping[str, syntax.Function]
) -> Iterator[Problem]:
    """Yield a problem for each robot, timer or output that several tasks use.

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


def _chooses_robot(function: syntax.Function) -> bool:
    return any(node.name.lower() == 'robot' for node in function.of(syntax.Command))


def _owned(function: syntax.Function) -> Iterator[tuple[str, Position]]:
    for node in function.of(syntax.Motion, syntax.Command):
        if isinstance(node, syntax.Motion) or node.name.lower() == 'home':
            yield _MOVED, node.at
        elif node.name.lower() in _OWNED:
            first = node.arguments[0]
            number = None if first is None else constant(first, CONSTANTS)
            if number is not None:
                yield _OWNED[node.name.lower()].format(number), node.at


_BACKGROUND = range(65, 81)

SIMULATED = {
    'arm': (0,),
    'robot': (1,),
    'ctrlinfo': (1, 5, 6, 7),
    'robotinfo': (0,),
    'stat': (0, 1),
}
"""Partly simulated function → values of its first argument for which it is simulated."""


def _number(expression: syntax.Expression | None) -> int | float | None:
    return None if expression is None else constant(expression, CONSTANTS)


def _outside(
    name: str, place: int, number: syntax.Expression | None, key: str = ''
) -> Iterator[Problem]:
    value = _number(number)
    if number is None or value is None:
        return
    if wrong := outside(key or name.lower(), place, value):
        yield Problem(number.at, 'range', f'{name}: {wrong}')
    known = SIMULATED.get(name.lower())
    if known is not None and place == 0 and value not in known:
        text = f'{name} {value:g} is not simulated, only {", ".join(map(str, known))}'
        yield Problem(number.at, 'not-simulated', text, warning=True)


_CHECKED = (
    syntax.Command, syntax.Wait, syntax.Name, syntax.Redim, syntax.Xqt, syntax.Motion,
    syntax.TaskCommand, syntax.Share, syntax.Input, syntax.Print, syntax.Transfer, syntax.Apply,
    syntax.Binary, syntax.Select,
)  # fmt: skip
"""Kinds of nodes with numbers that `literals` checks."""


def literals(program: Program) -> Iterator[Problem]:
    for function, bounds in arrays(program):
        for node in function.of(*_CHECKED):
            if isinstance(node, syntax.Command):
                for place, value in enumerate(node.arguments):
                    yield from _outside(node.name, place, value)
                if node.name.lower() == 'pallet' and len(node.arguments) > 2:
                    for name, count in zip(('columns', 'rows'), node.arguments[-2:], strict=True):
                        yield from _outside(name, 0, count)
            elif isinstance(node, syntax.Wait):  # a number alone is a time
                yield from _outside('Wait', 0, node.condition if node.time is None else node.time)
            elif isinstance(node, syntax.Name) and is_point_literal(node.name):
                yield from _outside('P', 0, syntax.Number(int(node.name[1:]), node.at))
            elif isinstance(node, syntax.Redim):
                for bound in node.bounds:
                    yield from _outside('Redim', 0, bound)
            elif isinstance(node, syntax.Xqt) and _number(node.number) not in _BACKGROUND:
                yield from _outside('Xqt', 0, node.number)
            elif isinstance(node, syntax.Motion):
                for name, value in node.numbers:
                    yield from _outside(name.upper(), 0, value)
            elif isinstance(node, syntax.TaskCommand):
                yield from _outside(node.name, 0, node.task)
            elif isinstance(node, syntax.Share):
                yield from _outside('D', 0, node.percent)
            elif isinstance(node, syntax.Input | syntax.Print | syntax.Transfer):
                yield from _device(node.port)
            elif isinstance(node, syntax.Apply):
                name = node.name.lower()
                if known := bounds.get(name):
                    yield from _index(node, known)
                else:
                    for place, argument in enumerate(node.arguments):
                        yield from _outside(node.name, place, argument.value, key_of(name))
            elif isinstance(node, syntax.Binary) and node.operator in ('/', 'mod'):
                if _number(node.right) == 0:
                    yield Problem(node.at, 'range', f'{node.operator.capitalize()} by 0')
            elif isinstance(node, syntax.Select):
                yield from _twice(node)


def _device(port: syntax.Expression | None) -> Iterator[Problem]:
    value = _number(port)
    known = ((0, 24), FILES, PORTS, (501, 508), (1001, 1008))
    if value is not None and port is not None and not any(a <= value <= b for a, b in known):
        yield Problem(port.at, 'range', f'unknown port or file {value:g}')


Bounds = dict[str, tuple[int, ...]]
"""Name of a variable in lower case → its upper bounds, or () if they are not constant."""


def arrays(program: Program) -> Iterator[tuple[syntax.Function, ChainMap[str, tuple[int, ...]]]]:
    """Yield each function with the bounds of its arrays.

    A resized array has the bounds ().
    """
    resized: Bounds = dict.fromkeys(_resized(program), ())
    shared: Bounds = {}
    modules: list[Bounds] = []
    for file in program.files:
        modules.append({})
        for declaration in file.declarations:
            within = modules[-1] if declaration.scope == 'module' else shared
            within.update(_bounds(declaration))
    for file, module in zip(program.files, modules, strict=True):
        for function in file.functions:
            local: Bounds = {parameter.name.lower(): () for parameter in function.parameters}
            for node in function.of(syntax.Declaration):
                local.update(_bounds(node))
            yield function, ChainMap(resized, local, module, shared)


def _bounds(declaration: syntax.Declaration) -> Iterator[tuple[str, tuple[int, ...]]]:
    for variable in declaration.variables:
        numbers = [_number(bound) for bound in variable.bounds]
        known = [number for number in numbers if isinstance(number, int)]
        yield variable.name.lower(), tuple(known) if len(known) == len(numbers) else ()


def _resized(program: Program) -> set[str]:
    result = set()
    for function in (function for file in program.files for function in file.functions):
        result |= {node.name.lower() for node in function.of(syntax.Redim)}
        for node in function.of(syntax.Command, syntax.Apply):
            if node.name.lower() == 'parsestr':
                items = syntax.walk(node.arguments)
                result |= {getattr(item, 'name', '').lower() for item in items}
    return result


def _index(node: syntax.Apply, bounds: tuple[int, ...]) -> Iterator[Problem]:
    for argument, bound in zip(node.arguments, bounds, strict=False):
        index = _number(argument.value)
        if index is not None and index > bound:
            text = f'{node.name}: index {index:g} is above {bound}'
            yield Problem(argument.value.at, 'array-index', text)


def _twice(select: syntax.Select) -> Iterator[Problem]:
    seen: dict[int | float, Position] = {}
    for items, _ in select.cases:
        for item in items:
            value = _number(item.value) if item.operator == '=' else None
            if value is None:
                continue
            if value in seen:
                text = f'Case {value:g} is a duplicate of line {seen[value].line}'
                yield Problem(item.value.at, 'unreachable', text, warning=True)
            seen.setdefault(value, item.value.at)
