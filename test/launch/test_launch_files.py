# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Every launch file: its references exist, and it starts the documented processes."""

import re
import runpy
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from xml.etree import ElementTree

import pytest
from support.launch_files import FILES, declared, described, launched
from support.pages import unwrapped

from epson_driver.bringup import DESCRIPTION, INTERFACE, BringupError
from epson_driver.setup.table import TABLE

ROOT = Path(__file__).parents[2]
FIXED = ('robot_interface_streaming', 'robot_interface_download')
"""Files that set the interface. The others use the controller's default."""

CLIENT_FILES = (
    *('robot_interface', *FIXED),
    *('robot_state_visualize', 'moveit_planning_execution'),
)
EACH_FILE = pytest.mark.parametrize('path', FILES, ids=lambda path: path.name)
LEFT = [f'left_joint_{number}' for number in range(1, 7)]


def nodes(started: list[Any], executable: str) -> list[Any]:
    return [item for item in started if getattr(item, 'executable', '') == executable]


def the_client(started: list[Any]) -> Any:
    (node,) = nodes(started, 'client')
    return node


def ends_the_launch(node: Any, code: int = -9) -> str:
    """Return the reason with which the launch ends when this process ends with an exit code."""
    running, ending = (SimpleNamespace(is_shutdown=ended) for ended in (False, True))
    assert node.on_exit(SimpleNamespace(returncode=code), ending) == []
    with pytest.raises(RuntimeError, match=f'ended with exit code {code}') as failure:
        node.on_exit(SimpleNamespace(returncode=code), running)
    return str(failure.value)


def options(node: Any) -> dict[str, str]:
    return dict(zip(node.arguments[::2], node.arguments[1::2], strict=True))


@EACH_FILE
def test_references_of_a_launch_file_exist(path: Path) -> None:
    for item in described(path):
        if item.kind == 'DeclareLaunchArgument':
            assert item.description.endswith('.')
    wanted = {'use_sim_controller': 'true', 'sim_motion': 'ptp', 'use_sim_time': 'true'}
    if 'download' not in path.name:
        wanted['ros2_control'] = 'true'
    given = {name: value for name, value in wanted.items() if name in declared(path)}
    manifests = [ROOT / 'package.xml', *ROOT.glob('variants/*/package.xml')]
    depends = {
        item.text for file in manifests for item in ElementTree.parse(file).iter('exec_depend')
    }
    rows = {row.name: row for row in TABLE}
    for item in [*launched(path), *launched(path, **given)]:
        if item.package != 'epson_driver':
            assert item.package in depends
            continue
        assert (ROOT / 'scripts' / item.executable).is_symlink()
        if item.executable == 'client':
            for name, value in item.values.items():
                assert name == 'use_sim_time' or type(value) is type(rows[name].default), name


@EACH_FILE
def test_ros_launch_executes_the_file_without_an_error(path: Path) -> None:
    pytest.importorskip('launch_ros', reason='launch is not installed: a ROS machine has it')
    context = pytest.importorskip('launch').LaunchContext()
    for entity in runpy.run_path(str(path))['generate_launch_description']().entities:
        entity.visit(context)


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
    ('simulation', {}, 'sim_controller client'),
    ('simulation', {'panel': 'true'}, 'sim_controller client panel'),
    (
        'robot_interface',
        {'ros2_control': 'true'},
        'client robot_state_publisher ros2_control_node spawner ros2',
    ),
    (
        'moveit_planning_execution',
        {},
        'client robot_state_publisher static_transform_publisher move_group rviz2',
    ),
    ('several_robots', {'panel': 'true'}, 'client robot_state_publisher ' * 2 + 'panel'),
    ('smooth_goals', {}, 'smooth_goals'),
)


@pytest.mark.parametrize(('name', 'given', 'executables'), STARTED)
def test_launch_file_starts_its_executables(
    name: str, given: dict[str, str], executables: str
) -> None:
    started = launched(name, **given)
    assert [item.executable for item in started] == executables.split()


@pytest.mark.parametrize('name', CLIENT_FILES)
def test_arguments_are_passed_to_the_client(name: str, tmp_path: Path) -> None:
    interface = {'interface': name.split('_')[-1]} if name in FIXED else {}
    assert the_client(launched(name)).values == interface
    params = tmp_path / 'mine.yaml'
    params.write_text('/**:\n  ros__parameters:\n    state_timeout: 0.5\n')
    words = {'robot_ip': '192.168.0.1', 'controller': 'rc700a'}
    ports = {'motion_port': 12000, 'state_port': 12002, 'io_port': 0, 'remote_port': 5001}
    arguments = words | {item: str(port) for item, port in ports.items()}
    place = {'namespace': 'cell', 'tf_prefix': 'left_', 'params_file': str(params)}
    node = the_client(launched(name, **arguments, **place))
    assert (node.namespace, node.files) == ('cell', [str(params)])
    assert node.name == 'epson_driver'  # otherwise launch gives its parameters to any node
    names = {'joint_names': LEFT, 'frame_id': 'left_base_link'}
    assert node.values == {**words, **interface, **ports, **names}


@pytest.mark.parametrize(
    ('arguments', 'text'),
    [
        ({'motion_port': 'eleven'}, "motion_port = 'eleven': must be a whole number from 0"),
        ({'robot_model': 'c5'}, 'no robot model c5'),
        ({'params_file': '/no/such.yaml'}, 'params_file = /no/such.yaml: no such file'),
        ({'ros2_control': 'true', 'interface': 'download'}, 'interface = download'),
        ({'description': 'true', 'parent': 'x', 'origin_xyz': '1 2'}, 'must be three numbers'),
    ],
)
def test_invalid_argument_of_a_launch_file_is_named(arguments: dict[str, str], text: str) -> None:
    with pytest.raises((ValueError, BringupError), match=re.escape(text)):
        launched('robot_interface', **arguments)


def test_misspelled_argument_suggests_the_nearest() -> None:
    messages = launched('robot_interface', robotip='1', of_my_own_file='3')
    (warning,) = [message.msg for message in messages if message.kind == 'LogInfo']
    assert 'launch argument robotip: it is unknown, did you mean robot_ip?' in warning


def test_simulation_and_client_have_equal_addresses() -> None:
    started = launched('simulation', robot_ip='127.0.0.3', motion_port='12000', remote_port='5001')
    words = options(nodes(started, 'sim_controller')[0])
    assert (words['--host'], words['--motion-port'], words['--remote-port']) == (
        *('127.0.0.3', '12000', '5001'),
    )
    client = the_client(started).values
    assert (client['robot_ip'], client['motion_port'], client['remote_port']) == (
        *('127.0.0.3', 12000, 5001),
    )


def test_rviz_and_static_transform_have_the_prefix() -> None:
    given = {'parent': 'floor', 'origin_xyz': '1 0 0.5', 'origin_rpy': '0 0 1.57'}
    started = launched('robot_state_visualize', tf_prefix='a_', rviz_config='/mine.rviz', **given)
    assert options(nodes(started, 'rviz2')[0]) == {'-d': '/mine.rviz', '-f': 'a_base_link'}
    (place,) = nodes(started, 'static_transform_publisher')
    pose = {'--x': '1', '--z': '0.5', '--yaw': '1.57'}
    frames = {'--frame-id': 'floor', '--child-frame-id': 'a_base_link'}
    assert options(place).items() >= (pose | frames).items()


def test_ros2_control_option_starts_a_controller_manager() -> None:
    started = launched('robot_interface', ros2_control='true', namespace='cell', tf_prefix='left_')
    (manager,) = nodes(started, 'ros2_control_node')
    assert manager.name is None  # a name would hide its parameters from its controllers
    assert manager.values['joints'] == LEFT == the_client(started).values['joint_names']
    (publisher,) = nodes(started, 'robot_state_publisher')
    assert '>/cell/epson_driver/joint_commands<' in publisher.values['robot_description']
    assert {item.namespace for item in started if item.kind == 'Node'} == {'cell'}
    (first,) = nodes(started, 'ros2')  # before the spawner
    assert '/cell/joint_states' in first.arguments


def test_moveit_parameters_have_the_prefix() -> None:
    started = launched(
        'moveit_planning_execution', namespace='cell', tf_prefix='left_', ros2_control='true'
    )
    assert {item.namespace for item in started if item.kind == 'Node'} == {'cell'}
    (move_group,) = nodes(started, 'move_group')
    assert move_group.name is None
    values = move_group.values
    for name in LEFT:
        assert f'robot_description_planning.joint_limits.{name}.max_jerk' in values
        assert f'<joint name="{name}"' in values['robot_description']
        assert f'<joint name="{name}"' in values['robot_description_semantic']
    assert values['planning_pipelines'] == ['ompl', 'pilz_industrial_motion_planner']
    (spawner,) = nodes(started, 'spawner')
    assert values['moveit_simple_controller_manager.controller_names'] == spawner.arguments
    (rviz,) = nodes(started, 'rviz2')
    assert rviz.values.items() <= values.items()


def test_each_of_several_robots_has_separate_nodes() -> None:
    given = {'robot_model': 'c4_a601s,c8_c901s', 'controller': 'rc700a'}
    lists = {'namespaces': 'left, cell/right', 'robot_ips': '192.168.0.1,192.168.0.2'}
    started = launched('several_robots', **given, **lists)
    clients = nodes(started, 'client')
    assert [client.namespace for client in clients] == ['left', 'cell/right']
    assert [client.values['robot_ip'] for client in clients] == lists['robot_ips'].split(',')
    assert [client.values['robot_model'] for client in clients] == given['robot_model'].split(',')
    assert {client.values['controller'] for client in clients} == {'rc700a'}
    joints = [client.values['joint_names'][0] for client in clients]
    assert joints == ['left_joint_1', 'cell_right_joint_1']
    for publisher, joint in zip(nodes(started, 'robot_state_publisher'), joints, strict=True):
        assert f'<joint name="{joint}"' in publisher.values['robot_description']
    with pytest.raises(BringupError, match='motion_port has 3 values, but namespaces has 2 names'):
        launched('several_robots', motion_port='1,2,3')
    with pytest.raises(RuntimeError, match='must be unique, non-empty names'):
        launched('several_robots', namespaces='a,a')


FLEET_FILE = """
/**:
  ros__parameters: {controller: rc700a}
/cell:
  robot_1:
    epson_driver: {ros__parameters: {robot_ip: 192.168.0.1}}
/robot_2/epson_driver:
  ros__parameters: {robot_ip: 192.168.0.2, robot_model: gx4_c251s}
"""


def test_fleet_starts_the_robots_of_its_file(tmp_path: Path) -> None:
    file = tmp_path / 'mine.yaml'
    file.write_text(FLEET_FILE)
    started = launched('fleet', params_file=str(file), use_sim_controller='true')
    clients = nodes(started, 'client')
    assert [client.namespace for client in clients] == ['cell/robot_1', 'robot_2']
    assert {item.on_exit for item in started} == {None}  # the others continue
    assert len(clients[-1].values['joint_names']) == 4
    words = options(nodes(started, 'sim_controller')[-1])
    assert (words['--host'], words['--robot']) == ('192.168.0.2', 'gx4_c251s')
    (only,) = nodes(launched('fleet', params_file=str(file), robots='robot_2'), 'client')
    assert only.namespace == 'robot_2'
    with pytest.raises(BringupError, match='robots: no robot_3 in'):
        launched('fleet', params_file=str(file), robots='robot_3')


@pytest.mark.parametrize('node', ['/**', 'cell/epson_driver', '/*/epson_driver'])
def test_arguments_override_the_params_file(node: str, tmp_path: Path) -> None:
    file = tmp_path / 'mine.yaml'
    file.write_text(
        f'{node}:\n  ros__parameters: {{robot_model: c8_c901s, motion_port: 12000, '
        'remote_port: 5001, robot_ip: 127.0.0.7}\n'
    )
    given = {'params_file': str(file), 'namespace': 'cell', 'tf_prefix': 'a_'}
    started = launched('simulation', description='true', **given)
    assert the_client(started).values.keys() == {'joint_names', 'frame_id'}
    words = options(nodes(started, 'sim_controller')[0])
    assert (words['--robot'], words['--motion-port']) == ('c8_c901s', '12000')
    (publisher,) = nodes(started, 'robot_state_publisher')
    assert '<robot name="c8_c901s"' in publisher.values['robot_description']
    started = launched('simulation', robot_model='c4_a601s', **given)
    assert the_client(started).values['robot_model'] == 'c4_a601s'
    file.write_text('epson_drivr:\n  ros__parameters: {robot_ip: 127.0.0.7}\n')
    with pytest.raises(BringupError, match=r'the node /cell/epson_driver, .*drivr'):
        launched('simulation', **given)


@pytest.mark.parametrize('name', CLIENT_FILES)
@pytest.mark.invariant(9)
def test_inv9_end_of_client_or_controller_ends_the_launch(name: str) -> None:
    started = launched(name, use_sim_controller='true')
    (controller,) = nodes(started, 'sim_controller')
    assert 'the simulated controller' in ends_the_launch(controller)
    client = the_client(started)
    assert 'the client' in ends_the_launch(client)
    assert not client.respawn
    again = the_client(launched(name, respawn='true'))
    assert (again.respawn, again.on_exit) == (True, None)
    assert again.respawn_delay > 0.0


@pytest.mark.invariant(9)
def test_inv9_end_of_move_group_ends_the_launch() -> None:
    started = launched('moveit_planning_execution', ros2_control='true')
    for executable, name in (
        ('move_group', 'move_group'),
        ('ros2_control_node', 'the controller manager'),
    ):
        (node,) = nodes(started, executable)
        assert name in ends_the_launch(node)


def words(text: str) -> set[str]:
    return set(re.findall(r'`(\w+)`', text))


@EACH_FILE
def test_docs_list_the_arguments_of_every_launch_file(path: Path) -> None:
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
    assert own == declared(path)
    _, table = text.split("The driver's arguments:")
    rows = re.findall(r'^\* (`.*?) \(', table, re.MULTILINE)
    assert words(' '.join(rows)) == {*INTERFACE, *DESCRIPTION, 'description'}
