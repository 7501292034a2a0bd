# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The import rule of docs/architecture.md: an import goes down or stays in its room, never up."""

import ast
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = 'epson_driver'
LICENCE = (
    '# Copyright 2026 the epson_driver developers',
    '# SPDX-License-Identifier: Apache-2.0',
)

ANY = None
"""Any library at all, apart from ROS."""


@dataclass(frozen=True)
class Room:
    """What the modules of one folder (or of one file beside the folders) may import.

    `imports` are other rooms, `libraries` what is not in the standard library; `ros` allows rclpy
    and the ROS messages as well, `dynamic` imports whose name is only known when they run.
    """

    floor: int
    imports: frozenset[str]
    libraries: frozenset[str] | None = frozenset()
    ros: bool = False
    dynamic: bool = False


NOTHING: frozenset[str] = frozenset()
GROUND = frozenset(
    {
        'controllers',
        'error_texts',
        'inputs',
        'log_lines',
        'motion',
        'remote_errors',
        'robots',
        'share',
        'simple_message',
    }
)

ROOMS = {
    'share': Room(0, NOTHING),
    'remote_errors': Room(0, NOTHING),
    'log_lines': Room(0, frozenset({'inputs'})),
    'inputs': Room(0, NOTHING, frozenset({'yaml'})),
    'error_texts': Room(0, frozenset({'inputs', 'share'})),
    'simple_message': Room(0, NOTHING),
    'motion': Room(0, NOTHING, frozenset({'numpy', 'ruckig'})),
    'robots': Room(
        0,
        frozenset({'inputs', 'motion', 'share'}),
        frozenset({'numpy', 'py_opw_kinematics', 'scipy'}),
    ),
    'controllers': Room(0, frozenset({'inputs', 'simple_message', 'share'})),
    'bringup': Room(1, frozenset({'inputs', 'robots', 'share'}), frozenset({'xacro'})),
    'link': Room(1, GROUND, ANY),
    'controller': Room(1, GROUND, ANY),
    'planning': Room(1, GROUND, ANY),
    'client': Room(2, GROUND | {'link'}, ANY, ros=True),
    'cli': Room(
        3, GROUND | {'link', 'controller', 'client', 'planning'}, ANY, ros=True, dynamic=True
    ),
}

BESIDE = {
    ('robots', 'inputs'),
    ('robots', 'motion'),
    ('robots', 'share'),
    ('log_lines', 'inputs'),
    ('error_texts', 'inputs'),
    ('error_texts', 'share'),
    ('controllers', 'inputs'),
    ('controllers', 'simple_message'),
    ('controllers', 'share'),
}
"""Who may import whom on the ground floor."""

ROS_ENDINGS = ('_msgs', '_srvs', '_interfaces', '_ros')
ROS_BEGINNINGS = ('ament_', 'launch', 'rcl', 'ros2', 'rosbag', 'rosidl_', 'tf2', 'tracetools')


def is_ros(library: str) -> bool:
    """Return whether a top-level module belongs to ROS."""
    return library.endswith(ROS_ENDINGS) or library.startswith(ROS_BEGINNINGS)


def violations(root: Path) -> Iterator[str]:
    """Yield `file:line: what is wrong` for every import in `root`/epson_driver against ROOMS."""
    for path in sorted((root / PACKAGE).rglob('*.py')):
        parts = path.relative_to(root).with_suffix('').parts
        room = parts[1]  # a folder, or a file beside the folders
        tree = ast.parse(path.read_text(encoding='utf-8'), str(path))
        for line, wrong in _wrong_imports(tree, parts, room):
            yield f'{path.relative_to(root).as_posix()}:{line}: {wrong}'


def _wrong_imports(
    tree: ast.Module, parts: tuple[str, ...], room: str
) -> Iterator[tuple[int, str]]:
    for node in ast.walk(tree):
        for target in _targets(node, parts):
            wrong = _judge(room, target)
            if wrong:
                yield node.lineno, wrong


def _targets(node: ast.AST, parts: tuple[str, ...]) -> Iterator[tuple[str, ...]]:
    """Yield what a statement imports as dotted parts, relative imports made absolute."""
    if isinstance(node, ast.Import):
        for alias in node.names:
            yield tuple(alias.name.split('.'))
    elif isinstance(node, ast.ImportFrom):
        base = parts[: -node.level] if node.level else ()
        base += tuple(node.module.split('.')) if node.module else ()
        for alias in node.names:  # `from epson_driver import link` imports the room
            yield (*base, alias.name) if base == (PACKAGE,) else base
    elif isinstance(node, ast.Call):
        name = getattr(node.func, 'id', getattr(node.func, 'attr', ''))
        if name in ('import_module', '__import__'):
            yield ('importlib', name)


def _judge(room: str, target: tuple[str, ...]) -> str:
    """Return what is wrong with an import in a room, or nothing."""
    if room == '__init__':
        return f'{PACKAGE}/__init__.py imports {".".join(target)}: it must import nothing'
    if room not in ROOMS:
        return f'{room} has no row in ROOMS'
    rules = ROOMS[room]
    top = target[0]
    if top == PACKAGE:
        other = target[1] if len(target) > 1 else '*'
        allowed = other == room or other in rules.imports
    elif target in (('importlib', 'import_module'), ('importlib', '__import__')):
        other = f'{target[1]}(…)'
        allowed = rules.dynamic
    elif is_ros(top):
        other = top
        allowed = rules.ros
    else:
        other = top
        known = rules.libraries is ANY or top in rules.libraries
        allowed = known or top in sys.stdlib_module_names
    return '' if allowed else f'{room} imports {other}'


def modules() -> list[Path]:
    """Return every Python file of the package."""
    return sorted((ROOT / PACKAGE).rglob('*.py'))


def test_no_import_goes_up_or_across() -> None:
    assert list(violations(ROOT)) == []


def test_every_folder_of_the_package_is_a_room() -> None:
    folders = {path.parent.name for path in (ROOT / PACKAGE).glob('*/__init__.py')}
    files = {path.stem for path in (ROOT / PACKAGE).glob('*.py')} - {'__init__'}
    assert folders | files == set(ROOMS)


def test_the_table_itself_goes_down_only() -> None:
    for name, room in ROOMS.items():
        for other in room.imports:
            below = ROOMS[other].floor < room.floor
            assert below or (name, other) in BESIDE
    assert 'controller' not in ROOMS['client'].imports
    assert 'client' not in ROOMS['controller'].imports
    assert {name for name, room in ROOMS.items() if room.ros} == {'client', 'cli'}


@pytest.mark.parametrize(
    ('file', 'code', 'expected'),
    [
        ('motion/a.py', 'import numpy.typing, ruckig, math', ''),
        ('motion/a.py', 'import scipy', 'motion imports scipy'),
        ('motion/a.py', 'from epson_driver.share import share_file', 'motion imports share'),
        ('simple_message/a.py', 'from numpy import array', 'simple_message imports numpy'),
        ('simple_message/a.py', 'from . import b', ''),
        ('simple_message/a.py', 'from .b import c', ''),
        ('simple_message/a.py', 'from .. import link', 'simple_message imports link'),
        ('simple_message/a.py', 'from ..link.link import Link', 'simple_message imports link'),
        ('simple_message/deep/a.py', 'from ..b import c', ''),
        ('simple_message/deep/a.py', 'from ...motion import go', 'simple_message imports motion'),
        ('simple_message/__init__.py', 'from .a import b', ''),
        ('simple_message/__init__.py', 'from ..robots import b', 'simple_message imports robots'),
        ('robots/a.py', 'from epson_driver.motion import Array\nimport scipy, numpy', ''),
        ('robots/a.py', 'from epson_driver import share, link', 'robots imports link'),
        ('robots/a.py', 'import epson_driver', 'robots imports *'),
        ('bringup/a.py', 'import launch', 'bringup imports launch'),
        ('link/a.py', 'from epson_driver.simple_message import Framer', ''),
        ('link/a.py', 'import epson_driver.controller.arm.servo', 'link imports controller'),
        ('link/a.py', 'import rclpy.node as n', 'link imports rclpy'),
        ('controller/a.py', 'from epson_driver.link import Link', 'controller imports link'),
        ('controller/a.py', 'def f():\n  import epson_driver.client', 'controller imports client'),
        ('controller/a.py', 'from sensor_msgs.msg import Joy', 'controller imports sensor_msgs'),
        ('controller/a.py', 'from std_srvs.srv import Empty', 'controller imports std_srvs'),
        ('client/a.py', 'import rclpy\nfrom epson_driver import link, motion', ''),
        ('client/a.py', 'from ..controller import servo', 'client imports controller'),
        ('client/a.py', 'from epson_driver.cli.demo import main', 'client imports cli'),
        (
            'client/a.py',
            'import importlib\nimportlib.import_module("epson_driver.controller")',
            'client imports import_module(…)',
        ),
        ('link/a.py', '__import__("rclpy")', 'link imports __import__(…)'),
        (
            'link/a.py',
            'from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n  from ..client import node',
            'link imports client',
        ),
        ('cli/a.py', 'from epson_driver import client, controller\nimport rich, rclpy', ''),
        ('cli/a.py', 'from importlib import import_module\nimport_module("x")', ''),
        ('share.py', 'from pathlib import Path', ''),
        ('share.py', 'from epson_driver.robots import x', 'share imports robots'),
        ('share.py', 'from . import robots', 'share imports robots'),
        ('attic/a.py', 'import math', 'attic has no row in ROOMS'),
        (
            '__init__.py',
            'from .share import share_file',
            'epson_driver/__init__.py imports epson_driver.share: it must import nothing',
        ),
    ],
)
def test_the_rule_finds_a_violation(file: str, code: str, expected: str, tmp_path: Path) -> None:
    path = tmp_path / PACKAGE / file
    path.parent.mkdir(parents=True)
    path.write_text(code, encoding='utf-8')
    line = code.count('\n') + 1
    found = list(violations(tmp_path))
    assert found == ([f'{PACKAGE}/{file}:{line}: {expected}'] if expected else [])


@pytest.mark.parametrize(
    ('room', 'libraries'),
    [
        ('simple_message', []),
        ('motion', ['numpy', 'ruckig']),
        ('robots', ['numpy', 'ruckig', 'yaml']),
        ('controllers', ['yaml']),
    ],
)
def test_the_ground_floor_really_loads_without_ros(room: str, libraries: list[str]) -> None:
    code = (
        'import sys; before = set(sys.modules)\n'
        f'import {PACKAGE}.{room}\n'
        'tops = {name.split(".")[0] for name in set(sys.modules) - before}\n'
        f'print(*sorted(tops - sys.stdlib_module_names - {{"{PACKAGE}"}}))'
    )
    run = subprocess.run(
        [sys.executable, '-c', code], cwd=ROOT, capture_output=True, text=True, check=True
    )
    loaded = [name for name in run.stdout.split() if not name.startswith(('_', 'cython'))]
    assert loaded == libraries


@pytest.mark.parametrize('path', modules(), ids=lambda path: path.relative_to(ROOT).as_posix())
def test_every_module_has_its_licence_and_its_docstring(path: Path) -> None:
    text = path.read_text(encoding='utf-8')
    assert tuple(text.splitlines()[:2]) == LICENCE
    assert ast.get_docstring(ast.parse(text))
