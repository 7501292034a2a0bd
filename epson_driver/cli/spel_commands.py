# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`epson_driver spel run|test|export`: the commands that need a robot model."""

import argparse
import logging
import re
from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from xml.sax.saxutils import quoteattr

from epson_driver.cli.arguments import DEFAULT_MODEL
from epson_driver.cli.problem_formats import FOUND, path_from_here
from epson_driver.cli.spel_options import (
    DEFAULT_CONTROLLER,
    environment_of,
    program_of,
    settings_of,
)
from epson_driver.inputs import InputError, printable, write_file
from epson_driver.robots import load_robot_model
from epson_driver.share import share_path
from epson_driver.sim_controller import spel_run
from epson_driver.sim_controller.assembly import robot_defines
from epson_driver.sim_controller.spel_run import Bench, TestResult, covered, run_tests
from epson_driver.spel import Settings, read_project, with_defines
from epson_driver.spel.commands import CONTROLLERS
from epson_driver.spel.export import exported
from epson_driver.spel.lint import check
from epson_driver.spel.project import TESTS

FIRST_OUTPUT_BYTE_6 = '0'
"""IO_FIRST_OUTPUT_BYTE for RC+ 6. RC+ 6 reserves no outputs for remote control (SPEL+ manual
p953)."""

BUILT_IN = ('t', 'vt')
"""Controllers that are built into the arms of the series of the same name."""

Project = tuple[Path, Mapping[str, str]]


def run(arguments: argparse.Namespace, project: Project) -> int:
    logging.basicConfig(level=logging.WARNING, format='%(message)s')
    folder, files = project
    settings = settings_of(arguments, folder)
    return spel_run.run(
        program_of(arguments, files, settings, folder),
        _bench(settings),
        arguments.remote_port,
        fast=arguments.fast,
        seconds=arguments.seconds,
        environment=environment_of(settings, folder, keep=True),
    )


def _bench(settings: Settings) -> Bench:
    return Bench(settings.robot or DEFAULT_MODEL, settings.controller or DEFAULT_CONTROLLER)


def test(arguments: argparse.Namespace, projects: Iterable[Project]) -> int:
    logging.basicConfig(handlers=[logging.NullHandler()])  # `_report` prints the errors of tests
    pattern = arguments.k.lower()
    results: list[TestResult] = []
    for folder, files in projects:
        settings = settings_of(arguments, folder)
        program = program_of(arguments, files, settings, folder, TESTS)
        around, bench = environment_of(settings, folder), _bench(settings)
        for result in run_tests(program, bench, lambda name: pattern in name.lower(), around):
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
    position = result.position._replace(file=path_from_here(folder, result.position.file))
    lines = {path_from_here(folder, file): ran for file, ran in result.lines.items()}
    return replace(result, position=position, lines=lines)


def _report(result: TestResult) -> None:
    if not result.error:
        print(f'passed {result.name} ({result.seconds:.3f} s)')
        return
    where = f'{printable(result.position.file)}:{result.position.line}'
    print(f'FAILED {result.name}: {where}: {printable(result.error)}')
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
        position = result.position
        named = f'name={quoteattr(result.name)} file={quoteattr(printable(position.file))}'
        started = f'  <testcase {named} line="{position.line}" time="{result.seconds:.3f}"'
        if result.error:
            message = quoteattr(printable(result.error))
            lines.append(f'{started}><failure message={message}/></testcase>')
        else:
            lines.append(f'{started}/>')
    return '\n'.join([*lines, '</testsuite>', ''])


def export(arguments: argparse.Namespace) -> int:
    folder: Path = arguments.folder
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError(f'{printable(folder)}: must be a new or empty folder')
    name = folder.resolve().name
    if re.fullmatch(r'[A-Za-z0-9_-]{1,24}', name) is None:
        rule = 'the name of a project must be 1 to 24 letters, digits, - and _'
        raise InputError(f'{printable(folder)}: {rule}')
    version = CONTROLLERS[arguments.controller]
    model = load_robot_model(arguments.robot)
    series = re.match(r'v?t(?=\d+_)', model.name)
    own = series[0] if series else arguments.controller
    if arguments.controller != own or (series is None and own in BUILT_IN):
        needed = f'{own}, built into its base' if series else 'another one: t and vt are built in'
        rule = f'the controller of {model.name} must be {needed}'
        raise InputError(f'--controller {arguments.controller}: {rule}')
    files = read_project(share_path('controller_program'))
    defines = robot_defines(files, model)
    defines['OWN_ADDRESS'] = f'"{arguments.address}"'
    if version == 6:
        defines['IO_FIRST_OUTPUT_BYTE'] = FIRST_OUTPUT_BYTE_6
    files = with_defines(files, defines)
    problems = check(files, version)
    if problems:  # possible for a model that no test exports
        raise InputError(str(problems[0]))
    folder.mkdir(parents=True, exist_ok=True)
    for item, content in exported(name, files, version, datetime.now(UTC)).items():
        write_file(folder / item, content)
    print(f'{printable(folder)}: open {printable(name)}.sprj in RC+ and build it')
    return 0
