# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The functions behind the launch files: arguments, robot descriptions, command lines."""

import os
import re
import sys
from pathlib import Path

import pytest
from support.examples import one_in

from epson_driver.bringup import (
    INTERFACE,
    BringupError,
    client_parameters,
    controller_arguments,
    launch_arguments,
    robot_description,
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


@pytest.mark.parametrize('remote_port', ['', '5000'])
def test_client_and_sim_controller_have_one_remote_port(remote_port: str) -> None:
    values = VALUES | {'use_sim_controller': 'true', 'remote_port': remote_port}
    assert client_parameters(values)['remote_port'] == 5000
    words = controller_arguments(values)
    assert words[words.index('--remote-port') + 1] == '5000'


@pytest.mark.parametrize('controller', one_in(2, ['spel', 'rc700a']))
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
