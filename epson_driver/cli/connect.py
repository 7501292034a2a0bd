# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`epson_driver connect ADDRESS`: identify the robot, and write its settings to robot.yaml."""

import argparse
import asyncio
import sys
from datetime import UTC, datetime
from pathlib import Path

from rich.console import Console

from epson_driver.cli.arguments import Parser, parsed, path_with
from epson_driver.cli.doctor import print_finding
from epson_driver.cli.robot_arguments import add_robot_arguments, look
from epson_driver.doctor.findings import Findings
from epson_driver.doctor.look import report_look
from epson_driver.inputs import InputError, printable, write_file
from epson_driver.profiles import load_controller_profile
from epson_driver.robots.catalogue import model_name
from epson_driver.setup.robot_file import robot_text

NO_ADDRESS = """\
Which address does the controller have? It is shown
  in RC+: Setup, System Configuration, Controller, Configuration
  on this machine, if it has talked to the controller: ip neigh
This machine needs an address in the same network. Then: epson_driver connect ADDRESS"""

OPTIONAL = ('motion_port', 'state_port', 'io_port', 'remote_port', 'password_variable')


def main() -> int:
    parser = _parser()
    arguments = parsed(parser, positional='robot_ip')
    if arguments.address is None:
        print(NO_ADDRESS, file=sys.stderr)
        return 2
    if arguments.file.exists():
        parser.error(f'{printable(arguments.file)} exists: delete it, or choose another --file')
    console = Console(highlight=False)
    findings = Findings(lambda finding: print_finding(console, finding))
    try:
        if arguments.robot:
            arguments.robot = model_name(arguments.robot)
        if arguments.controller:
            load_controller_profile(arguments.controller)
        with Console(stderr=True).status(f'looking at {arguments.address}'):
            seen = asyncio.run(look(arguments))
        if not report_look(seen, findings):
            return findings.exit_code
        model = seen.model or _asked_model()
        if not model:
            return 1
        settings = {
            'robot_ip': arguments.address,
            'controller': seen.profile,
            'robot_model': model,
        }
        settings |= {
            name: value
            for name in OPTIONAL
            if (value := getattr(arguments, name)) not in (None, '')
        }
        about = f'Made by epson_driver connect, {datetime.now(UTC):%Y-%m-%d}: {seen.why}.'
        write_file(arguments.file, robot_text(settings, about))
    except (OSError, InputError) as error:
        parser.error(printable(error))
    file = printable(arguments.file)
    print(f'written: {file}, {model} with the profile {seen.profile}. Next:')
    print(f'  epson_driver doctor {file}')
    print(f'  epson_driver first_run {file}')
    print(f"  Robot('{file}') in Python, robot:={file} for the launch files of ROS")
    return 0


def _asked_model() -> str:
    while sys.stdin.isatty():
        try:
            return model_name(input('Robot model, as on its plate, such as T6-602S: '))
        except InputError as error:
            print(error)
        except EOFError:
            break
    return ''


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        'connect',
        'Find out which controller and robot answer at an address, and write them to a file '
        'that the other commands, Python and the launch files accept. Nothing moves.',
        ('connect 192.168.0.1', 'connect 192.168.0.1 --robot t6_602s --file cell_3.yaml'),
        '0 the file is written, 1 no controller answers or its model is unknown, '
        '2 invalid arguments, 130 Ctrl-C',
    )
    add_robot_arguments(parser, 'address of the controller (default: advice how to find it)')
    parser.option('--file FILE', 'new file', path_with('.yaml'), Path('robot.yaml'))
    return parser
