# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Write docs/python_api.md from the docstrings of the Python API: `python docs/make_api.py`.

The sources are read, not imported. A test compares the page.
"""

import ast
import inspect
import textwrap
from collections.abc import Iterator
from pathlib import Path

DOCS = Path(__file__).parent
PACKAGE = DOCS.parent / 'epson_driver'
PAGE = DOCS / 'python_api.md'
WIDTH = 120
MAX_SIGNATURE = 100
"""A longer one has each parameter on a line of its own, characters."""

CLASSES = (
    ('robot.py', 'Robot'),
    ('api/synchronous.py', 'Motion'),
    ('api/synchronous.py', 'Io'),
    ('api/synchronous.py', 'Gripper'),
    ('api/settings.py', 'Settings'),
    ('api/status.py', 'RobotStatus'),
    ('api/status.py', 'ControllerError'),
    ('driver/io/gripper.py', 'GripperWiring'),
    ('driver/io/gripper.py', 'GripperState'),
    ('api/errors.py', 'RobotError'),
    ('api/errors.py', 'MotionError'),
)
"""File and class, in the order of the page."""

HEAD = """\
# Python API reference

Made by `docs/make_api.py` from the docstrings; [python.md](python.md) explains it, with
examples. All of it is in `epson_driver.robot`; `from epson_driver import Robot` is enough for
most programs.

`epson_driver.aio` has the same classes for asyncio: there every method is awaited that is not
a property, `simulated`, `set_speed_scaling`, `pose_of_epson_point` or one of the `on_` methods,
and `Motion.wait` has no `timeout`, as `asyncio.timeout` does that. Besides, `await
robot.catch_up()` lets what has come be read in a program that held the event loop, and `await
robot.measured(lambda: robot.joints)` reads it then.
"""


def page() -> str:
    """Return the page."""
    title, *rest = HEAD.split('\n\n')
    parts = [title + '\n', *map(_wrapped, rest)]
    for file, name in CLASSES:
        tree = ast.parse((PACKAGE / file).read_text(encoding='utf-8'))
        (found,) = (
            node for node in tree.body if isinstance(node, ast.ClassDef) and node.name == name
        )
        parts.extend(_class(found))
    return '\n'.join(parts)


def _class(node: ast.ClassDef) -> Iterator[str]:
    bases = ', '.join(ast.unparse(base) for base in node.bases)
    yield f'## {node.name}\n'
    if bases:
        yield f'A `{bases}`.\n'
    yield _text(node)
    fields = [_field(each) for each in node.body if isinstance(each, ast.AnnAssign)]
    if fields:
        yield '```py\n' + '\n'.join(fields) + '\n```\n'
    for each in node.body:
        if not isinstance(each, ast.FunctionDef):
            continue
        if each.name == '__init__' and not fields and len(each.args.kwonlyargs) > 1:
            yield _code(each, node.name)
        yield from _attributes(each)
        if not each.name.startswith('_') and ast.get_docstring(each):
            yield f'### {node.name}.{each.name}\n'
            yield _property(each) if _is_property(each) else _code(each, each.name)
            yield _text(each)


def _attributes(function: ast.FunctionDef) -> Iterator[str]:
    """Yield the attributes that have a docstring of their own."""
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


def _is_property(function: ast.FunctionDef) -> bool:
    return any(ast.unparse(each) == 'property' for each in function.decorator_list)


def _field(node: ast.AnnAssign) -> str:
    return ast.unparse(node)


def _property(function: ast.FunctionDef) -> str:
    return f'```py\n{function.name}: {_returned(function)}\n```\n'


def _returned(function: ast.FunctionDef) -> str:
    text = 'None' if function.returns is None else ast.unparse(function.returns)
    return {'R': 'Robot'}.get(text, text)


def _code(function: ast.FunctionDef, name: str) -> str:
    """Return the signature in a block, without self."""
    arguments = function.args
    arguments.args = [each for each in arguments.args if each.arg not in ('self', 'cls')]
    given = ast.unparse(arguments)
    returned = '' if name[0].isupper() else f' -> {_returned(function)}'
    line = f'{name}({given}){returned}'
    if len(line) > MAX_SIGNATURE:
        each = []
        places = [*arguments.posonlyargs, *arguments.args]
        defaults = [None] * (len(places) - len(arguments.defaults)) + list(arguments.defaults)
        each += [_parameter(*pair) for pair in zip(places, defaults, strict=True)]
        if arguments.kwonlyargs:
            each.append('*')
            pairs = zip(arguments.kwonlyargs, arguments.kw_defaults, strict=True)
            each += [_parameter(*pair) for pair in pairs]
        line = f'{name}(\n' + ''.join(f'    {one},\n' for one in each) + f'){returned}'
    return f'```py\n{line}\n```\n'


def _parameter(argument: ast.arg, default: ast.expr | None) -> str:
    text = ast.unparse(argument)
    return text if default is None else f'{text} = {ast.unparse(default)}'


def _text(node: ast.ClassDef | ast.FunctionDef) -> str:
    return _wrapped(ast.get_docstring(node) or '')


def _wrapped(docstring: str) -> str:
    """Return paragraphs as wide as pages are; what is indented is code."""
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


if __name__ == '__main__':
    PAGE.write_text(page(), encoding='utf-8')
