# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`epson_driver spel export`: the program for a controller as a project that RC+ opens."""

import argparse
import re
from datetime import UTC, datetime
from pathlib import Path

from epson_driver.inputs import InputError, printable, write_file
from epson_driver.robots import load_robot_model
from epson_driver.share import share_folder
from epson_driver.sim_controller.spel_host.profile_project import robot_defines
from epson_driver.spel import read_project, with_defines
from epson_driver.spel.export import exported
from epson_driver.spel.lint import check

CONTROLLERS = {'rc620': 6, 'rc700a': 7, 'rc90': 7, 't': 7, 'vt': 7, 'rc800': 8}
"""Kinds of controllers, and the version of RC+ that belongs to each."""

OLD_OUTPUTS = '0'
"""RC+ 6 assigns no remote outputs by itself (p953)."""


def export(arguments: argparse.Namespace) -> int:
    """Write the project into a new or empty folder. Raises InputError, OSError."""
    folder: Path = arguments.folder
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError(f'{printable(folder)}: must be a new or an empty folder')
    name = folder.resolve().name
    if re.fullmatch(r'[A-Za-z0-9_-]{1,24}', name) is None:
        said = "is the project's name: must be 1 to 24 letters, digits, - and _"
        raise InputError(f'{printable(folder)}: {said}')
    version = CONTROLLERS[arguments.controller]
    files = read_project(share_folder('controller_program'))
    defines = robot_defines(files, load_robot_model(arguments.robot))
    defines['OWN_ADDRESS'] = f'"{arguments.address}"'
    if version == 6:
        defines['IO_FIRST_OUTPUT_BYTE'] = OLD_OUTPUTS
    files = with_defines(files, defines)
    problems = check(files, version)
    if problems:  # a robot, or a name, that the program has not been tried with
        raise InputError(str(problems[0]))
    folder.mkdir(parents=True, exist_ok=True)
    for each, content in exported(name, files, version, datetime.now(UTC)).items():
        write_file(folder / each, content)
    print(f'{printable(folder)}: open {printable(name)}.sprj in RC+, then build it')
    return 0
