# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The executables, and the command that starts a module of this package as a process.

With -P, Python imports nothing from the current folder, so a `random.py` in it is not executed.
The package is imported from the folder of this file. The environment is unchanged, so that Python
finds modules in PYTHONPATH, which a sourced workspace needs.
"""

import logging
import os
import sys
import threading
from pathlib import Path
from runpy import run_module

NICE = -10  # real-time priority would starve the threads that serve `~/stop`

_log = logging.getLogger(__name__)
_refused = threading.Event()


def raise_priority() -> None:
    """Lower the nice value of this thread only. A failure is logged once."""
    try:
        if os.sched_getscheduler(0) == os.SCHED_OTHER:
            os.sched_setscheduler(0, os.SCHED_OTHER | os.SCHED_RESET_ON_FORK, os.sched_param(0))
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), NICE)
    except (AttributeError, OSError) as error:  # AttributeError: a system without these calls
        if not _refused.is_set():
            _refused.set()
            _log.info(
                'the driver keeps its normal priority (%s): a busy machine may stall it, '
                'docs/troubleshooting.md has the remedy',
                error,
            )


_FILE = Path(__file__).absolute()


def safe_python() -> list[str]:
    return [sys.executable, '-P']


def module_command(module: str, *arguments: str) -> list[str]:
    return [*safe_python(), str(_FILE), module, *arguments]


def _run() -> None:
    root = str(_FILE.parents[2])
    if root not in sys.path:  # neither installed nor in PYTHONPATH
        sys.path.insert(0, root)
    module = sys.argv.pop(1)
    run_module(module, run_name='__main__', alter_sys=True)


def open_closed_streams() -> None:
    """Open the standard streams that are closed, before any other file is opened.

    Otherwise the next socket would get the number 1 or 2, and the log output of C++ libraries
    would be sent to a robot or to ROS.
    """
    for number, name in enumerate(('stdin', 'stdout', 'stderr')):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # it gets the lowest free number
            os.set_inheritable(number, True)
            setattr(sys, name, os.fdopen(number, 'w' if number else 'r', closefd=False))
            setattr(sys, f'__{name}__', getattr(sys, name))


EXECUTABLES = {
    'connect': 'find out what a controller and its robot are, and write it to robot.yaml',
    'client': 'run the ROS 2 node: joint states, robot status, FollowJointTrajectory',
    'sim_controller': 'simulate an EPSON controller',
    'demo': 'execute a planned trajectory on a simulated robot, and report on it',
    'fleet': 'run many simulated robots with their drivers, and show their state',
    'panel': 'show the robots in a browser: 3D, status, curves, log and buttons',
    'smooth': 'smooth a planned trajectory: a file, a report and a picture',
    'smooth_goals': 'smooth FollowJointTrajectory goals for any driver',
    'exercise': 'run your program against the simulated controller, once per fault',
    'doctor': 'find errors from this machine to the controller, and their remedies',
    'first_run': 'check a real robot step by step on its first day',
    'report': 'report on a run, from a trace or a bag, as one HTML page',
    'robots': 'list the robot models, with their numbers and sources',
    'spel': 'check and test EPSON programs (SPEL+) without a robot',
    'pendant': 'perform operator actions at a controller: motors, E-stop, reset, status',
}


if __name__ == '__main__':
    _run()
