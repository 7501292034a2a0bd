# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`epson_driver spel run|test|export`: the commands with a robot model or simulated controller."""

import argparse
import logging
import re
from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from xml.sax.saxutils import quoteattr

from epson_driver.cli.problem_formats import path_from_here, placed
from epson_driver.inputs import InputError, printable, write_file
from epson_driver.robots import load_robot_model
from epson_driver.share import share_folder
from epson_driver.sim_controller import spel_run
from epson_driver.sim_controller.assembly import robot_defines
from epson_driver.sim_controller.spel_run import Bench, TestResult, covered, run_tests
from epson_driver.spel import (
    Program,
    ProgramEnvironment,
    ProgramError,
    build,
    read_answers,
    read_project,
    with_defines,
    with_setup,
)
from epson_driver.spel.commands import CONTROLLERS
from epson_driver.spel.export import exported
from epson_driver.spel.files import Files
from epson_driver.spel.lint import check

FOUND = 1
"""Exit code: something is wrong with the program."""

OLD_OUTPUTS = '0'
"""RC+ 6 assigns no remote outputs by default (p953)."""


Project = tuple[Path, Mapping[str, str]]
"""Its folder and its files."""


def _surroundings(
    arguments: argparse.Namespace, folder: Path, keep: bool = False
) -> ProgramEnvironment:
    answers = read_answers(arguments.stub) if arguments.stub is not None else {}
    return ProgramEnvironment(answers, dict(arguments.net), Files(folder, keep))


def _built(files: Mapping[str, str], folder: Path) -> Program:
    """Return a program. Raises ProgramError that names files from here."""
    try:
        return build(files)
    except ProgramError as error:
        raise ProgramError(placed(error.problems, folder)) from error


def run(arguments: argparse.Namespace, project: Project) -> int:
    """Run a program and return the exit code. Raises ProgramError, InputError, OSError."""
    logging.basicConfig(level=logging.WARNING, format='%(message)s')
    folder, files = project
    files = with_defines(files, dict(arguments.define))
    files = with_setup(files, arguments.setup) if arguments.setup else files
    return spel_run.run(
        _built(files, folder),
        Bench(arguments.robot, arguments.controller),
        arguments.remote_port,
        fast=arguments.fast,
        seconds=arguments.seconds,
        around=_surroundings(arguments, folder, keep=True),
    )


def test(arguments: argparse.Namespace, projects: Iterable[Project]) -> int:
    """Run the functions named Test…, and report their results.

    Raises ProgramError, InputError, OSError.
    """
    logging.basicConfig(handlers=[logging.NullHandler()])  # the error of a test is reported below
    bench = Bench(arguments.robot, arguments.controller)
    wanted = arguments.k.lower()
    results: list[TestResult] = []
    for folder, files in projects:
        around = _surroundings(arguments, folder)
        program = _built(files, folder)
        for result in run_tests(program, bench, lambda name: wanted in name.lower(), around):
            results.append(_from_here(result, folder))
            _report(results[-1])
    failed = sum(bool(result.error) for result in results)
    if arguments.junit is not None:
        write_file(arguments.junit, _junit(results))
    if not results:
        print('no functions named Test… found')
        return FOUND
    lines = covered(results)
    if arguments.coverage is not None:
        write_file(arguments.coverage, _cobertura(lines))
    for file, ran in sorted(lines.items()):
        print(f'{printable(file)}: {sum(ran.values())} of {len(ran)} lines ran')
    print(f'{len(results) - failed} passed, {failed} failed')
    return FOUND if failed else 0


def _from_here(result: TestResult, folder: Path) -> TestResult:
    at = result.position._replace(file=path_from_here(folder, result.position.file))
    lines = {path_from_here(folder, file): ran for file, ran in result.lines.items()}
    return replace(result, position=at, lines=lines)


def _report(result: TestResult) -> None:
    if not result.error:
        print(f'passed {result.name} ({result.seconds:.3f} s)')
        return
    at = result.position
    text = printable(result.error)
    print(f'FAILED {result.name}: {printable(at.file)}:{at.line}: {text}')
    for line in result.printed.splitlines():
        print(f'  {printable(line)}')


def _cobertura(files: dict[str, dict[int, bool]]) -> str:
    ran = [line for lines in files.values() for line in lines.values()]

    def rate(of: Collection[bool]) -> str:
        return f'line-rate="{sum(of) / len(of) if of else 1.0:.4f}"'

    text = ['<?xml version="1.0" encoding="utf-8"?>']
    text.append(f'<coverage {rate(ran)} lines-covered="{sum(ran)}" lines-valid="{len(ran)}">')
    text.append(f'  <packages><package name="spel" {rate(ran)}><classes>')
    for file, lines in sorted(files.items()):
        name = quoteattr(printable(file))
        text.append(f'    <class name={name} filename={name} {rate(lines.values())}><lines>')
        text += [
            f'      <line number="{number}" hits="{int(hit)}"/>'
            for number, hit in sorted(lines.items())
        ]
        text.append('    </lines></class>')
    return '\n'.join([*text, '  </classes></package></packages>', '</coverage>', ''])


def _junit(results: list[TestResult]) -> str:
    failed = sum(bool(result.error) for result in results)
    lines = [
        '<?xml version="1.0" encoding="utf-8"?>',
        f'<testsuite name="spel" tests="{len(results)}" failures="{failed}">',
    ]
    for result in results:
        at = result.position
        named = f'name={quoteattr(result.name)} file={quoteattr(printable(at.file))}'
        started = f'  <testcase {named} line="{at.line}" time="{result.seconds:.3f}"'
        if result.error:
            message = quoteattr(printable(result.error))
            lines.append(f'{started}><failure message={message}/></testcase>')
        else:
            lines.append(f'{started}/>')
    return '\n'.join([*lines, '</testsuite>', ''])


def export(arguments: argparse.Namespace) -> int:
    """Write the project into a new or empty folder. Raises InputError, OSError."""
    folder: Path = arguments.folder
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError(f'{printable(folder)}: must be a new or empty folder')
    name = folder.resolve().name
    if re.fullmatch(r'[A-Za-z0-9_-]{1,24}', name) is None:
        rule = 'the name of a project must be 1 to 24 letters, digits, - and _'
        raise InputError(f'{printable(folder)}: {rule}')
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
    for item, content in exported(name, files, version, datetime.now(UTC)).items():
        write_file(folder / item, content)
    print(f'{printable(folder)}: open {printable(name)}.sprj in RC+ and build it')
    return 0
