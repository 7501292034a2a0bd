# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Writes the tables and lists that come from elsewhere, no wider than 120 columns.

Parameters in ros_interface.md, from node/parameters.py; error numbers in troubleshooting.md,
from config/errors/epson.yaml; robot models in new_robot.md, from config/robots; the tests of each
invariant in invariants.md, from their marker, one file a line.

Run it after a change there: `python docs/make_tables.py`. Tests compare them.
"""

import ast
import textwrap
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path

from epson_driver.error_texts import NO_ERROR, load_error_texts
from epson_driver.node.parameters import TABLE, Row, joint_rows
from epson_driver.robots import load_robot_model, robot_models

DOCS = Path(__file__).parent
TEST = DOCS.parent / 'test'
INVARIANTS = range(1, 10)
WIDTH = 120
KINDS = {bool: 'bool', int: 'integer', float: 'double', str: 'string', list: 'array'}


def parameters() -> Iterator[str]:
    """Yield an item for each parameter; `<joint>` stands for each joint's name."""
    for row in (*TABLE, *joint_rows('<joint>')):
        written = _written(row.default)
        kind = KINDS[type(row.default)]
        change = 'any time' if row.now else 'at start'
        about = ', '.join(filter(None, (kind, written and f'`{written}`', _allowed(row), change)))
        description = row.description.replace('<joint>', '`<joint>`')
        yield item(f'`{row.name}` ({about}): {description}')


def errors() -> Iterator[str]:
    """Yield an item for each error number."""
    for number, text in load_error_texts('epson').items():
        if number != NO_ERROR:
            doubt = '' if text.confirmed else ' (**not confirmed**)'
            remedy = f' → {text.remedy}' if text.remedy else ''
            yield item(f'`{number}`{doubt}: {text.meaning}{remedy}')


def models() -> Iterator[str]:
    """Yield the table of the robot models."""
    marks = {'high': '', 'medium': 'medium', 'low': '**low**'}
    quantities = ('position', 'velocity', 'acceleration', 'pulses_per_degree', 'chain')
    heads = ('range', 'speed', 'acceleration', 'encoder', 'chain')
    yield _row('model', 'kind', 'reach [mm]', 'payload [kg]', *heads)
    yield _row(*['---'] * (4 + len(heads)))
    for name in robot_models():
        model = load_robot_model(name)
        yield _row(
            f'[{name}](../config/robots/{name}.yaml)',
            model.kind,
            f'{model.reach[0] * 1e3:.0f}',
            '' if model.payload is None else f'{model.payload:g}',
            *(marks[model.provenance[each].worst] for each in quantities),
        )


def invariants() -> Iterator[str]:
    """Yield an item for each invariant: how many tests carry its number; below, in which files."""
    found: dict[int, Counter[str]] = defaultdict(Counter)
    for path in sorted(TEST.rglob('test_*.py')):
        for number in marked(path.read_text(encoding='utf-8')):
            found[number][path.relative_to(TEST.parent).as_posix()] += 1
    for number in sorted({*INVARIANTS, *found}):
        yield f'* **{number}**: {found[number].total()} tests\n'
        yield from (f'  * `{file}`\n' for file in found[number])


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
    """Return a page with its generated part as it should be."""
    mark, lines = TABLES[name]
    begin, end = f'<!-- {mark}: begin -->\n', f'<!-- {mark}: end -->\n'
    head, rest = (DOCS / name).read_text(encoding='utf-8').split(begin)
    return head + begin + ''.join(lines()) + end + rest.split(end)[1]


def item(text: str) -> str:
    """Return an item of a list, wrapped."""
    return (
        textwrap.fill(
            text,
            WIDTH,
            initial_indent='* ',
            subsequent_indent='  ',
            break_long_words=False,
            break_on_hyphens=False,
        )
        + '\n'
    )


def _row(*cells: str) -> str:
    return f'| {" | ".join(cells)} |\n'


def _written(default: object) -> str:
    if isinstance(default, list):
        return ', '.join(map(str, default))
    return str(default).lower() if isinstance(default, bool) else str(default)


def _allowed(row: Row) -> str:
    if row.choices:
        return ', '.join(row.choices)
    return '' if row.low is None else f'{row.low:g} … {row.high:g}'


TABLES: dict[str, tuple[str, Callable[[], Iterator[str]]]] = {
    'invariants.md': ('tests', invariants),
    'new_robot.md': ('models', models),
    'ros_interface.md': ('parameters', parameters),
    'troubleshooting.md': ('errors', errors),
}

if __name__ == '__main__':
    for name in TABLES:
        (DOCS / name).write_text(page(name), encoding='utf-8')
