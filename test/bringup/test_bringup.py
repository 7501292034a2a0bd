# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The functions behind the launch files: arguments, robot descriptions, command lines."""

import os
import re
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from support.examples import one_in

from epson_driver.bringup import (
    EACH,
    INTERFACE,
    BringupError,
    client_parameters,
    controller_arguments,
    effective,
    end_launch,
    fleet_robots,
    launch_arguments,
    misspelled_arguments,
    pose_arguments,
    robot_description,
    several_robots,
)
from epson_driver.processes import processes

DEFAULTS = {
    argument['name']: argument['default_value'] for argument in launch_arguments(*INTERFACE)
}
VALUES = DEFAULTS | {'interface': 'streaming'}


def test_launch_argument_has_name_default_and_description() -> None:
    (argument,) = launch_arguments('sim_motion')
    assert argument == {
        'name': 'sim_motion',
        'default_value': 'smooth',
        'description': argument['description'],
        'choices': ['smooth', 'ptp'],
    }
    (argument,) = launch_arguments('robot_ip', robot_ip='192.168.0.1')
    assert argument['default_value'] == '192.168.0.1'
    assert 'choices' not in argument
    with pytest.raises(KeyError, match='robot_iq'):
        launch_arguments('robot_iq')


def test_prefix_is_added_to_every_urdf_name() -> None:
    prefixed = robot_description('c3_a601s', 'left_')
    result = re.findall(r'<(?:link|joint|parent|child) (?:name|link)="([^"]+)"', prefixed)
    assert len(result) > 20
    assert all(name.startswith('left_') for name in result)
    assert {'left_tool0', 'left_joint_6', 'left_base_link'} <= set(result)


def test_missing_xacro_error_has_the_install_command(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, 'xacro', None)
    monkeypatch.setenv('XDG_CACHE_HOME', '/nowhere')
    with pytest.raises(BringupError, match=r'^xacro is missing: sudo apt install ros-jazzy-xacro'):
        robot_description('c3_a601s')


@pytest.mark.parametrize(
    ('arguments', 'text'),
    [
        ({'motion_port': 'eleven'}, "motion_port = 'eleven': must be a whole number from 0"),
        ({'robot_model': 'c5'}, 'no robot model c5'),
        ({'params_file': '/no/such.yaml'}, 'params_file = /no/such.yaml: no such file'),
    ],
)
def test_invalid_argument_of_a_launch_file_is_named(arguments: dict[str, str], text: str) -> None:
    with pytest.raises((ValueError, BringupError), match=re.escape(text)):
        client_parameters(VALUES | arguments)


def test_misspelled_argument_suggests_the_nearest() -> None:
    (warning,) = misspelled_arguments(['robotip', 'of_my_own_file', 'robot_ip'])
    assert warning == 'launch argument robotip: it is unknown, did you mean robot_ip?'


def test_pose_of_the_base_has_three_numbers_each() -> None:
    words = pose_arguments('floor', '1 0 0.5', '0 0 1.57', 'a_')
    options = dict(zip(words[::2], words[1::2], strict=True))
    assert options.items() >= {'--x': '1', '--z': '0.5', '--yaw': '1.57'}.items()
    assert (options['--frame-id'], options['--child-frame-id']) == ('floor', 'a_base_link')
    with pytest.raises(BringupError, match='must be three numbers'):
        pose_arguments('floor', '1 2', '0 0 0')


@pytest.mark.invariant(9)
def test_inv9_end_of_a_process_ends_the_launch_unless_it_ends_already() -> None:
    running, ending = (SimpleNamespace(is_shutdown=ended) for ended in (False, True))
    failed = SimpleNamespace(returncode=-9)
    assert end_launch('the client')(failed, ending) == []
    with pytest.raises(RuntimeError, match='the client ended with exit code -9'):
        end_launch('the client')(failed, running)


def test_each_of_several_robots_has_its_arguments() -> None:
    given = {'namespaces': 'left, cell/right', 'robot_ips': '192.168.0.1,192.168.0.2'}
    values = dict.fromkeys(EACH, '') | given
    left, right = several_robots(values | {'robot_model': 'c4_a601s,c8_c901s'})
    assert (left['namespace'], right['namespace']) == ('left', 'cell/right')
    assert (left['tf_prefix'], right['tf_prefix']) == ('left_', 'cell_right_')
    assert [robot['robot_ip'] for robot in (left, right)] == given['robot_ips'].split(',')
    assert [robot['robot_model'] for robot in (left, right)] == ['c4_a601s', 'c8_c901s']
    with pytest.raises(BringupError, match='motion_port has 3 values, but namespaces has 2 names'):
        several_robots(values | {'motion_port': '1,2,3'})
    with pytest.raises(BringupError, match='must be unique, non-empty names'):
        several_robots(values | {'namespaces': 'a,a'})


FLEET_FILE = """
/**:
  ros__parameters: {controller: spel}
/cell:
  robot_1:
    epson_driver: {ros__parameters: {robot_ip: 192.168.0.1}}
/robot_2/epson_driver:
  ros__parameters: {robot_ip: 192.168.0.2, robot_model: gx4_c251s}
"""


def test_fleet_has_the_robots_of_its_file(tmp_path: Path) -> None:
    file = tmp_path / 'mine.yaml'
    file.write_text(FLEET_FILE)
    values = {'params_file': str(file), 'robots': ''}
    _, second = robots = fleet_robots(values)
    assert [robot['namespace'] for robot in robots] == ['cell/robot_1', 'robot_2']
    resolved = effective(DEFAULTS | second)
    assert (resolved['robot_ip'], resolved['robot_model']) == ('192.168.0.2', 'gx4_c251s')
    assert resolved['controller'] == 'spel'
    (only,) = fleet_robots(values | {'robots': 'robot_2'})
    assert only == second
    with pytest.raises(BringupError, match='robots: no robot_3 in'):
        fleet_robots(values | {'robots': 'robot_3'})


@pytest.mark.parametrize('node', ['/**', 'cell/epson_driver', '/*/epson_driver'])
def test_arguments_override_the_params_file(node: str, tmp_path: Path) -> None:
    file = tmp_path / 'mine.yaml'
    file.write_text(
        f'{node}:\n  ros__parameters: {{robot_model: c8_c901s, motion_port: 12000, '
        'remote_port: 5001, robot_ip: 127.0.0.7}\n'
    )
    values = VALUES | {'params_file': str(file), 'namespace': 'cell', 'use_sim_controller': 'true'}
    assert client_parameters(values) == {'interface': 'streaming'}  # the client reads the file
    words = controller_arguments(values)
    options = dict(zip(words[::2], words[1::2], strict=True))
    assert (options['--robot'], options['--motion-port']) == ('c8_c901s', '12000')
    assert effective(values | {'robot_model': 'c4_a601s'})['robot_model'] == 'c4_a601s'
    file.write_text('epson_drivr:\n  ros__parameters: {robot_ip: 127.0.0.7}\n')
    with pytest.raises(BringupError, match=r'the node /cell/epson_driver, .*drivr'):
        effective(values)


@pytest.mark.parametrize('remote_port', ['', '5000'])
def test_client_and_sim_controller_have_one_remote_port(remote_port: str) -> None:
    values = VALUES | {'use_sim_controller': 'true', 'remote_port': remote_port}
    assert client_parameters(values)['remote_port'] == 5000
    words = controller_arguments(values)
    assert words[words.index('--remote-port') + 1] == '5000'


@pytest.mark.parametrize('controller', one_in(2, ['spel', 'remote']))
def test_sim_controller_accepts_its_command_line(tmp_path: Path, controller: str) -> None:
    values = VALUES | {
        'robot_ip': '127.0.0.1',
        'controller': controller,
        'sim_motion': 'ptp',
        'motion_port': '0',
        'state_port': '0',
        'io_port': '0',
        'remote_port': '0',
    }
    process = processes.Process(
        'sim_controller', controller_arguments(values), tmp_path / 'log', dict(os.environ)
    )
    with processes.ended_at_exit(process):
        assert process.ports().motion > 0
    assert process.returncode == 0
