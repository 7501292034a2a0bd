# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`epson_driver NAME …`: every executable behind one command."""

import sys
from importlib import import_module

EXECUTABLES = {
    'client': 'the ROS 2 node: joint states, robot status, FollowJointTrajectory',
    'sim_controller': 'a simulated EPSON controller',
    'demo': 'both of them, and a planned trajectory executed, with a report',
    'smooth': 'a planned trajectory made smooth: a file, a report and a picture',
    'replay': 'the controller as a trace recorded it, for bug reports',
    'robots': 'the robot models there are, with their numbers and where those come from',
    'spel': 'EPSON programs (SPEL+) checked and tested without a robot',
    'pendant': 'what a person does at the controller: motors, E-stop, reset, status',
}


def main() -> int:
    """Run the executable named first, with the remaining arguments."""
    name = sys.argv[1] if len(sys.argv) > 1 else ''
    if name not in EXECUTABLES:
        asked_for_help = name in ('-h', '--help')
        rows = [f'  {executable:15} {text}' for executable, text in EXECUTABLES.items()]
        text = '\n'.join(['usage: epson_driver NAME [arguments]', '', *rows])
        print(text, file=sys.stdout if asked_for_help else sys.stderr)
        return 0 if asked_for_help else 2
    del sys.argv[1]
    try:
        executable = import_module(f'epson_driver.cli.{name}')
    except ModuleNotFoundError as error:
        if error.name is None or error.name.startswith('epson_driver'):
            raise
        print(
            f'epson_driver {name}: the Python module {error.name} is missing: source a ROS 2 '
            'workspace, or install requirements/runtime.txt (see README.md)',
            file=sys.stderr,
        )
        return 1
    result: int = executable.main()
    return result


if __name__ == '__main__':
    sys.exit(main())
