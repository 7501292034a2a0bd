# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Every launch file: what it names exists, and it starts what its name says."""

import importlib.util
import re
import runpy
from pathlib import Path
from typing import Any

import pytest
import yaml
from launch_rules import IMPORTS, ROOT, dependencies, faults
from launch_stand_in import (
    Context,
    IncludeLaunchDescription,
    LaunchError,
    Node,
    declared_names,
    description,
    launched,
)
from support.pages import unwrapped

from epson_driver.bringup import (
    DESCRIPTION,
    INTERFACE,
    BringupError,
    robot_description,
    semantic_description,
)
from epson_driver.bringup.arguments import TABLE

FOLDER = ROOT / 'launch'
FILES = sorted(FOLDER.glob('*.launch.py'))
WANTED = {
    'fleet',
    'load_c3_a601s',
    'moveit_planning_execution',
    'robot_interface_download',
    'robot_interface_streaming',
    'robot_state_visualize',
    'several_robots',
    'simulation',
    'test_c3_a601s',
}
CLIENT_FILES = (
    'robot_interface',
    'robot_interface_streaming',
    'robot_interface_download',
    'robot_state_visualize',
    'moveit_planning_execution',
)


FIXED = ('robot_interface_streaming', 'robot_interface_download')
"""They set the interface; in the others it is the controller's usual one."""


def start(name: str, **arguments: str) -> Context:
    return launched(FOLDER / f'{name}.launch.py', **arguments)


def nodes(context: Context, executable: str) -> list[Any]:
    return [each for each in context.started if each.executable == executable]


def the_client(context: Context) -> Node:
    (node,) = nodes(context, 'client')
    assert isinstance(node, Node)
    return node


def test_the_launch_files_are_there() -> None:
    assert {path.name.split('.')[0] for path in FILES} >= WANTED
    assert not (FOLDER / '__init__.py').exists()  # it is a folder of data, not a package


@pytest.mark.parametrize('path', FILES, ids=lambda path: path.name)
def test_what_a_launch_file_names_exists(path: Path) -> None:
    assert list(faults(path, launched(path))) == []
    everything = {'use_sim_controller': 'true', 'launch_rviz': 'true', 'sim_motion': 'ptp'}
    if 'download' not in path.name:
        everything['ros2_control'] = 'true'
    declared = declared_names(description(path))
    given = {name: value for name, value in everything.items() if name in declared}
    assert list(faults(path, launched(path, **given))) == []


@pytest.mark.parametrize('path', FILES, ids=lambda path: path.name)
def test_an_argument_that_nobody_declares_is_refused(path: Path) -> None:
    with pytest.raises(LaunchError, match=r"does not declare \['robot_iq'\]"):
        launched(path, robot_iq='1')


def test_what_launch_files_import_is_a_dependency() -> None:
    assert dependencies() >= IMPORTS | {'xacro'}


OF_WINDOWS = ('joint_sliders', 'rviz', 'test_c3_a601s')
"""Launch files that show something, and do nothing else."""


@pytest.mark.parametrize(
    'name', sorted({path.name.split('.')[0] for path in FILES} - set(OF_WINDOWS))
)
def test_without_rviz_a_launch_file_needs_no_desktop(name: str) -> None:
    path = FOLDER / f'{name}.launch.py'
    given = {'launch_rviz': 'false'} if 'launch_rviz' in declared_names(description(path)) else {}
    needed = {each.package for each in launched(path, **given).started} - {'epson_driver'}
    planning = name == 'moveit_planning_execution'
    assert needed <= dependencies('epson_driver_moveit' if planning else 'epson_driver')


@pytest.mark.skipif(
    getattr(importlib.util.find_spec('launch'), 'origin', None) is None,
    reason='launch is not installed: only on a ROS machine',
)
@pytest.mark.parametrize('path', FILES, ids=lambda path: path.name)
def test_the_real_launch_reads_the_file(path: Path) -> None:
    real = runpy.run_path(str(path))['generate_launch_description']()
    names = {each.name for each in real.get_launch_arguments()}
    assert names >= declared_names(description(path))


# --- the driver ---------------------------------------------------------------------------------


@pytest.mark.parametrize('name', CLIENT_FILES)
def test_every_file_with_a_client_passes_its_arguments_on(name: str, tmp_path: Path) -> None:
    params = tmp_path / 'mine.yaml'
    params.write_text('/**:\n  ros__parameters:\n    state_timeout: 0.5\n')
    arguments = {
        'robot_ip': '192.168.0.1',
        'controller': 'rc700a',
        'motion_port': '12000',
        'state_port': '12002',
        'io_port': '0',
        'remote_port': '5001',
        'namespace': 'cell',
        'tf_prefix': 'left_',
        'params_file': str(params),
    }
    node = the_client(start(name, **arguments))
    interface = {'interface': name.split('_')[-1]} if name in FIXED else {}
    assert node.namespace == 'cell'
    assert node.files == [params]
    assert node.name == 'epson_driver'  # without it launch gives its parameters to any node
    assert node.parameters == {
        'robot_ip': '192.168.0.1',
        'controller': 'rc700a',
        **interface,
        'motion_port': 12000,
        'state_port': 12002,
        'io_port': 0,
        'remote_port': 5001,
        'joint_names': [f'left_joint_{number}' for number in range(1, 7)],
        'frame_id': 'left_base_link',
    }


@pytest.mark.parametrize('name', CLIENT_FILES)
def test_arguments_that_are_not_given_leave_the_clients_defaults(name: str) -> None:
    context = start(name)
    assert set(the_client(context).parameters) == ({'interface'} if name in FIXED else set())
    assert nodes(context, 'sim_controller') == []


def test_a_scara_has_four_joints_with_the_prefix() -> None:
    context = start('robot_interface', robot_model='gx4_c251s', tf_prefix='left_')
    names = [f'left_joint_{number}' for number in range(1, 5)]
    assert the_client(context).parameters['joint_names'] == names


@pytest.mark.parametrize(
    ('arguments', 'text'),
    [
        (
            {'motion_port': 'eleven'},
            "motion_port = 'eleven': must be a whole number from 0",
        ),
        ({'robot_model': 'c5'}, 'no robot model c5'),
        ({'use_sim_controller': 'yes'}, 'use_sim_controller = yes: not among'),
        ({'interface': 'both'}, 'interface = both: not among'),
        ({'params_file': '/no/such.yaml'}, 'params_file = /no/such.yaml: there is no such file'),
    ],
)
def test_a_wrong_argument_is_named(arguments: dict[str, str], text: str) -> None:
    with pytest.raises(
        (LaunchError, ValueError, FileNotFoundError, BringupError), match=re.escape(text)
    ):
        start('robot_interface', **arguments)


def test_a_simulation_meets_its_client() -> None:
    context = start('simulation', robot_ip='127.0.0.3', motion_port='12000', controller='rc700a')
    (controller,) = nodes(context, 'sim_controller')
    words = dict(zip(controller.command[::2], controller.command[1::2], strict=True))
    assert words == {
        '--robot': 'c3_a601s',
        '--motion': 'smooth',
        '--host': '127.0.0.3',
        '--controller': 'rc700a',
        '--motion-port': '12000',
        '--remote-port': '5000',
    }
    parameters = the_client(context).parameters
    assert (parameters['robot_ip'], parameters['controller']) == ('127.0.0.3', 'rc700a')
    assert (parameters['motion_port'], parameters['remote_port']) == (12000, 5000)


# --- what shows the robot -----------------------------------------------------------------------


@pytest.mark.parametrize('name', ['load_c3_a601s', 'robot_description'])
def test_the_description_is_published(name: str) -> None:
    (node,) = start(name, namespace='cell', tf_prefix='left_').started
    assert (node.executable, node.namespace) == ('robot_state_publisher', 'cell')
    assert '<joint name="left_joint_1"' in node.parameters['robot_description']


@pytest.mark.parametrize('name', ['test_c3_a601s', 'joint_sliders'])
def test_sliders_move_the_model(name: str) -> None:
    context = start(name, namespace='cell', tf_prefix='left_')
    kinds = ['robot_state_publisher', 'joint_state_publisher_gui', 'rviz2']
    assert [each.executable for each in context.started] == kinds
    assert {each.namespace for each in context.started} == {'cell'}
    without = start(name, launch_rviz='false')
    assert [each.executable for each in without.started] == kinds[:2]


@pytest.mark.parametrize('name', ['robot_state_visualize', 'joint_sliders', 'rviz'])
def test_rviz_shows_a_file_of_this_package_in_the_robots_frame(name: str) -> None:
    (node,) = nodes(start(name, tf_prefix='left_'), 'rviz2')
    words = dict(zip(node.command[::2], node.command[1::2], strict=True))
    assert words == {
        '-d': str(ROOT / 'config' / 'rviz' / 'robot.rviz'),
        '-f': 'left_base_link',
    }


def test_rviz_is_left_out_where_nobody_looks() -> None:
    assert nodes(start('robot_state_visualize', launch_rviz='false'), 'rviz2') == []
    assert nodes(start('moveit_planning_execution', launch_rviz='false'), 'rviz2') == []


# --- ros2_control -------------------------------------------------------------------------------


@pytest.mark.parametrize('name', ['robot_interface', 'simulation'])
def test_ros2_control_stands_in_front_of_the_driver(name: str) -> None:
    context = start(name, ros2_control='true', namespace='cell', tf_prefix='left_')
    started = [each.executable for each in context.started if each.executable != 'sim_controller']
    expected = ['client', 'robot_state_publisher', 'ros2_control_node', 'spawner', 'ros2']
    assert started == expected
    (first,) = nodes(context, 'ros2')  # the spawner follows it
    assert first.command[:3] == ['topic', 'echo', '--once']
    assert first.command[-2:] == ['/cell/joint_states', 'sensor_msgs/msg/JointState']
    (manager,) = nodes(context, 'ros2_control_node')
    assert manager.files == [ROOT / 'config' / 'ros2_control' / 'controllers.yaml']
    joints = [f'left_joint_{number}' for number in range(1, 7)]
    assert manager.parameters['joints'] == joints == the_client(context).parameters['joint_names']
    assert manager.name is None
    (spawner,) = nodes(context, 'spawner')
    assert spawner.command == ['joint_trajectory_controller']
    (publisher,) = nodes(context, 'robot_state_publisher')
    description = publisher.parameters['robot_description']
    assert '>/cell/epson_driver/joint_commands<' in description
    assert {each.namespace for each in (manager, spawner, publisher)} == {'cell'}


def test_ros2_control_is_off_unless_it_is_asked_for() -> None:
    context = start('robot_interface', description='true')
    assert [each.executable for each in context.started] == ['client', 'robot_state_publisher']
    (publisher,) = nodes(context, 'robot_state_publisher')
    assert 'ros2_control' not in publisher.parameters['robot_description']


def test_ros2_control_needs_a_driver_that_follows_streams() -> None:
    with pytest.raises(BringupError, match='interface = download'):
        start('robot_interface_download', ros2_control='true')


def test_moveit_executes_through_ros2_control_on_request() -> None:
    context = start('moveit_planning_execution', ros2_control='true', launch_rviz='false')
    (move_group,) = nodes(context, 'move_group')
    names = move_group.parameters['moveit_simple_controller_manager.controller_names']
    (spawner,) = nodes(context, 'spawner')
    assert names == spawner.command


# --- MoveIt, several robots ---------------------------------------------------------------------


def test_moveit_is_told_everything_with_the_prefix() -> None:
    context = start('moveit_planning_execution', namespace='cell', tf_prefix='left_')
    assert [each.executable for each in context.started] == [
        'client',
        'robot_state_publisher',
        'static_transform_publisher',
        'move_group',
        'rviz2',
    ]
    assert {each.namespace for each in context.started} == {'cell'}
    (move_group,) = nodes(context, 'move_group')
    assert move_group.name is None
    parameters = move_group.parameters
    names = [f'left_joint_{number}' for number in range(1, 7)]
    assert parameters['moveit_simple_controller_manager.epson_driver.joints'] == names
    assert the_client(context).parameters['joint_names'] == names
    for name in names:
        assert f'robot_description_planning.joint_limits.{name}.max_jerk' in parameters
        assert f'<joint name="{name}"' in parameters['robot_description']
        assert f'<joint name="{name}"' in parameters['robot_description_semantic']
    assert parameters['planning_pipelines'] == ['ompl', 'pilz_industrial_motion_planner']
    assert parameters['ompl.planning_plugins'] == ['ompl_interface/OMPLPlanner']
    (world,) = nodes(context, 'static_transform_publisher')
    assert world.command[-4:] == ['--frame-id', 'world', '--child-frame-id', 'left_base_link']
    (rviz,) = nodes(context, 'rviz2')
    assert rviz.parameters.items() <= parameters.items()
    assert 'robot_description_kinematics.manipulator.kinematics_solver' in rviz.parameters
    assert rviz.command[1] == str(ROOT / 'config' / 'rviz' / 'moveit.rviz')


def test_several_robots_share_nothing() -> None:
    context = start(
        'several_robots',
        namespaces='left, cell/right',
        robot_ips='192.168.0.1,192.168.0.2',
        remote_port='5000',
    )
    clients = nodes(context, 'client')
    assert [each.namespace for each in clients] == ['left', 'cell/right']
    assert [each.parameters['robot_ip'] for each in clients] == ['192.168.0.1', '192.168.0.2']
    first = [each.parameters['joint_names'][0] for each in clients]
    assert first == ['left_joint_1', 'cell_right_joint_1']
    publishers = nodes(context, 'robot_state_publisher')
    assert [each.namespace for each in publishers] == ['left', 'cell/right']
    for publisher, joint in zip(publishers, first, strict=True):
        assert f'<joint name="{joint}"' in publisher.parameters['robot_description']


@pytest.mark.parametrize(
    ('arguments', 'text'),
    [
        ({'namespaces': 'a,b,c'}, 'robot_ips has 2 addresses, but namespaces has 3 names'),
        ({'namespaces': 'a,a'}, 'namespaces = a,a: each must have a name, and no two the same'),
        ({'namespaces': 'a,'}, 'namespaces = a,: each must have a name, and no two the same'),
    ],
)
def test_lists_of_robots_that_do_not_fit_are_refused(arguments: dict[str, str], text: str) -> None:
    with pytest.raises(RuntimeError, match=f'^{re.escape(text)}$'):
        start('several_robots', **arguments)


FLEET_FILE = """
/**:
  ros__parameters: {controller: rc700a}
/cell:
  robot_1:
    epson_driver: {ros__parameters: {robot_ip: 192.168.0.1}}
/robot_2/epson_driver:
  ros__parameters: {robot_ip: 192.168.0.2, robot_model: gx4_c251s}
/robot_2/another_node:
  ros__parameters: {a: 1}
"""


@pytest.mark.parametrize(
    ('robots', 'expected'),
    [('', ['cell/robot_1', 'robot_2']), ('robot_2', ['robot_2'])],
)
def test_a_fleet_is_what_its_file_names(tmp_path: Path, robots: str, expected: list[str]) -> None:
    file = written(tmp_path, FLEET_FILE)
    context = start('fleet', params_file=file, robots=robots, use_sim_controller='true')
    clients = nodes(context, 'client')
    assert [each.namespace for each in clients] == expected
    assert all(each.files == [Path(file)] for each in clients)
    assert {each.on_exit for each in context.started} == {None}  # the others go on
    last = clients[-1].parameters
    assert last['joint_names'] == [f'robot_2_joint_{number}' for number in range(1, 5)]
    assert 'robot_ip' not in last  # the file has it
    command = nodes(context, 'sim_controller')[-1].command
    words = dict(zip(command[::2], command[1::2], strict=True))
    assert (words['--host'], words['--controller']) == ('192.168.0.2', 'rc700a')
    assert words['--robot'] == 'gx4_c251s'


@pytest.mark.parametrize(
    ('robots', 'file', 'text'),
    [
        ('robot_3', FLEET_FILE, 'robots: there is no robot_3 in'),
        ('', '/**: {ros__parameters: {a: 1}}', 'robots: there is no robot in'),
    ],
)
def test_a_robot_that_no_file_names_is_refused(
    tmp_path: Path, robots: str, file: str, text: str
) -> None:
    with pytest.raises(BringupError, match=text):
        start('fleet', params_file=written(tmp_path, file), robots=robots)
    with pytest.raises(BringupError, match='there is no such file'):
        start('fleet', params_file='/no/such.yaml')


@pytest.mark.parametrize('name', ['robot.rviz', 'moveit.rviz'])
def test_rviz_displays_are_relative_and_of_this_robot(name: str) -> None:
    text = (ROOT / 'config' / 'rviz' / name).read_text(encoding='utf-8')
    manager = yaml.safe_load(text)['Visualization Manager']
    assert f'"{manager["Global Options"]["Fixed Frame"]}"' in robot_description('c3_a601s')
    displays = {each['Name']: each for each in manager['Displays']}
    if name == 'robot.rviz':
        topics = [displays['Robot']['Description Topic']['Value']]
    else:
        planning = displays['MotionPlanning']
        assert planning['Planning Request']['Planning Group'] == 'manipulator'
        assert planning['Move Group Namespace'] == ''
        topics = [planning['Robot Description'], planning['Planning Scene Topic']]
    assert all(re.fullmatch(r'[a-z_]+', topic) for topic in topics)


# --- what only one of two places may say --------------------------------------------------------


def written(folder: Path, text: str) -> str:
    path = folder / 'mine.yaml'
    path.write_text(text)
    return str(path)


@pytest.mark.parametrize(
    'node', ['/**', 'cell/epson_driver', '/cell/epson_driver', '/*/epson_driver']
)
def test_what_a_params_file_says_holds_where_no_argument_is_given(
    node: str, tmp_path: Path
) -> None:
    file = written(
        tmp_path,
        f'{node}:\n  ros__parameters:\n    robot_model: c8_c901s\n    interface: download\n'
        '    motion_port: 12000\n    remote_port: 5001\n    robot_ip: 127.0.0.7\n',
    )
    given = {'params_file': file, 'namespace': 'cell', 'tf_prefix': 'a_'}
    context = start('simulation', **given)
    overriding = set(the_client(context).parameters)
    assert overriding == {'joint_names', 'frame_id'}
    (controller,) = nodes(context, 'sim_controller')
    words = dict(zip(controller.command[::2], controller.command[1::2], strict=True))
    assert words['--robot'] == 'c8_c901s'
    assert words['--motion-port'] == '12000'
    assert words['--remote-port'] == '5001'
    assert words['--host'] == '127.0.0.7'
    assert (
        the_client(start('simulation', robot_model='c4_a601s', **given)).parameters['robot_model']
        == 'c4_a601s'
    )
    for name in ('robot_state_visualize', 'moveit_planning_execution'):
        (publisher,) = nodes(start(name, **given), 'robot_state_publisher')
        assert '<robot name="c8_c901s"' in publisher.parameters['robot_description']


def test_a_params_file_for_other_nodes_stops_the_launch(tmp_path: Path) -> None:
    file = written(tmp_path, 'epson_drivr:\n  ros__parameters:\n    robot_ip: 127.0.0.7\n')
    with pytest.raises(
        BringupError, match=r'no ros__parameters for the node /epson_driver; .*drivr'
    ):
        start('robot_interface', params_file=file)


@pytest.mark.parametrize('name', CLIENT_FILES)
@pytest.mark.invariant(9)
def test_inv9_a_client_or_a_controller_that_ends_ends_the_launch(name: str) -> None:
    context = start(name, use_sim_controller='true')
    (controller,) = nodes(context, 'sim_controller')
    assert controller.on_exit.reason == 'the simulated controller ended'
    assert the_client(context).on_exit.reason == 'the client ended'


@pytest.mark.parametrize('name', CLIENT_FILES)
@pytest.mark.invariant(9)
def test_inv9_a_client_is_started_again_on_request(name: str) -> None:
    client = the_client(start(name, respawn='true'))
    assert client.respawn
    assert client.respawn_delay > 0.0
    assert client.on_exit is None
    assert not the_client(start(name)).respawn


@pytest.mark.invariant(9)
def test_inv9_a_move_group_or_a_controller_manager_that_ends_ends_the_launch() -> None:
    context = start('moveit_planning_execution', ros2_control='true', launch_rviz='false')
    (move_group,) = nodes(context, 'move_group')
    assert move_group.on_exit.reason == 'move_group ended'
    (manager,) = nodes(context, 'ros2_control_node')
    assert manager.on_exit.reason == 'the controller manager ended'


def test_a_misspelled_argument_is_named_with_the_nearest() -> None:
    path = FOLDER / 'robot_interface.launch.py'
    context = Context({'robotip': '1', 'robot_adress': '2', 'of_my_own_file': '3'})
    for entity in description(path).entities:
        entity.execute(context)
    assert context.logged == [
        f'WARNING: launch argument {name}: there is none of that name; did you mean robot_ip?'
        for name in ('robotip', 'robot_adress')
    ]


@pytest.mark.parametrize('name', ['simulation', 'several_robots'])
def test_the_panel_is_started_on_request_and_finds_every_robot(name: str) -> None:
    assert not nodes(start(name), 'panel')
    (panel,) = nodes(start(name, panel='true'), 'panel')
    assert panel.package == 'epson_driver'
    assert panel.namespace == ''
    with pytest.raises(LaunchError, match='panel'):
        start(name, panel='yes')


def test_the_place_of_the_arm_is_published_on_request() -> None:
    def place(name: str, **given: str) -> list[list[str]]:
        return [each.command for each in nodes(start(name, **given), 'static_transform_publisher')]

    given = {'parent': 'floor', 'origin_xyz': '1 0 0.5', 'origin_rpy': '0 0 1.57'}
    pose = ['--x', '1', '--y', '0', '--z', '0.5', '--roll', '0', '--pitch', '0', '--yaw', '1.57']
    pose += ['--frame-id', 'floor']
    for name in ('load_c3_a601s', 'robot_state_visualize', 'moveit_planning_execution'):
        (command,) = place(name, tf_prefix='a_', **given)
        assert command == [*pose, '--child-frame-id', 'a_base_link']
    assert place('robot_interface', **given) == []
    assert len(place('robot_interface', description='true', **given)) == 1
    assert place('robot_state_visualize') == []
    (command,) = place('moveit_planning_execution')
    assert command[command.index('--frame-id') + 1] == 'world'
    assert 'parent_frame="floor"' in semantic_description('c3_a601s', '', 'floor')
    with pytest.raises(BringupError, match="origin_xyz = '1 2': must be three numbers"):
        start('load_c3_a601s', parent='floor', origin_xyz='1 2')


def test_simulated_time_reaches_every_node() -> None:
    for path in FILES:
        if 'use_sim_time' in declared_names(description(path)):
            for each in launched(path, use_sim_time='true').started:
                if isinstance(each, Node) and each.package != 'joint_state_publisher_gui':
                    assert each.parameters['use_sim_time'] is True, (path.name, each.executable)


@pytest.mark.parametrize('path', FILES, ids=lambda path: path.name)
def test_what_shows_the_robot_takes_another_display(path: Path) -> None:
    names = declared_names(description(path))
    assert ('rviz_config' in names) == ('launch_rviz' in names or path.name.startswith('rviz'))
    if 'rviz_config' in names:
        (rviz,) = nodes(launched(path, rviz_config='/mine.rviz'), 'rviz2')
        assert rviz.command[1] == '/mine.rviz'


@pytest.mark.parametrize('path', FILES, ids=lambda path: path.name)
def test_what_a_file_fixes_is_not_listed_as_free(path: Path) -> None:
    """`ros2 launch FILE -s` lists what includes declare, unless a function makes them."""
    free = declared_names(description(path))
    for each in description(path).entities:
        if isinstance(each, IncludeLaunchDescription):
            assert declared_names(description(each.path)) <= free


def test_each_of_several_robots_has_its_own(tmp_path: Path) -> None:
    files = []
    for number in (1, 2):
        (tmp_path / f'{number}.yaml').write_text(
            f'/**:\n  ros__parameters:\n    state_timeout: {number}.0\n'
        )
        files.append(str(tmp_path / f'{number}.yaml'))
    context = start(
        'several_robots',
        robot_model='c4_a601s,c8_c901s',
        motion_port='11000,12000',
        params_file=','.join(files),
        controller='rc700a',
    )
    first, second = nodes(context, 'client')
    assert (first.parameters['robot_model'], first.parameters['motion_port']) == (
        'c4_a601s',
        11000,
    )
    assert (second.parameters['robot_model'], second.parameters['motion_port']) == (
        'c8_c901s',
        12000,
    )
    assert [str(each.files[0]) for each in (first, second)] == files
    assert {each.parameters['controller'] for each in (first, second)} == {'rc700a'}
    with pytest.raises(BringupError, match='motion_port has 3 values, but namespaces has 2 names'):
        start('several_robots', motion_port='1,2,3')


# --- docs ---------------------------------------------------------------------------------------


def words(text: str) -> set[str]:
    return set(re.findall(r'`(\w+)`', text))


@pytest.mark.parametrize('page', ['README.md', 'docs/robot.md', 'docs/migration.md'])
def test_launch_files_that_the_docs_name_exist(page: str) -> None:
    text = (ROOT / page).read_text(encoding='utf-8')
    named = set(re.findall(r'\w+\.launch\.py', text)) - {'NAME.launch.py'}  # a placeholder
    assert named <= {path.name for path in FILES}


@pytest.mark.parametrize('path', FILES, ids=lambda path: path.name)
def test_the_docs_have_the_arguments_of_every_launch_file(path: Path) -> None:
    text = (ROOT / 'docs' / 'robot.md').read_text(encoding='utf-8')
    item = rf'^\* `{re.escape(path.name)}` \(.*?\): (.*)$'
    (cells,) = re.findall(item, unwrapped(text), re.MULTILINE)
    own = words(cells)
    if "the driver's but" in cells:
        own ^= set(INTERFACE)
    elif "the driver's" in cells:
        own |= set(INTERFACE)
    if 'place' in cells:
        own |= set(DESCRIPTION)
    assert own == declared_names(description(path))


def test_the_docs_describe_the_drivers_arguments() -> None:
    text = (ROOT / 'docs' / 'robot.md').read_text(encoding='utf-8')
    _, table = text.split("The driver's arguments:")
    rows = re.findall(r'^\* (`.*?) \(', table, re.MULTILINE)
    assert words(' '.join(rows)) == {*INTERFACE, *DESCRIPTION, 'description'}


def test_every_argument_of_the_table_is_one_of_a_file() -> None:
    used = set().union(*(declared_names(description(path)) for path in FILES))
    assert used == {row.name for row in TABLE}
