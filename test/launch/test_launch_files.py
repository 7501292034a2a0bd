# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Genuine ROS launch, which CI has, executes every launch file, mostly without its processes."""

import re
from itertools import pairwise
from pathlib import Path

import pytest
import yaml
from support.pages import unwrapped

from epson_driver.bringup import DESCRIPTION, INTERFACE
from epson_driver.setup.table import TABLE

actions, sources, utilities, ros, launch = (
    pytest.importorskip(name, reason='no ROS launch')
    for name in (
        'launch.actions',
        'launch.launch_description_sources',
        'launch.utilities',
        'launch_ros.substitutions',
        'launch',
    )
)

ROOT = Path(__file__).parents[2]
FILES = sorted(path.name.split('.')[0] for path in ROOT.glob('launch/*.launch.py'))
FIXED = ('robot_interface_streaming', 'robot_interface_download')
"""Files that set the interface. The others use the controller's default."""

CLIENT_FILES = (
    *('robot_interface', *FIXED),
    *('robot_state_visualize', 'moveit_planning_execution'),
)
LEFT = tuple(f'left_joint_{number}' for number in range(1, 7))


def source(name):
    return sources.PythonLaunchDescriptionSource(str(ROOT / 'launch' / f'{name}.launch.py'))


@pytest.fixture
def launched(monkeypatch):
    """Return a function that executes a launch file, and returns the processes' commands."""
    commands = []

    def execute(action, context):
        action.prepare(context)
        commands.append(action.process_details['cmd'])

    def name_of(found, context):
        return utilities.perform_substitutions(context, found.executable)

    monkeypatch.setattr(actions.ExecuteLocal, 'execute', execute)
    monkeypatch.setattr(ros.ExecutableInPackage, 'perform', name_of)

    def run(name, **arguments):
        context = launch.LaunchContext()
        context.launch_configurations.update(arguments)
        entity = source(name).get_launch_description(context)
        utilities.visit_all_entities_and_collect_futures(entity, context)
        return commands

    return run


def parameters(command):
    """Return the parameters of a node by name. A later file overrides an earlier one."""
    result = {}
    for option, path in pairwise(command):
        if option == '--params-file':
            for section in yaml.full_load(Path(path).read_text('utf-8')).values():
                result |= section.get('ros__parameters', {})
    return result


@pytest.mark.parametrize(
    ('words', 'executables'),
    [
        ('robot_description parent=floor', 'robot_state_publisher static_transform_publisher'),
        ('load_c3_a601s', 'robot_state_publisher'),
        ('test_c3_a601s', 'robot_state_publisher joint_state_publisher_gui rviz2'),
        ('joint_sliders launch_rviz=false', 'robot_state_publisher joint_state_publisher_gui'),
        ('robot_state_visualize', 'client robot_state_publisher rviz2'),
        ('robot_interface', 'client'),
        (
            'robot_interface ros2_control=true',
            'client robot_state_publisher ros2_control_node ros2',
        ),
        ('simulation panel=true', 'sim_controller client panel'),
        (
            'moveit_planning_execution',
            'client robot_state_publisher static_transform_publisher move_group rviz2',
        ),
        ('several_robots panel=true', 'client robot_state_publisher ' * 2 + 'panel'),
        ('fleet use_sim_controller=true robots=robot_1', 'sim_controller client'),
        ('rviz', 'rviz2'),
        ('smooth_goals', 'smooth_goals'),
    ],
)
def test_launch_file_starts_its_executables(launched, words, executables):
    name, *given = words.split()
    commands = launched(name, **dict(item.split('=') for item in given))
    assert [command[0] for command in commands] == executables.split()


@pytest.mark.parametrize('name', CLIENT_FILES)
def test_arguments_are_passed_to_the_client(launched, name, tmp_path):
    defaults = {row.name: row.default for row in TABLE} | {'joint_names': ()}
    interface = {'interface': name.split('_')[-1]} if name in FIXED else {}
    params = tmp_path / 'mine.yaml'
    params.write_text('/**:\n  ros__parameters:\n    state_timeout: 0.5\n')
    words = {'robot_ip': '192.168.0.1', 'controller': 'spel'}
    ports = {'motion_port': 12000, 'state_port': 12002, 'io_port': 0, 'remote_port': 5001}
    place = {'namespace': 'cell', 'tf_prefix': 'left_', 'params_file': str(params)}
    arguments = words | {item: str(port) for item, port in ports.items()} | place
    client = launched(name, **arguments)[0]
    assert {'client', '__ns:=/cell', '__node:=epson_driver'} <= {*client}
    names = {'joint_names': LEFT, 'frame_id': 'left_base_link'}
    values = parameters(client)
    assert values == {'state_timeout': 0.5, **words, **interface, **ports, **names}
    for item, value in values.items():
        assert type(value) is type(defaults[item]), item


def test_every_node_of_moveit_has_namespace_and_prefix(launched):
    commands = launched(
        'moveit_planning_execution', namespace='cell', tf_prefix='left_', ros2_control='true'
    )
    nodes = {command[0]: command for command in commands if '--ros-args' in command}
    assert all('__ns:=/cell' in command for command in nodes.values())
    named = {name for name, command in nodes.items() if '__node:=' in ' '.join(command)}
    assert named == {'client'}  # a name would hide parameters from a process's other nodes
    move_group = parameters(nodes['move_group'])
    assert f'<joint name="{LEFT[0]}"' in move_group['robot_description_semantic']
    assert f'robot_description_planning.joint_limits.{LEFT[0]}.max_jerk' in move_group
    assert parameters(nodes['ros2_control_node'])['joints'] == LEFT
    assert nodes['rviz2'][nodes['rviz2'].index('-f') + 1] == 'left_base_link'


@pytest.mark.invariant(9)
@pytest.mark.parametrize('failing', ['client', 'sim_controller', 'move_group'])
def test_inv9_end_of_a_process_ends_the_launch(failing, monkeypatch, tmp_path):
    for name, line in (('fails', 'exit 9'), ('runs', 'exec sleep 600')):
        (tmp_path / name).write_text(f'#!/bin/sh\n{line}\n')
        (tmp_path / name).chmod(0o755)

    def script(found, context):
        name = utilities.perform_substitutions(context, found.executable)
        return str(tmp_path / ('fails' if name == failing else 'runs'))

    monkeypatch.setattr(ros.ExecutableInPackage, 'perform', script)
    service = launch.LaunchService(noninteractive=True)
    given = [('use_sim_controller', 'true'), ('launch_rviz', 'false')]
    include = actions.IncludeLaunchDescription(
        source('moveit_planning_execution'), launch_arguments=given
    )
    service.include_launch_description(launch.LaunchDescription([include]))
    assert service.run() == 1


def words(text):
    return set(re.findall(r'`(\w+)`', text))


@pytest.mark.parametrize('name', FILES)
def test_docs_list_the_arguments_of_every_launch_file(name):
    text = (ROOT / 'docs' / 'robot.md').read_text(encoding='utf-8')
    item = rf'^\* `{name}.launch.py` \(.*?\): (.*)$'
    (cells,) = re.findall(item, unwrapped(text), re.MULTILINE)
    own = words(cells)
    if "the driver's except" in cells:
        own ^= set(INTERFACE)
    elif "the driver's" in cells:
        own |= set(INTERFACE)
    if 'place' in cells:
        own |= set(DESCRIPTION)
    description = source(name).get_launch_description(launch.LaunchContext())
    assert own == {argument.name for argument in description.get_launch_arguments()}
    _, table = text.split("The driver's arguments:")
    rows = re.findall(r'^\* (`.*?) \(', table, re.MULTILINE)
    assert words(' '.join(rows)) == {*INTERFACE, *DESCRIPTION, 'description'}
