# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Generates the site's reference of the Python API from docstrings.

The sources are parsed, not imported, except the table of settings.
"""

import ast
import inspect
import textwrap
from collections.abc import Iterator
from pathlib import Path

from epson_driver.setup.table import ROWS

DOCS = Path(__file__).parent
PACKAGE = DOCS.parent / 'epson_driver'
WIDTH = 120
MAX_SIGNATURE = 100
"""Maximum length of a signature on one line, characters."""

CLASSES = (
    ('aio.py', 'Robot'),
    ('api/motion.py', 'Motion'),
    ('api/io.py', 'Io'),
    ('api/io.py', 'Gripper'),
    ('api/points.py', 'Points'),
    ('taught_points.py', 'EpsonPoint'),
    ('api/recording.py', 'Recording'),
    ('api/settings.py', 'Settings'),
    ('api/status.py', 'RobotStatus'),
    ('api/status.py', 'ControllerError'),
    ('driver/io/gripper_wiring.py', 'GripperWiring'),
    ('driver/io/gripper_wiring.py', 'GripperState'),
    ('inputs/rules.py', 'RobotError'),
    ('api/errors.py', 'MotionError'),
    ('inputs/rules.py', 'ArgumentError'),
    ('api/errors.py', 'PathError'),
)
"""File and class, in the order of the page."""

WITHIN = ('start', 'finish')
"""Internal methods."""

PARTS = {'Arm': 'api/arm.py', 'Motions': 'api/motions.py', 'Streams': 'api/streams.py'}
"""Base classes whose members are listed in the derived class."""

Function = ast.FunctionDef | ast.AsyncFunctionDef

HEAD = """\
# Python API reference

[Python: the arm in ten lines](python.md) explains it, with examples. All of it is in
`epson_driver.robot`; `from epson_driver import Robot` is enough for most programs.

`epson_driver.aio` has the same classes for asyncio: there every method is awaited that is not
a property, `simulated`, `pose_in`, one of the `set_` or one of the `on_` methods. `catch_up` and
`measured` are there alone.
"""


def page() -> str:
    """Return the page."""
    title, *rest = HEAD.split('\n\n')
    parts = [title + '\n', *map(_wrapped, rest)]
    for file, name in CLASSES:
        parts.extend(_class(_read(file, name)))
    return '\n'.join(parts)


def _read(file: str, name: str) -> ast.ClassDef:
    tree = ast.parse((PACKAGE / file).read_text(encoding='utf-8'))
    (result,) = (
        node for node in tree.body if isinstance(node, ast.ClassDef) and node.name == name
    )
    return result


def _class(node: ast.ClassDef) -> Iterator[str]:
    names = [ast.unparse(base) for base in node.bases]
    parts = [_read(PARTS[name], name) for name in ('Arm', *names) if {*names} & {*PARTS}]
    bases = ', '.join(name for name in names if name not in PARTS)
    yield f'## {node.name}\n'
    if bases:
        yield f'A `{bases}`.\n'
    yield _text(node)
    fields = [_field(item) for item in node.body if isinstance(item, ast.AnnAssign)]
    if fields:
        yield '```py\n' + '\n'.join(fields) + '\n```\n'
    for element in [*node.body, *(element for part in parts for element in part.body)]:
        if not isinstance(element, Function) or element.name in WITHIN:
            continue
        if element.name == '__init__' and not fields and len(element.args.kwonlyargs) > 1:
            yield _code(element, node.name)
        yield from _attributes(element)
        if not element.name.startswith('_') and ast.get_docstring(element):
            yield f'### {node.name}.{element.name}\n'
            yield _property(element) if _is_property(element) else _code(element, element.name)
            yield _text(element)


def _attributes(function: Function) -> Iterator[str]:
    """Yield the attributes with a docstring."""
    for before, after in zip(function.body, function.body[1:], strict=False):
        if (
            isinstance(before, ast.Assign)
            and isinstance(before.targets[0], ast.Attribute)
            and isinstance(after, ast.Expr)
            and isinstance(after.value, ast.Constant)
            and isinstance(after.value.value, str)
            and isinstance(before.value, ast.Call)
        ):
            name = before.targets[0].attr
            kind = ast.unparse(before.value.func)
            yield f'### Robot.{name}\n'
            yield f'```py\n{name}: {kind}\n```\n'
            yield _wrapped(after.value.value)


def _is_property(function: Function) -> bool:
    return any(ast.unparse(item) == 'property' for item in function.decorator_list)


def _field(node: ast.AnnAssign) -> str:
    """Return a field. A field of `Settings` has the default of its row."""
    if isinstance(node.value, ast.Call) and ast.unparse(node.value.func) == 'setting':
        name, *usual = (ast.literal_eval(arg) for arg in node.value.args)
        default = usual[0] if usual else ROWS[name].default
        value = tuple(default) if isinstance(default, list) else default
        return f'{ast.unparse(node.target)}: {ast.unparse(node.annotation)} = {value!r}'
    return ast.unparse(node)


def _property(function: Function) -> str:
    return f'```py\n{function.name}: {_returned(function)}\n```\n'


def _returned(function: Function) -> str:
    text = 'None' if function.returns is None else ast.unparse(function.returns)
    return {'Self': 'Robot'}.get(text, text)


def _code(function: Function, name: str) -> str:
    """Return the signature in a block, without self."""
    arguments = function.args
    arguments.args = [item for item in arguments.args if item.arg not in ('self', 'cls')]
    given = ast.unparse(arguments)
    returned = '' if name[0].isupper() else f' -> {_returned(function)}'
    line = f'{name}({given}){returned}'
    if len(line) > MAX_SIGNATURE:
        element = []
        places = [*arguments.posonlyargs, *arguments.args]
        defaults = [None] * (len(places) - len(arguments.defaults)) + list(arguments.defaults)
        element += [_parameter(*pair) for pair in zip(places, defaults, strict=True)]
        if arguments.kwonlyargs:
            element.append('*')
            pairs = zip(arguments.kwonlyargs, arguments.kw_defaults, strict=True)
            element += [_parameter(*pair) for pair in pairs]
        line = f'{name}(\n' + ''.join(f'    {one},\n' for one in element) + f'){returned}'
    return f'```py\n{line}\n```\n'


def _parameter(argument: ast.arg, default: ast.expr | None) -> str:
    text = ast.unparse(argument)
    return text if default is None else f'{text} = {ast.unparse(default)}'


def _text(node: ast.ClassDef | Function) -> str:
    return _wrapped(ast.get_docstring(node) or '')


def _wrapped(docstring: str) -> str:
    """Return paragraphs wrapped to the page width. Indented text is code."""
    paragraphs = []
    for paragraph in inspect.cleandoc(docstring).split('\n\n'):
        if paragraph.startswith('    '):
            paragraphs.append(paragraph)
        else:
            paragraphs.append(
                textwrap.fill(
                    paragraph,
                    WIDTH,
                    break_long_words=False,
                    break_on_hyphens=False,
                )
            )
    return '\n\n'.join(paragraphs) + '\n'
