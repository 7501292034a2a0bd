# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Options of the commands that run a SPEL+ program: spel run, spel test and sim_controller.

These options override the spel.yaml next to the program.
"""

import argparse
from collections.abc import Mapping
from pathlib import Path

from epson_driver.cli.arguments import DEFAULT_MODEL, Parser, define
from epson_driver.cli.problem_formats import placed
from epson_driver.inputs import InputError
from epson_driver.spel import (
    Program,
    ProgramEnvironment,
    ProgramError,
    Settings,
    build,
    read_settings,
    with_defines,
    with_setup,
)
from epson_driver.spel.errors import SETTINGS_FILE
from epson_driver.spel.files import Files
from epson_driver.spel.settings import KEYS

DEFAULT_CONTROLLER = 'simulated'


def add_set(parser: Parser) -> None:
    parser.option(
        '--set KEY=VALUE',
        f'value of a key ({", ".join(KEYS)}) instead of that in {SETTINGS_FILE}, such as '
        'ports.201=192.168.0.1:2000 (repeatable)',
        default=[],
        action='append',
    )


def add_program_options(parser: Parser) -> None:
    text = f'(default: of {SETTINGS_FILE}, else'
    parser.option('--robot MODEL', f'robot model, or a .yaml file {text} {DEFAULT_MODEL})')
    parser.option(
        '--controller PROFILE', f'controller profile, or a .yaml file {text} {DEFAULT_CONTROLLER})'
    )
    add_changes(parser)


def add_changes(parser: Parser) -> None:
    parser.option(
        '--define NAME=VALUE',
        'new value for a #define line of the SPEL+ project, empty to disable it (repeatable)',
        define,
        [],
        action='append',
    )
    add_set(parser)


def changes_of(arguments: argparse.Namespace) -> list[str]:
    """Return the options of `add_changes` for the command line of another process."""
    defines = [f'--define={name}={value}' for name, value in arguments.define]
    return [*defines, *(f'--set={text}' for text in arguments.set)]


def settings_of(arguments: argparse.Namespace, folder: Path | None) -> Settings:
    """Return the settings for a program.

    The options on the command line override the spel.yaml in `folder`, if a folder is given.
    """
    return read_settings(
        folder, arguments.set, robot=arguments.robot, controller=arguments.controller
    )


def program_of(
    arguments: argparse.Namespace,
    files: Mapping[str, str],
    settings: Settings,
    folder: Path,
    starts: str = 'main',
) -> Program:
    """Compile `files` with the command line's #define values and the settings' statements.

    * settings: `settings.statements` are inserted at the start of functions.
    * starts: pattern for the names of these functions.

    Raises ProgramError if the program is invalid, InputError if the settings' statements are.
    """
    files = with_defines(files, dict(arguments.define))
    try:
        program = build(files)
        if not settings.statements:
            return program
    except ProgramError as error:
        raise ProgramError(placed(error.problems, folder)) from error
    try:
        return build(with_setup(files, settings.statements, starts))
    except ProgramError as error:
        problem = error.problems[0].text
        raise InputError(f'{settings.source}: {settings.statements}: {problem}') from error


def environment_of(
    settings: Settings, folder: Path | None, keep: bool = False
) -> ProgramEnvironment:
    """Return the environment of a program.

    `keep`: whether files that the program writes are stored in `folder`, or only in memory.
    """
    return ProgramEnvironment(settings.stubs, settings.ports, Files(folder, keep))
