# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`epson_driver NAME …`: every executable behind one command."""

import os
import sys
from importlib import import_module
from xml.etree import ElementTree

from epson_driver.inputs import meant, printable
from epson_driver.processes.command import EXECUTABLES, open_closed_streams
from epson_driver.processes.interrupt import (
    INTERRUPTED,
    ignore_interrupts,
    leave_at_interrupt,
    raise_at_interrupt,
)
from epson_driver.processes.ros_shell import ros_problem
from epson_driver.share import share_path

NEED_ROS = ('client', 'demo', 'fleet', 'smooth_goals')

INTERFACES = ('epson_msgs', 'industrial_msgs')
"""Message packages without a binary release. They are built from interfaces/."""

NO_WHEELS = ('control_msgs', 'tf2_msgs', *INTERFACES)

NOT_OF_ROS = {'matplotlib': 'report', 'lsprotocol': 'editor', 'pygls': 'editor'}
"""Optional modules that are not part of ROS, each with the extra that installs it."""

BROKEN_PIPE = 141
"""Exit code if the reader of a pipe has closed it: 128 + SIGPIPE, as in shells."""


def main() -> int:
    leave_at_interrupt()
    open_closed_streams()
    try:
        result = _run()
        if not sys.stdout.closed:  # by pygls, when an editor ends `spel server`
            sys.stdout.flush()
    except KeyboardInterrupt:
        return INTERRUPTED
    except BrokenPipeError:  # `| head` has closed the pipe
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # for the flush at exit
        return BROKEN_PIPE
    else:
        return result
    finally:
        ignore_interrupts()


def version() -> str:
    package = ElementTree.parse(share_path('package.xml'))  # noqa: S314 - our own file
    return str(package.findtext('version'))


def _run() -> int:
    name = sys.argv[1] if len(sys.argv) > 1 else ''
    if name.replace('-', '_') in EXECUTABLES:
        name = name.replace('-', '_')
    if name == '--version':
        print(f'epson_driver {version()}')
        return 0
    if name in ('-h', '--help'):
        print(_usage())
        return 0
    if name not in EXECUTABLES:
        unknown = f'epson_driver: no command {printable(name[:100])}: {meant(name, EXECUTABLES)}'
        print(unknown if name else _usage(), file=sys.stderr)
        return 2
    del sys.argv[1]
    asks_help = not {'-h', '--help'}.isdisjoint(sys.argv)
    if name in NEED_ROS and not asks_help and (problem := ros_problem()):
        print(f'epson_driver {name}: {printable(problem)}', file=sys.stderr)
        return 1
    ready = False
    try:
        executable = import_module(f'epson_driver.cli.{name}')
        ready = True
        raise_at_interrupt()
        result: int = executable.main()
    except ModuleNotFoundError as error:
        top = (error.name or '').partition('.')[0]
        if top in ('', 'epson_driver') or (ready and top not in NOT_OF_ROS):
            raise
        print(f'epson_driver {name}: {_missing(top)}', file=sys.stderr)
        return 1
    return result


def _usage() -> str:
    rows = [f'  {executable:15} {text}' for executable, text in EXECUTABLES.items()]
    usage = 'usage: epson_driver NAME [arguments]\n       epson_driver [--help | --version]'
    return '\n'.join(
        [usage, '', *rows, '', 'Run `epson_driver NAME --help` for the options of a command.']
    )


def _missing(package: str) -> str:
    text = f'the Python module {package} is missing: '
    if package in NOT_OF_ROS:
        return f"{text}pip install 'epson_driver[{NOT_OF_ROS[package]}]'"
    text += 'this needs ROS 2; source a workspace'
    if package in INTERFACES:
        text += ' that was built with colcon build --base-paths src/epson_driver '
        text += 'src/epson_driver/interfaces'
    if package in NO_WHEELS:
        return f'{text}, or pip install ./interfaces/{package} in the source tree'
    return f"{text}, or pip install 'epson_driver[ros]' (see README.md)"


if __name__ == '__main__':
    sys.exit(main())
