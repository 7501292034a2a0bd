# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What imports what: each room only what its row says, and a row only what stands above it."""

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = 'epson_driver'

ROOMS = {
    'socket_errors': '',
    'share': '',
    'inputs': 'yaml',
    'simple_message': '',
    'motion': 'numpy ruckig',
    'processes': 'numpy',
    'log_lines': 'inputs',
    'error_texts': 'inputs share',
    'trajectory_file': 'inputs motion numpy',
    'profiles': 'inputs share simple_message',
    'robots': 'inputs motion numpy share xacro',
    'pages': 'motion numpy robots',
    'tool_motion': 'motion numpy robots',
    'taught_points': 'inputs motion numpy robots tool_motion',
    'spel': 'error_texts inputs share',
    'remote_ethernet': 'inputs socket_errors',
    'link': 'inputs log_lines remote_ethernet simple_message socket_errors',
    'trace': 'inputs link simple_message',
    'sim_controller': 'error_texts inputs log_lines motion numpy processes profiles '
    'remote_ethernet robots share simple_message socket_errors spel tool_motion',
    'driver': 'error_texts inputs link log_lines motion numpy processes profiles remote_ethernet '
    'simple_message trace',
    'setup': 'driver error_texts inputs link motion numpy profiles robots simple_message',
    'api': 'driver error_texts inputs link motion numpy processes remote_ethernet '
    'robots setup simple_message taught_points tool_motion trace trajectory_file',
    'aio': 'api setup taught_points',
    'robot': 'aio api taught_points',
    'node': 'ROS driver error_texts inputs link log_lines motion numpy processes profiles robots '
    'setup simple_message taught_points tool_motion trace',
    'report': 'driver error_texts inputs link matplotlib motion numpy pages robots rosbags '
    'simple_message trace',
    'bringup': 'inputs profiles robots share yaml',
    'doctor': 'ROS driver error_texts motion node numpy processes profiles remote_ethernet robots '
    'simple_message socket_errors trace yaml',
    'first_run': 'doctor driver error_texts inputs motion numpy profiles robots sim_controller '
    'simple_message trace',
    'panel': 'ROS driver motion node numpy pages remote_ethernet robots sim_controller '
    'tool_motion websockets',
    'exercise': 'ROS error_texts inputs motion node numpy processes profiles pytest '
    'remote_ethernet report robots sim_controller',
    'demo': 'ROS error_texts inputs matplotlib motion node numpy panel processes remote_ethernet '
    'report rich robots simple_message',
}
"""Files and folders of the package, from the ground up: what each imports, of them and of others.

A row names only rows before it, so nothing is imported upwards and there is no circle. ROS stands
for rclpy and all that comes with ROS. The command line, `ON_TOP`, may import anything.
"""

ON_TOP = 'cli'

INSIDE = {
    'sim_controller': {
        'clock': '',
        'condition': '',
        'ports': '',
        'arm': '',
        'io': 'clock ports',
        'faults': 'clock ports',
        'state': 'clock condition ports',
        'programs': 'arm clock condition ports',
        'remote': 'arm clock condition faults io ports',
        'core': 'arm clock condition faults io ports programs state',
        'client_connections': 'clock condition core faults io ports programs remote state',
        'spel_host': 'arm clock condition core io ports programs remote',
        'network': 'arm client_connections core ports',
        'assembly': 'arm client_connections condition core programs spel_host',
        'spel_run': 'assembly condition core network spel_host',
    },
    'driver': {
        'tasks': '',
        'remedy': '',
        'inhibit': 'remedy',
        'outcome': 'remedy',
        'state': '',
        'io': 'tasks',
        'smoothing': '',
        'smoothing_worker': 'smoothing',
        'delivery': 'outcome state',
        'stopping': 'delivery state tasks',
        'configuration': 'delivery smoothing state stopping',
        'channel': 'configuration delivery io stopping',
        'goal': 'configuration delivery inhibit outcome remedy smoothing state stopping tasks',
        'servo': 'delivery goal inhibit outcome state stopping',
        'why_not': 'channel goal inhibit remedy servo state stopping',
        'driver': 'channel configuration goal inhibit outcome servo state stopping tasks why_not',
        'arm_commands': 'driver inhibit remedy stopping tasks',
    },
}
"""The same for rooms that have rooms of their own; only each other are named."""

ROS_ENDINGS = ('_msgs', '_srvs', '_interfaces', '_ros')
ROS_BEGINNINGS = ('ament_', 'launch', 'rcl', 'ros2', 'rosidl_', 'tf2', 'tracetools')


def is_ros(library: str) -> bool:
    """Return whether a top-level module belongs to ROS."""
    return library.endswith(ROS_ENDINGS) or library.startswith(ROS_BEGINNINGS)


def targets(path: Path, root: Path = ROOT) -> Iterator[tuple[int, tuple[str, ...]]]:
    """Yield line and dotted parts of every import in a file, relative ones made absolute."""
    parts = path.relative_to(root).with_suffix('').parts
    for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'), str(path))):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, tuple(alias.name.split('.'))) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = parts[: -node.level] if node.level else ()
            base += tuple(node.module.split('.')) if node.module else ()
            yield from ((node.lineno, (*base, alias.name)) for alias in node.names)
        elif isinstance(node, ast.Call):
            name = getattr(node.func, 'id', getattr(node.func, 'attr', ''))
            if name in ('import_module', '__import__'):
                yield node.lineno, (f'{name}(…)',)


def named(parts: tuple[str, ...], target: tuple[str, ...]) -> Iterator[tuple[str, str]]:
    """Yield the table (a room's name, or '') and the name that an import counts as in it."""
    if target[0] != PACKAGE:
        if target[0] not in sys.stdlib_module_names:
            yield '', 'ROS' if is_ros(target[0]) else target[0]
    elif target[1:2] != parts[1:2]:
        yield '', target[1] if len(target) > 1 else '*'
    elif parts[1] in INSIDE and '__init__' not in (parts[2], target[2]) and target[2] != parts[2]:
        yield parts[1], target[2]


def differences(root: Path = ROOT, *, rows_too: bool = True) -> list[str]:
    """Return how the files differ from the tables: `file:line: a imports b`, and unused rows."""
    found = []
    unused = {
        (table, room, name)
        for table, rows in {'': ROOMS, **INSIDE}.items()
        for room, row in rows.items()
        for name in row.split()
    }
    for path in sorted((root / PACKAGE).glob('*/**/*.py')) + sorted((root / PACKAGE).glob('*.py')):
        parts = path.relative_to(root).with_suffix('').parts
        if parts[1] in (ON_TOP, '__init__'):
            continue
        for line, target in targets(path, root):
            for table, name in named(parts, target):
                room = parts[2] if table else parts[1]
                rows = INSIDE[table] if table else ROOMS
                if name not in rows.get(room, '').split():
                    where = path.relative_to(root).as_posix()
                    found.append(f'{where}:{line}: {room} imports {name}')
                unused.discard((table, room, name))
    lost = [f'{room} no longer imports {name}: strike it' for _, room, name in sorted(unused)]
    return found + (lost if rows_too else [])


def test_every_room_imports_what_its_row_says() -> None:
    assert differences() == []


def test_one_file_has_the_command_that_starts_python() -> None:
    files = (ROOT / PACKAGE).rglob('*.py')
    named = {path.name for path in files if 'sys.executable' in path.read_text('utf-8')}
    assert named == {'command.py', 'fleet.py', 'environment.py'}  # two only show it


def test_rows_name_only_what_stands_above_them() -> None:
    for rows in (ROOMS, *INSIDE.values()):
        for place, (room, row) in enumerate(rows.items()):
            wrong = set(row.split()) & set(list(rows)[place:])
            assert not wrong, f'{room} imports {wrong}, which stand below it in the table'


def test_every_room_has_a_row() -> None:
    for folder, rows in {'': [*ROOMS, ON_TOP], **INSIDE}.items():
        place = ROOT / PACKAGE / folder
        folders = {path.parent.name for path in place.glob('*/__init__.py')}
        files = {path.stem for path in place.glob('*.py')} - {'__init__'}
        assert folders | files == set(rows)


def test_the_documented_order_is_that_of_the_table() -> None:
    text = (ROOT / 'docs' / 'architecture.md').read_text(encoding='utf-8')
    rows = re.findall(r'^[├└]── (\w[\w./, ]*?)  ', text, re.MULTILINE)
    found = [name.strip(' /').removesuffix('.py') for row in rows for name in row.split(',')]
    assert found == [*ROOMS, ON_TOP]


def test_the_driver_knows_no_names_of_ros() -> None:
    files = (ROOT / PACKAGE / 'driver').rglob('*.py')
    assert [path.name for path in files if '~/' in path.read_text('utf-8')] == []


def test_the_two_sides_of_the_wire_and_ros_are_kept_apart() -> None:
    def below(room: str) -> set[str]:
        direct = set(ROOMS.get(room, '').split())
        return direct.union(*map(below, direct))

    assert not {'driver', 'link'} & below('sim_controller')
    for room in ('driver', 'robot', 'node'):
        assert 'sim_controller' not in below(room)
    users = {'doctor', 'panel', 'exercise', 'demo'}
    assert {room for room in ROOMS if 'ROS' in ROOMS[room].split()} == {'node', *users}


def test_no_circle_between_files() -> None:
    files = {}
    for path in sorted((ROOT / PACKAGE).rglob('*.py')):
        parts = path.relative_to(ROOT).with_suffix('').parts
        files['.'.join(parts).removesuffix('.__init__')] = path
    graph = {
        name: {
            module if module in files else module.rpartition('.')[0]
            for _, target in targets(path)
            if target[0] == PACKAGE and (module := '.'.join(target)) != name
        }
        for name, path in files.items()
    }
    TopologicalSorter(graph).prepare()  # raises CycleError, which names the files


def test_a_circle_would_be_found() -> None:
    with pytest.raises(CycleError):
        TopologicalSorter({'a': {'b'}, 'b': {'a'}}).prepare()


@pytest.mark.parametrize(
    ('file', 'code', 'expected'),
    [
        ('motion/a.py', 'import numpy.typing, ruckig, math', ''),
        ('motion/a.py', 'import scipy', 'motion imports scipy'),
        ('motion/a.py', 'from epson_driver.share import share_file', 'motion imports share'),
        ('simple_message/a.py', 'from . import b\nfrom .b import c', ''),
        ('simple_message/a.py', 'from .. import link', 'simple_message imports link'),
        ('simple_message/deep/a.py', 'from ...motion import go', 'simple_message imports motion'),
        ('link/a.py', 'import rclpy.node as n', 'link imports ROS'),
        ('link/a.py', '__import__("rclpy")', 'link imports __import__(…)'),
        ('link/a.py', 'if False:\n  from ..node import node', 'link imports node'),
        ('sim_controller/a.py', 'def f():\n  import epson_driver.node', 'imports node'),
        ('sim_controller/arm/a.py', 'from std_srvs.srv import Empty', 'imports ROS'),
        ('driver/delivery/a.py', 'from epson_driver.driver.goal import x', 'imports goal'),
        ('driver/state/a.py', 'from ..tasks import b', 'state imports tasks'),
        ('driver/attic/a.py', 'from ..tasks import b', 'attic imports tasks'),
        ('share.py', 'from . import robots', 'share imports robots'),
        ('attic/a.py', 'from epson_driver.cli.demo import main', 'attic imports cli'),
        ('cli/a.py', 'from epson_driver import node\nimport rich, rclpy', ''),
    ],
)
def test_a_wrong_import_is_found(file: str, code: str, expected: str, tmp_path: Path) -> None:
    path = tmp_path / PACKAGE / file
    path.parent.mkdir(parents=True)
    path.write_text(code, encoding='utf-8')
    found = differences(tmp_path, rows_too=False)
    line = code.count('\n') + 1
    assert len(found) == bool(expected)
    assert not expected or (
        found[0].startswith(f'{PACKAGE}/{file}:{line}: ') and found[0].endswith(expected)
    )


def test_an_import_that_is_gone_is_found(tmp_path: Path) -> None:
    assert 'spel no longer imports inputs: strike it' in differences(tmp_path)


def loaded(code: str) -> list[str]:
    """Return what a new Python prints after running code, as words."""
    run = subprocess.run(
        [sys.executable, '-c', code], cwd=ROOT, capture_output=True, text=True, check=True
    )
    return run.stdout.split()


@pytest.mark.parametrize(
    ('package', 'libraries'),
    [
        ('simple_message', []),
        ('motion', ['numpy', 'ruckig']),
        ('robots', ['numpy', 'ruckig']),
        ('profiles', []),
    ],
)
def test_the_ground_really_loads_without_ros(package: str, libraries: list[str]) -> None:
    code = (
        'import sys; before = set(sys.modules)\n'
        f'import {PACKAGE}.{package}\n'
        'tops = {name.split(".")[0] for name in set(sys.modules) - before}\n'
        f'print(*sorted(tops - sys.stdlib_module_names - {{"{PACKAGE}"}}))'
    )
    assert [x for x in loaded(code) if not x.startswith(('_', 'cython'))] == libraries


def test_the_package_loads_nothing_until_it_is_asked_for() -> None:
    code = (
        'import sys, epson_driver\n'
        f'print(*sorted(name for name in sys.modules if name.startswith("{PACKAGE}.")))\n'
        'print("numpy" in sys.modules, epson_driver.Robot.__module__, "rclpy" in sys.modules)'
    )
    assert loaded(code) == ['False', f'{PACKAGE}.robot', 'False']


def test_the_python_api_loads_the_driver_with_the_first_robot() -> None:
    rooms = ('driver.driver', 'link', 'motion.smoother', 'profiles', 'simple_message', 'trace')
    late = {'rclpy', 'rich', 'yaml', *(f'{PACKAGE}.{room}' for room in rooms)}
    code = (
        'import sys\n'
        f'from {PACKAGE} import Robot\n'
        f'print(*{late} & set(sys.modules))\n'
        'Robot()\n'
        f'print("{PACKAGE}.driver.driver" in sys.modules)'
    )
    assert loaded(code) == ['True']
