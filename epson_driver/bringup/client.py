# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Conversion of launch arguments to parameters of the client and of the simulated controller."""

import re
from collections.abc import Mapping
from typing import Any

from epson_driver.bringup.params_file import file_parameters
from epson_driver.inputs import HOST, JOINT_NAMES, count
from epson_driver.profiles import load_controller_profile
from epson_driver.robots import load_robot_model
from epson_driver.setup.robot_file import robot_settings

INTERFACE = (
    'robot',
    'robot_ip',
    'robot_model',
    'controller',
    'namespace',
    'tf_prefix',
    'motion_port',
    'state_port',
    'io_port',
    'remote_port',
    'params_file',
    'use_sim_controller',
    'sim_motion',
    'use_sim_time',
    'ros2_control',
    'respawn',
)
"""Arguments of every launch file that starts a client."""

DESCRIPTION = ('parent', 'origin_xyz', 'origin_rpy')
"""Arguments of every launch file that publishes the robot's description."""

FORWARDED = ('robot_ip', 'robot_model', 'controller', 'interface', 'password_variable')
"""Launch arguments that are passed to the client as parameters of the same name, unless empty. The
password variable can only come from a robot's file."""

DEFAULT_MODEL = 'c3_a601s'

PORT = count(0, 65_535)
_DIGITS = re.compile(r'[0-9]{1,5}', re.ASCII)

PORTS = ('motion_port', 'state_port', 'io_port', 'remote_port')
SIM_REMOTE_PORT = '5000'
"""Default Remote Ethernet port of the simulated controller, for profiles without such a port."""


def client_parameters(values: Mapping[str, str]) -> dict[str, Any]:
    """Return the client's parameters that the launch arguments set."""
    values = _with_robot(values)
    prefix = values['tf_prefix']
    resolved = effective(values)
    joints = load_robot_model(resolved['robot_model']).joint_names
    parameters: dict[str, Any] = {}
    if values['use_sim_time'] == 'true':
        parameters['use_sim_time'] = True
    if prefix:  # else the names of the model apply
        names = [prefix + name for name in joints]
        parameters['joint_names'] = list(JOINT_NAMES.checked(names, _where('tf_prefix')))
        parameters['frame_id'] = prefix + 'base_link'
    if values['robot_ip']:
        HOST.checked(values['robot_ip'], _where('robot_ip'))
    parameters |= {name: values[name] for name in FORWARDED if values.get(name)}
    ports = _ports(values, resolved).items()
    return parameters | {name: _port(name, port) for name, port in ports if port}


def _with_robot(values: Mapping[str, str]) -> dict[str, str]:
    own = robot_settings(values['robot']) if values.get('robot') else {}
    return dict(values) | {name: str(own[name]) for name in own if not values.get(name)}


def effective(values: Mapping[str, str]) -> dict[str, str]:
    """Return the launch arguments, with values from params_file for empty arguments."""
    values = _with_robot(values)
    path = values['params_file']
    file_values = file_parameters(path, values['namespace']) if path else {}
    names = (*FORWARDED, *PORTS)
    defaults = {
        name: str(file_values[name])
        for name in names
        if not values.get(name) and name in file_values
    }
    model = defaults.get('robot_model') or values['robot_model'] or DEFAULT_MODEL
    return dict(values) | defaults | {'robot_model': model}


def controller_arguments(values: Mapping[str, str]) -> list[str]:
    """Return the command-line arguments of the simulated controller for a client."""
    values = effective(values)
    arguments = ['--robot', values['robot_model']]
    controller = values['controller']
    if not (controller and load_controller_profile(controller).spel.project):
        arguments += ['--motion', values['sim_motion']]
    if values['robot_ip']:
        arguments += ['--host', values['robot_ip']]
    if controller:
        arguments += ['--controller', controller]
    if variable := values.get('password_variable'):
        arguments += ['--password-variable', variable]
    for name, port in _ports(values, values).items():
        if port:
            arguments += ['--' + name.replace('_', '-'), str(_port(name, port))]
    return arguments


def _ports(values: Mapping[str, str], resolved: Mapping[str, str]) -> dict[str, str]:
    ports = {name: values[name] for name in PORTS}
    if values['use_sim_controller'] == 'true' and not resolved['remote_port']:
        ports['remote_port'] = SIM_REMOTE_PORT
    return ports


def _port(name: str, text: str) -> int:
    port: int = PORT.checked(int(text) if _DIGITS.fullmatch(text) else text, _where(name))
    return port


def _where(name: str) -> str:
    return f'launch argument {name}'
