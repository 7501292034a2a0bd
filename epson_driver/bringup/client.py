# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""From launch arguments to the client's parameters and the simulated controller's command line."""

import re
from collections.abc import Mapping
from typing import Any

from epson_driver.bringup.params_file import file_parameters
from epson_driver.inputs import HOST, JOINT_NAMES, count
from epson_driver.profiles import load_controller_profile
from epson_driver.robots import load_robot_model

INTERFACE = (
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
"""The arguments of every launch file that starts a client."""

DESCRIPTION = ('parent', 'origin_xyz', 'origin_rpy')
"""The arguments of every launch file with the robot's description."""

GIVEN = ('robot_ip', 'robot_model', 'controller', 'interface')
"""Arguments passed to the client as parameters, if they are not empty."""

DEFAULT_MODEL = 'c3_a601s'

PORT = count(0, 65_535)
_DIGITS = re.compile(r'[0-9]{1,5}', re.ASCII)

PORTS = ('motion_port', 'state_port', 'io_port', 'remote_port')
SIM_REMOTE_PORT = '5000'
"""The simulated controller's Remote Ethernet port, even as an RC620, which has none."""


def client_parameters(values: Mapping[str, str]) -> dict[str, Any]:
    """Return the client's parameters that follow from non-empty launch arguments.

    The values of params_file apply to the others. Raises FileNotFoundError or InputError for a
    model that cannot be read, InputError for an invalid address, prefix or port, and BringupError
    for a missing params_file.
    """
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
    parameters |= {name: values[name] for name in GIVEN if values[name]}
    ports = _ports(values, resolved)
    given = {name: port for name, port in ports.items() if port}
    return parameters | {name: _port(name, port) for name, port in given.items()}


def effective(values: Mapping[str, str]) -> dict[str, str]:
    """Return launch arguments, with the client's own values for the empty ones.

    The client's values are read from params_file, with the model's default. Raises the exceptions
    of `file_parameters`.
    """
    path = values['params_file']
    message = file_parameters(path, values['namespace']) if path else {}
    names = (*GIVEN, *PORTS)
    own = {name: str(message[name]) for name in names if not values.get(name) and name in message}
    model = own.get('robot_model') or values['robot_model'] or DEFAULT_MODEL
    return dict(values) | own | {'robot_model': model}


def controller_arguments(values: Mapping[str, str]) -> list[str]:
    """Return the command line of the simulated controller for this client.

    A SPEL+ program in the controller's profile determines the motion. Raises FileNotFoundError for
    a missing profile, InputError for an invalid one.
    """
    values = effective(values)
    words = ['--robot', values['robot_model']]
    controller = values['controller']
    if not (controller and load_controller_profile(controller).spel.project):
        words += ['--motion', values['sim_motion']]
    if values['robot_ip']:
        words += ['--host', values['robot_ip']]
    if controller:
        words += ['--controller', controller]
    for name, port in _ports(values, values).items():
        if port:
            words += ['--' + name.replace('_', '-'), str(_port(name, port))]
    return words


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
