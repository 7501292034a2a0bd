# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Arguments of the commands that connect to a controller: address, profile, model, ports."""

import argparse

from epson_driver.cli.arguments import DEFAULT_MODEL, Parser, add_password, add_ports, host
from epson_driver.doctor.controller_checks import Question
from epson_driver.doctor.look import Look, look_at
from epson_driver.profiles import load_controller_profile
from epson_driver.robots import load_robot_model
from epson_driver.setup.robot_file import password_in


def add_robot_arguments(parser: Parser, address: str) -> None:
    parser.add_argument('address', nargs='?', type=host, metavar='ADDRESS', help=address)
    parser.option(
        '--controller PROFILE',
        'controller profile, such as remote or spel (default: the one that fits the ports '
        'that answer)',
    )
    parser.option('--robot MODEL', 'robot model (default: the one that the controller reports)')
    add_ports(parser, 'not used')
    add_password(parser)


async def look(arguments: argparse.Namespace, *, real_time: bool = True) -> Look:
    """Identify the controller, also by discovery of Real-time Motion Control if `real_time`.

    A profile or model on the command line replaces the detected one.
    """
    name = arguments.controller
    usual = load_controller_profile(name).remote.password if name else ''
    password = password_in(arguments.password_variable, usual)
    ports = (arguments.remote_port, arguments.state_port)
    real_time_port = arguments.motion_port if real_time and not name else 0
    result = await look_at(arguments.address, password, *ports, real_time_port)
    result.model = arguments.robot or result.model
    if arguments.controller:
        result.profile, result.why = arguments.controller, 'it was given'
    return result


def question(
    arguments: argparse.Namespace, seconds: float, may_ask: bool = False, may_use_io: bool = False
) -> Question:
    """Return the controller to check, and the permitted checks.

    Raises OSError or InputError if the profile or the model is invalid.
    """
    profile = load_controller_profile(arguments.controller)

    def port(name: str) -> int:
        option = getattr(arguments, f'{name}_port')
        return int(getattr(profile.ports, name) if option is None else option)

    return Question(
        host=arguments.address,
        profile=profile,
        model=load_robot_model(arguments.robot or DEFAULT_MODEL),
        state_port=port('state'),
        motion_port=profile.motion_port
        if arguments.motion_port is None
        else arguments.motion_port,
        io_port=port('io'),
        remote_port=port('remote'),
        password=password_in(arguments.password_variable, profile.remote.password),
        seconds=seconds,
        may_ask=may_ask,
        may_use_io=may_use_io,
    )
