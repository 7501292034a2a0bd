# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Genuine ROS launch executes every launch file, mostly without its processes.

All but the first test are skipped without ROS launch. CI runs them with it.
"""

import ast
import importlib
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
import yaml
from support.pages import unwrapped

from epson_driver.bringup import DESCRIPTION, INTERFACE
from epson_driver.setup.table import TABLE

ROOT = Path(__file__).parents[2]
FILES = sorted((ROOT / 'launch').glob('*.launch.py'))
FIXED = ('robot_interface_streaming', 'robot_interface_download')
"""Files that set the interface. The others use the controller's default."""

CLIENT_FILES = (
    *('robot_interface', *FIXED),
    *('robot_state_visualize', 'moveit_planning_execution'),
)
EACH_FILE = pytest.mark.parametrize('path', FILES, ids=lambda path: path.name)
LEFT = tuple(f'left_joint_{number}' for number in range(1, 7))


@EACH_FILE
def test_packages_executables_and_imports_of_a_launch_file_exist(path: Path) -> None:
    manifests = [ROOT / 'package.xml', *ROOT.glob('variants/*/package.xml')]
    depends = {
        item.text for file in manifests for item in ElementTree.parse(file).iter('exec_depend')
    }
    for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
        if isinstance(node, ast.ImportFrom) and (node.module or '').startswith('epson_driver'):
            module = importlib.import_module(node.module or '')
            assert [item.name for item in node.names if not hasattr(module, item.name)] == []
        if isinstance(node, ast.Call):
            words = {item.arg: getattr(item.value, 'value', '') for item in node.keywords}
            if words.get('package') == 'epson_driver':
                assert (ROOT / 'scripts' / words['executable']).is_symlink()
            elif 'package' in words:
                assert words['package'] in depends


@dataclass
class Started:
    """A process that a launch file starts: its executable, arguments and parameters."""

    executable: str
    arguments: list[str]

    def option(self, name: str) -> str:
        """Return the word after an option."""
        return self.arguments[self.arguments.index(name) + 1]

    @property
    def values(self) -> dict[str, Any]:
        """The node's parameters by name. A later file overrides an earlier one."""
        result: dict[str, Any] = {}
        for option, path in zip(self.arguments, self.arguments[1:], strict=False):
            if option == '--params-file':
                for section in yaml.full_load(Path(path).read_text('utf-8')).values():
                    result |= section.get('ros__parameters', {})
        return result


Launch = Callable[..., list[Started]]


@pytest.fixture
def launched(monkeypatch: pytest.MonkeyPatch) -> Launch:
    """Return a function that executes a launch file, and returns the processes."""
    substitutions = pytest.importorskip('launch_ros.substitutions', reason='no ROS launch')
    actions, launch = (importlib.import_module(name) for name in ('launch.actions', 'launch'))
    utilities = importlib.import_module('launch.utilities')
    started: list[Any] = []

    def execute(action: Any, context: Any) -> None:
        action.prepare(context)
        started.append(action)

    def name_of(found: Any, context: Any) -> str:
        return str(utilities.perform_substitutions(context, found.executable))

    monkeypatch.setattr(actions.ExecuteLocal, 'execute', execute)
    monkeypatch.setattr(substitutions.ExecutableInPackage, 'perform', name_of)

    def run(name: str, **arguments: str) -> list[Started]:
        started.clear()
        context = launch.LaunchContext()
        context.launch_configurations.update(arguments)
        path = ROOT / 'launch' / f'{name}.launch.py'
        source = importlib.import_module('launch.launch_description_sources')
        entity = source.PythonLaunchDescriptionSource(str(path)).get_launch_description(context)
        utilities.visit_all_entities_and_collect_futures(entity, context)
        commands = (item.process_details['cmd'] for item in started)
        return [Started(first, list(others)) for first, *others in commands]

    return run


def the_client(started: list[Started]) -> Started:
    (node,) = (item for item in started if item.executable == 'client')
    return node


STARTED = (
    ('load_c3_a601s', {}, 'robot_state_publisher'),
    ('robot_description', {}, 'robot_state_publisher'),
    (
        'robot_description',
        {'parent': 'floor'},
        'robot_state_publisher static_transform_publisher',
    ),
    ('test_c3_a601s', {}, 'robot_state_publisher joint_state_publisher_gui rviz2'),
    ('joint_sliders', {'launch_rviz': 'false'}, 'robot_state_publisher joint_state_publisher_gui'),
    ('robot_state_visualize', {}, 'client robot_state_publisher rviz2'),
    ('robot_state_visualize', {'launch_rviz': 'false'}, 'client robot_state_publisher'),
    ('robot_interface', {}, 'client'),
    ('robot_interface_download', {}, 'client'),
    ('robot_interface_streaming', {}, 'client'),
    ('simulation', {}, 'sim_controller client'),
    ('simulation', {'panel': 'true'}, 'sim_controller client panel'),
    (
        'robot_interface',
        {'ros2_control': 'true'},
        'client robot_state_publisher ros2_control_node ros2',
    ),
    (
        'moveit_planning_execution',
        {},
        'client robot_state_publisher static_transform_publisher move_group rviz2',
    ),
    ('several_robots', {'panel': 'true'}, 'client robot_state_publisher ' * 2 + 'panel'),
    (
        'fleet',
        {'use_sim_controller': 'true', 'robots': 'robot_1'},
        'sim_controller client',
    ),
    ('rviz', {}, 'rviz2'),
    ('smooth_goals', {}, 'smooth_goals'),
)


@pytest.mark.parametrize(('name', 'given', 'executables'), STARTED)
def test_launch_file_starts_its_executables(
    launched: Launch, name: str, given: dict[str, str], executables: str
) -> None:
    assert [item.executable for item in launched(name, **given)] == executables.split()


@pytest.mark.parametrize('name', CLIENT_FILES)
def test_arguments_are_passed_to_the_client(launched: Launch, name: str, tmp_path: Path) -> None:
    defaults = {row.name: row.default for row in TABLE} | {'joint_names': ()}
    interface = {'interface': name.split('_')[-1]} if name in FIXED else {}
    params = tmp_path / 'mine.yaml'
    params.write_text('/**:\n  ros__parameters:\n    state_timeout: 0.5\n')
    words = {'robot_ip': '192.168.0.1', 'controller': 'rc700a'}
    ports = {'motion_port': 12000, 'state_port': 12002, 'io_port': 0, 'remote_port': 5001}
    place = {'namespace': 'cell', 'tf_prefix': 'left_', 'params_file': str(params)}
    arguments = words | {item: str(port) for item, port in ports.items()} | place
    node = the_client(launched(name, **arguments))
    assert {'__ns:=/cell', '__node:=epson_driver'} <= {*node.arguments}
    names = {'joint_names': LEFT, 'frame_id': 'left_base_link'}
    assert node.values == {'state_timeout': 0.5, **words, **interface, **ports, **names}
    for item, value in node.values.items():
        assert type(value) is type(defaults[item]), item


def test_every_node_of_moveit_has_namespace_and_prefix(launched: Launch) -> None:
    started = launched(
        'moveit_planning_execution', namespace='cell', tf_prefix='left_', ros2_control='true'
    )
    nodes = {item.executable: item for item in started if '--ros-args' in item.arguments}
    assert all('__ns:=/cell' in item.arguments for item in nodes.values())
    named = {name for name, item in nodes.items() if '__node:=' in ' '.join(item.arguments)}
    assert named == {'client'}  # a name would hide parameters from a process's other nodes
    move_group, manager = nodes['move_group'].values, nodes['ros2_control_node'].values
    assert f'<joint name="{LEFT[0]}"' in move_group['robot_description_semantic']
    assert f'robot_description_planning.joint_limits.{LEFT[0]}.max_jerk' in move_group
    assert manager['joints'] == LEFT
    assert nodes['rviz2'].option('-f') == 'left_base_link'


@pytest.mark.invariant(9)
@pytest.mark.parametrize('failing', ['client', 'sim_controller', 'move_group'])
def test_inv9_end_of_a_process_ends_the_launch(
    failing: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    substitutions = pytest.importorskip('launch_ros.substitutions', reason='no ROS launch')
    launch = importlib.import_module('launch')
    for name, line in (('fails', 'exit 9'), ('runs', 'exec sleep 600')):
        (tmp_path / name).write_text(f'#!/bin/sh\n{line}\n')
        (tmp_path / name).chmod(0o755)

    def script(found: Any, _context: Any) -> str:
        name = ''.join(part.text for part in found.executable)
        return str(tmp_path / ('fails' if name == failing else 'runs'))

    monkeypatch.setattr(substitutions.ExecutableInPackage, 'perform', script)
    service = launch.LaunchService(noninteractive=True)
    given = [('use_sim_controller', 'true'), ('launch_rviz', 'false')]
    source = importlib.import_module('launch.launch_description_sources')
    path = str(ROOT / 'launch' / 'moveit_planning_execution.launch.py')
    include = importlib.import_module('launch.actions').IncludeLaunchDescription
    service.include_launch_description(
        launch.LaunchDescription(
            [include(source.PythonLaunchDescriptionSource(path), launch_arguments=given)]
        )
    )
    assert service.run() == 1


def words(text: str) -> set[str]:
    return set(re.findall(r'`(\w+)`', text))


@EACH_FILE
def test_docs_list_the_arguments_of_every_launch_file(path: Path) -> None:
    pytest.importorskip('launch_ros', reason='no ROS launch')
    source = importlib.import_module('launch.launch_description_sources')
    description = source.get_launch_description_from_python_launch_file(str(path))
    text = (ROOT / 'docs' / 'robot.md').read_text(encoding='utf-8')
    item = rf'^\* `{re.escape(path.name)}` \(.*?\): (.*)$'
    (cells,) = re.findall(item, unwrapped(text), re.MULTILINE)
    own = words(cells)
    if "the driver's except" in cells:
        own ^= set(INTERFACE)
    elif "the driver's" in cells:
        own |= set(INTERFACE)
    if 'place' in cells:
        own |= set(DESCRIPTION)
    assert own == {argument.name for argument in description.get_launch_arguments()}
    _, table = text.split("The driver's arguments:")
    rows = re.findall(r'^\* (`.*?) \(', table, re.MULTILINE)
    assert words(' '.join(rows)) == {*INTERFACE, *DESCRIPTION, 'description'}
