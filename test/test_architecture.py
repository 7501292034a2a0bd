# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The import rule of docs/architecture.md: to a lower layer or within the package, never up."""

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

DOOR = 'robot'
"""What `epson_driver` itself shows: the Python API."""

ANY_SIBLING = frozenset({'*'})
"""All others of the same package: for what puts them together."""


@dataclass(frozen=True)
class Package:
    """What the modules of one package (or of one file beside the packages) may import.

    `imports` are other packages, `libraries` what is not in the standard library; `ros` allows
    rclpy and the ROS messages as well, `dynamic` imports whose name is only known when they run.
    """

    layer: int
    imports: frozenset[str]
    libraries: frozenset[str] | None = frozenset()
    ros: bool = False
    dynamic: bool = False


NOTHING: frozenset[str] = frozenset()
BOTTOM = frozenset(
    {
        'error_texts',
        'inputs',
        'log_lines',
        'motion',
        'profiles',
        'robots',
        'share',
        'simple_message',
        'socket_errors',
    }
)

PACKAGES = {
    'share': Package(0, NOTHING),
    'socket_errors': Package(0, NOTHING),
    'log_lines': Package(0, frozenset({'inputs'})),
    'inputs': Package(0, NOTHING, frozenset({'yaml'})),
    'error_texts': Package(0, frozenset({'inputs', 'share'})),
    'simple_message': Package(0, NOTHING),
    'motion': Package(0, NOTHING, frozenset({'numpy', 'ruckig'})),
    'robots': Package(
        0,
        frozenset({'inputs', 'motion', 'share'}),
        frozenset({'numpy', 'py_opw_kinematics', 'scipy'}),
    ),
    'profiles': Package(0, frozenset({'inputs', 'simple_message', 'share'})),
    'remote_ethernet': Package(1, frozenset({'inputs', 'socket_errors'})),
    'spel': Package(1, frozenset({'inputs'})),
    'link': Package(1, frozenset({'inputs', 'log_lines', 'simple_message', 'socket_errors'})),
    'trace': Package(1, frozenset({'inputs', 'link', 'simple_message'})),
    'sim_controller': Package(2, BOTTOM | {'remote_ethernet', 'spel'}, ANY),
    'driver': Package(2, BOTTOM | {'link', 'remote_ethernet', 'trace'}, frozenset({'numpy'})),
    'node': Package(3, BOTTOM | {'link', 'remote_ethernet', 'trace', 'driver'}, ANY, ros=True),
    'planning': Package(3, BOTTOM, ANY),
    'api': Package(3, BOTTOM | {'link', 'driver'}, frozenset({'numpy'})),
    'aio': Package(3, BOTTOM | {'driver', 'api'}, frozenset({'numpy'})),
    'robot': Package(3, frozenset({'aio', 'api', 'motion', 'robots'}), frozenset({'numpy'})),
    'report': Package(3, BOTTOM | {'link', 'trace', 'driver'}, frozenset({'numpy', 'rosbags'})),
    'doctor': Package(3, BOTTOM | {'remote_ethernet'}, frozenset({'numpy', 'yaml'})),
    'bringup': Package(
        3, frozenset({'inputs', 'profiles', 'robots', 'share'}), frozenset({'xacro'})
    ),
    'panel': Package(
        3,
        BOTTOM | {'node', 'remote_ethernet', 'sim_controller'},
        frozenset({'numpy', 'viser', 'websockets'}),
        ros=True,
    ),
    'cli': Package(
        4,
        BOTTOM
        | {
            'link',
            'remote_ethernet',
            'trace',
            'spel',
            'sim_controller',
            'driver',
            'node',
            'panel',
            'planning',
            'report',
            'doctor',
            'exercise',
        },
        ANY,
        ros=True,
        dynamic=True,
    ),
}

PACKAGES['exercise'] = Package(
    4,
    BOTTOM | {'cli', 'remote_ethernet', 'report', 'sim_controller'},
    frozenset({'numpy', 'pytest'}),
)
"""It starts the executables as processes, and is the library of one of them."""

BESIDE = {
    ('cli', 'exercise'),
    ('exercise', 'cli'),
    ('robots', 'inputs'),
    ('robots', 'motion'),
    ('robots', 'share'),
    ('log_lines', 'inputs'),
    ('error_texts', 'inputs'),
    ('error_texts', 'share'),
    ('profiles', 'inputs'),
    ('profiles', 'simple_message'),
    ('profiles', 'share'),
    ('trace', 'link'),
    ('aio', 'api'),
    ('robot', 'api'),
    ('robot', 'aio'),
    ('panel', 'node'),
}
"""Who may import whom on the same layer."""

SUBPACKAGES: dict[str, dict[str, frozenset[str]]] = {
    'sim_controller': {
        'clock': NOTHING,
        'condition': NOTHING,
        'ports': NOTHING,
        'spel_host': frozenset(
            {'arm', 'clock', 'condition', 'core', 'io', 'ports', 'programs', 'remote'}
        ),
        'arm': NOTHING,
        'io': frozenset({'clock', 'ports'}),
        'faults': frozenset({'clock', 'ports'}),
        'state': frozenset({'clock', 'condition', 'ports'}),
        'programs': frozenset({'arm', 'clock', 'condition', 'ports'}),
        'remote': frozenset({'arm', 'clock', 'condition', 'faults', 'io', 'ports'}),
        'core': frozenset(
            {'arm', 'clock', 'condition', 'faults', 'io', 'ports', 'programs', 'state'}
        ),
        'client_connections': frozenset(
            {'clock', 'condition', 'core', 'faults', 'io', 'ports', 'programs', 'remote', 'state'}
        ),
        'network': frozenset({'arm', 'client_connections', 'core', 'ports'}),
        'assembly': ANY_SIBLING,
    },
    'driver': {
        'tasks': NOTHING,
        'outcome': NOTHING,
        'state': NOTHING,
        'smoothing': frozenset({'tasks'}),
        'io': frozenset({'tasks'}),
        'delivery': frozenset({'outcome', 'state'}),
        'stopping': frozenset({'delivery', 'state', 'tasks'}),
        'goal': frozenset({'delivery', 'outcome', 'smoothing', 'state', 'stopping', 'tasks'}),
        'servo': frozenset({'delivery', 'goal', 'outcome', 'state', 'stopping'}),
        'configuration': frozenset({'delivery', 'smoothing', 'state', 'stopping'}),
        'driver': ANY_SIBLING,
        'arm_commands': ANY_SIBLING,
    },
}
"""Of packages with packages of their own: what each of these, or file beside them, may import."""

ROS_ENDINGS = ('_msgs', '_srvs', '_interfaces', '_ros')
WITHOUT_ROS = ('rosbags',)
"""Libraries of others that only sound like it: pure Python, no ROS installation."""

ROS_BEGINNINGS = ('ament_', 'launch', 'rcl', 'ros2', 'rosbag', 'rosidl_', 'tf2', 'tracetools')


def is_ros(library: str) -> bool:
    """Return whether a top-level module belongs to ROS."""
    if library in WITHOUT_ROS:
        return False
    return library.endswith(ROS_ENDINGS) or library.startswith(ROS_BEGINNINGS)


def violations(root: Path) -> Iterator[str]:
    """Yield `file:line: what is wrong` for every import against the tables."""
    for path in sorted((root / PACKAGE).rglob('*.py')):
        parts = path.relative_to(root).with_suffix('').parts
        tree = ast.parse(path.read_text(encoding='utf-8'), str(path))
        for line, wrong in _wrong_imports(tree, parts):
            yield f'{path.relative_to(root).as_posix()}:{line}: {wrong}'


def _wrong_imports(tree: ast.Module, parts: tuple[str, ...]) -> Iterator[tuple[int, str]]:
    package = parts[1]  # a folder, or a file beside the folders
    for node in ast.walk(tree):
        for target in _targets(node, parts):
            wrong = _judge(package, target) or _judge_inside(parts, target)
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
        for alias in node.names:  # `from epson_driver import link` imports the package
            yield (*base, alias.name) if base == (PACKAGE,) else base
    elif isinstance(node, ast.Call):
        name = getattr(node.func, 'id', getattr(node.func, 'attr', ''))
        if name in ('import_module', '__import__'):
            yield ('importlib', name)


def _judge(package: str, target: tuple[str, ...]) -> str:
    """Return what is wrong with an import in a package, or nothing."""
    if package == '__init__':
        allowed = target[:1] == ('typing',) or target[:2] == (PACKAGE, DOOR)
        rule = f'it may import nothing but {DOOR}, when it is asked for'
        return '' if allowed else f'{PACKAGE}/__init__.py imports {".".join(target)}: {rule}'
    if package not in PACKAGES:
        return f'{package} has no row in PACKAGES'
    rules = PACKAGES[package]
    top = target[0]
    if top == PACKAGE:
        other = target[1] if len(target) > 1 else '*'
        allowed = other == package or other in rules.imports
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
    return '' if allowed else f'{package} imports {other}'


def _judge_inside(parts: tuple[str, ...], target: tuple[str, ...]) -> str:
    """Return what is wrong with an import among the packages of a package, or nothing."""
    table = SUBPACKAGES.get(parts[1])
    if table is None or len(parts) < 3 or parts[2] == '__init__' or target[:2] != parts[:2]:
        return ''
    here, other = parts[2], target[2] if len(target) > 2 else '*'
    if here not in table:
        return f'{parts[1]}.{here} has no row in SUBPACKAGES'
    allowed = other == here or other in table[here] or table[here] is ANY_SIBLING
    return '' if allowed else f'{parts[1]}.{here} imports {parts[1]}.{other}'


def modules() -> list[Path]:
    """Return every Python file of the package."""
    return sorted((ROOT / PACKAGE).rglob('*.py'))


def test_no_import_goes_up_or_across() -> None:
    assert list(violations(ROOT)) == []


def test_every_folder_has_a_row() -> None:
    folders = {path.parent.name for path in (ROOT / PACKAGE).glob('*/__init__.py')}
    files = {path.stem for path in (ROOT / PACKAGE).glob('*.py')} - {'__init__'}
    assert folders | files == set(PACKAGES)


def test_every_folder_of_a_ruled_package_has_a_row() -> None:
    for name, table in SUBPACKAGES.items():
        folder = ROOT / PACKAGE / name
        folders = {path.parent.name for path in folder.glob('*/__init__.py')}
        files = {path.stem for path in folder.glob('*.py')} - {'__init__'}
        assert folders | files == set(table)


def test_the_table_itself_goes_down_only() -> None:
    for name, package in PACKAGES.items():
        for other in package.imports:
            below = PACKAGES[other].layer < package.layer
            assert below or (name, other) in BESIDE
    assert 'sim_controller' not in PACKAGES['node'].imports | PACKAGES['driver'].imports
    assert 'driver' not in PACKAGES['sim_controller'].imports
    assert {name for name, package in PACKAGES.items() if package.ros} == {'node', 'cli', 'panel'}


def imports_of_files(root: Path) -> dict[str, set[str]]:
    """Return for each module of the package (dotted) which others it imports."""
    names = {}
    for path in sorted((root / PACKAGE).rglob('*.py')):
        parts = path.relative_to(root).with_suffix('').parts
        names['.'.join(parts[:-1] if parts[-1] == '__init__' else parts)] = (path, parts)
    found: dict[str, set[str]] = {}
    for name, (path, parts) in names.items():
        found[name] = set()
        for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
            targets = {'.'.join(target) for target in _targets(node, parts)}
            if isinstance(node, ast.ImportFrom):  # its names may be modules
                inner = {f'{base}.{each.name}' for base in targets for each in node.names}
                targets = inner if inner <= names.keys() else targets | inner
            found[name] |= targets & names.keys()
        found[name] -= {name}
    return found


def circles(imports: dict[str, set[str]]) -> list[list[str]]:
    """Return groups of modules that import each other, be it through others."""

    def reached(start: str) -> set[str]:
        seen: set[str] = set()
        left = [start]
        while left:
            for each in imports[left.pop()] - seen:
                seen.add(each)
                left.append(each)
        return seen

    reach = {name: reached(name) for name in imports}
    groups = {
        tuple(sorted(other for other in reach[name] if name in reach[other])) for name in imports
    }
    return [list(group) for group in sorted(groups) if group]


def test_no_circle_between_files() -> None:
    assert circles(imports_of_files(ROOT)) == []


def test_no_import_hides_a_circle_from_python() -> None:
    for path in modules():
        if path == ROOT / PACKAGE / '__init__.py':
            continue  # it names its door for type checkers; nobody imports from it
        assert 'TYPE_CHECKING' not in path.read_text(encoding='utf-8'), path


WITH_UNDERSCORE = {'_asdict', '_exit', '_fields', '_make', '_replace'}
"""Names of the standard library that are public all the same."""


def private_uses(code: str) -> list[str]:
    """Return the attributes that code takes from others although they are private."""
    nodes = [node for node in ast.walk(ast.parse(code)) if isinstance(node, ast.Attribute)]
    return [
        ast.unparse(node)
        for node in nodes
        if node.attr.startswith('_')
        and not node.attr.endswith('__')
        and node.attr not in WITH_UNDERSCORE
        and ast.unparse(node.value) not in ('self', 'cls')
    ]


@pytest.mark.parametrize('folder', ['epson_driver/sim_controller', 'test/sim_controller'])
def test_private_attributes_are_their_own_class_s_only(folder: str) -> None:
    uses = {
        path.relative_to(ROOT).as_posix(): private_uses(path.read_text(encoding='utf-8'))
        for path in sorted((ROOT / folder).rglob('*.py'))
    }
    assert {path: found for path, found in uses.items() if found} == {}


def test_private_uses_are_found() -> None:
    code = 'self._a\ncls._b\nos._exit(0)\nx.__class__\nx._c = 1\nself.y._d()\nself._e._f\n'
    assert sorted(private_uses(code)) == ['self._e._f', 'self.y._d', 'x._c']


def test_a_circle_is_found(tmp_path: Path) -> None:
    folder = tmp_path / PACKAGE / 'link'
    folder.mkdir(parents=True)
    (folder / 'a.py').write_text(
        'from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n  from epson_driver.link import b\n'
    )
    (folder / 'b.py').write_text('from epson_driver.link.c import x\n')
    (folder / 'c.py').write_text('def f():\n  import epson_driver.link.a\n')
    names = [f'{PACKAGE}.link.{name}' for name in 'abc']
    assert circles(imports_of_files(tmp_path)) == [names]
    (folder / 'c.py').write_text('')
    assert circles(imports_of_files(tmp_path)) == []


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
        (
            'link/a.py',
            'import epson_driver.sim_controller.arm.servo',
            'link imports sim_controller',
        ),
        ('link/a.py', 'import rclpy.node as n', 'link imports rclpy'),
        (
            'sim_controller/a.py',
            'from epson_driver.link import Link',
            'sim_controller imports link',
        ),
        (
            'sim_controller/a.py',
            'def f():\n  import epson_driver.node',
            'sim_controller imports node',
        ),
        (
            'sim_controller/a.py',
            'from sensor_msgs.msg import Joy',
            'sim_controller imports sensor_msgs',
        ),
        (
            'sim_controller/a.py',
            'from std_srvs.srv import Empty',
            'sim_controller imports std_srvs',
        ),
        ('node/a.py', 'import rclpy\nfrom epson_driver import link, motion', ''),
        ('node/a.py', 'from ..sim_controller import servo', 'node imports sim_controller'),
        ('node/a.py', 'from epson_driver.cli.demo import main', 'node imports cli'),
        (
            'node/a.py',
            'import importlib\nimportlib.import_module("epson_driver.sim_controller")',
            'node imports import_module(…)',
        ),
        ('link/a.py', '__import__("rclpy")', 'link imports __import__(…)'),
        (
            'link/a.py',
            'from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n  from ..node import node',
            'link imports node',
        ),
        ('cli/a.py', 'from epson_driver import node, sim_controller\nimport rich, rclpy', ''),
        ('driver/driver.py', 'from epson_driver.driver.goal import goal\nimport numpy', ''),
        ('driver/driver.py', 'import rclpy', 'driver imports rclpy'),
        ('driver/goal/a.py', 'from epson_driver.driver.delivery import trajectory_points', ''),
        (
            'driver/delivery/a.py',
            'from epson_driver.driver.goal import goal',
            'driver.delivery imports driver.goal',
        ),
        ('driver/state/a.py', 'from ..tasks import b', 'driver.state imports driver.tasks'),
        ('sim_controller/assembly.py', 'from epson_driver.sim_controller.core import x', ''),
        (
            'sim_controller/core.py',
            'from epson_driver.sim_controller.client_connections import x',
            'sim_controller.core imports sim_controller.client_connections',
        ),
        (
            'sim_controller/core.py',
            'from epson_driver.sim_controller.remote import status_words',
            'sim_controller.core imports sim_controller.remote',
        ),
        (
            'sim_controller/remote/a.py',
            'from epson_driver.sim_controller.core import Controller',
            'sim_controller.remote imports sim_controller.core',
        ),
        (
            'sim_controller/arm/a.py',
            'from epson_driver.sim_controller.programs.program import Program',
            'sim_controller.arm imports sim_controller.programs',
        ),
        ('driver/attic/a.py', 'from ..tasks import b', 'driver.attic has no row in SUBPACKAGES'),
        ('cli/a.py', 'from importlib import import_module\nimport_module("x")', ''),
        ('share.py', 'from pathlib import Path', ''),
        ('share.py', 'from epson_driver.robots import x', 'share imports robots'),
        ('share.py', 'from . import robots', 'share imports robots'),
        ('attic/a.py', 'import math', 'attic has no row in PACKAGES'),
        (
            '__init__.py',
            'from .share import share_file',
            'epson_driver/__init__.py imports epson_driver.share: '
            'it may import nothing but robot, when it is asked for',
        ),
        ('__init__.py', 'def __getattr__(name):\n  from epson_driver import robot', ''),
        ('robot.py', 'import rclpy', 'robot imports rclpy'),
        ('aio.py', 'from epson_driver.node import node', 'aio imports node'),
        ('api/a.py', 'from epson_driver.sim_controller import core', 'api imports sim_controller'),
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
    ('package', 'libraries'),
    [
        ('simple_message', []),
        ('motion', ['numpy', 'ruckig']),
        ('robots', ['numpy', 'ruckig', 'yaml']),
        ('profiles', ['yaml']),
    ],
)
def test_the_lowest_layer_really_loads_without_ros(package: str, libraries: list[str]) -> None:
    code = (
        'import sys; before = set(sys.modules)\n'
        f'import {PACKAGE}.{package}\n'
        'tops = {name.split(".")[0] for name in set(sys.modules) - before}\n'
        f'print(*sorted(tops - sys.stdlib_module_names - {{"{PACKAGE}"}}))'
    )
    run = subprocess.run(
        [sys.executable, '-c', code], cwd=ROOT, capture_output=True, text=True, check=True
    )
    loaded = [name for name in run.stdout.split() if not name.startswith(('_', 'cython'))]
    assert loaded == libraries


def test_the_package_loads_nothing_until_it_is_asked_for() -> None:
    code = (
        'import sys, epson_driver\n'
        f'print(*sorted(name for name in sys.modules if name.startswith("{PACKAGE}.")))\n'
        'print("numpy" in sys.modules, epson_driver.Robot.__module__, "rclpy" in sys.modules)'
    )
    run = subprocess.run(
        [sys.executable, '-c', code], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert run.stdout.splitlines() == ['', f'False {PACKAGE}.robot False']


@pytest.mark.parametrize('path', modules(), ids=lambda path: path.relative_to(ROOT).as_posix())
def test_every_module_has_its_licence_and_its_docstring(path: Path) -> None:
    text = path.read_text(encoding='utf-8')
    assert tuple(text.splitlines()[:2]) == LICENCE
    assert ast.get_docstring(ast.parse(text))
