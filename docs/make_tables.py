# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Writes the tables that come from elsewhere.

Parameters in ros_interface.md, from node/parameters.py; error numbers in troubleshooting.md,
from config/errors/epson.yaml; robot models in new_robot.md, from config/robots; the tests of each
invariant in invariants.md, from their marker.

Run it after a change there: `python docs/make_tables.py`. Tests compare them.
"""

import ast
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path

from epson_driver.error_texts import NO_ERROR, load_error_texts
from epson_driver.node.parameters import TABLE, Row, joint_rows
from epson_driver.robots import load_robot_model, robot_models

DOCS = Path(__file__).parent
TEST = DOCS.parent / 'test'
INVARIANTS = range(1, 10)
KINDS = {bool: 'bool', int: 'integer', float: 'double', str: 'string', list: 'array'}


def parameters() -> Iterator[tuple[str, ...]]:
    """Yield the rows of the parameters; `<joint>` stands for each joint's name."""
    yield 'name', 'type', 'default', 'allowed', 'change', ''
    for row in (*TABLE, *joint_rows('<joint>')):
        yield (
            f'`{row.name}`',
            KINDS[type(row.default)],
            _written(row.default),
            _allowed(row),
            'any time' if row.now else 'at start',
            row.description.replace('<joint>', '`<joint>`'),
        )


def errors() -> Iterator[tuple[str, ...]]:
    """Yield the rows of the error numbers."""
    yield 'number', 'meaning', 'what to do', 'confirmed'
    for number, text in load_error_texts('epson').items():
        if number != NO_ERROR:
            confirmed = 'yes' if text.confirmed else '**no**'
            yield str(number), text.meaning, text.remedy, confirmed


def models() -> Iterator[tuple[str, ...]]:
    """Yield the rows of the robot models."""
    marks = {'high': '', 'medium': 'medium', 'low': '**low**'}
    quantities = ('position', 'velocity', 'acceleration', 'pulses_per_degree', 'chain')
    yield 'model', 'kind', 'reach', 'payload', *(each.replace('_', ' ') for each in quantities)
    for name in robot_models():
        model = load_robot_model(name)
        yield (
            f'[{name}](../config/robots/{name}.yaml)',
            model.kind,
            f'{model.reach[0] * 1e3:.0f} mm',
            '' if model.payload is None else f'{model.payload:g} kg',
            *(marks[model.provenance[each].worst] for each in quantities),
        )


def invariants() -> Iterator[tuple[str, ...]]:
    """Yield the rows of the invariants: how many tests carry the number, and in which files."""
    found: dict[int, Counter[str]] = defaultdict(Counter)
    for path in sorted(TEST.rglob('test_*.py')):
        for number in marked(path.read_text(encoding='utf-8')):
            found[number][path.relative_to(TEST.parent).as_posix()] += 1
    yield '', 'tests', 'in'
    for number in sorted({*INVARIANTS, *found}):
        files = ', '.join(f'`{file}`' for file in found[number])
        yield str(number), str(found[number].total()), files


def marked(module: str) -> Iterator[int]:
    """Yield the numbers of `pytest.mark.invariant`, once for each test of a module."""
    tree = ast.parse(module)
    of_all: set[int] = set()
    for node in tree.body:
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == 'pytestmark':
            of_all = _numbers(node.value)
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            if node.name.startswith('test'):
                yield from of_all.union(*map(_numbers, node.decorator_list))
        elif isinstance(node, ast.Assign) and ast.unparse(node.value).endswith('.TestCase'):
            yield from of_all  # hypothesis makes a test of a state machine


def _numbers(expression: ast.expr) -> set[int]:
    return {
        ast.literal_eval(number)
        for node in ast.walk(expression)
        if isinstance(node, ast.Call) and ast.unparse(node.func) == 'pytest.mark.invariant'
        for number in node.args
    }


def page(name: str) -> str:
    """Return a page with its table as it should be."""
    mark, rows = TABLES[name]
    begin, end = f'<!-- {mark}: begin -->\n', f'<!-- {mark}: end -->\n'
    head, rest = (DOCS / name).read_text(encoding='utf-8').split(begin)
    return head + begin + _table(rows()) + end + rest.split(end)[1]


def _table(rows: Iterator[tuple[str, ...]]) -> str:
    first = next(rows)
    lines = [first, ('---',) * len(first), *rows]
    return ''.join(f'| {" | ".join(line)} |\n' for line in lines)


def _written(default: object) -> str:
    if isinstance(default, list):
        return ', '.join(map(str, default))
    return str(default).lower() if isinstance(default, bool) else str(default)


def _allowed(row: Row) -> str:
    if row.choices:
        return ', '.join(row.choices)
    return '' if row.low is None else f'{row.low:g} … {row.high:g}'


TABLES: dict[str, tuple[str, Callable[[], Iterator[tuple[str, ...]]]]] = {
    'invariants.md': ('tests', invariants),
    'new_robot.md': ('models', models),
    'ros_interface.md': ('parameters', parameters),
    'troubleshooting.md': ('errors', errors),
}

if __name__ == '__main__':
    for name in TABLES:
        (DOCS / name).write_text(page(name), encoding='utf-8')
