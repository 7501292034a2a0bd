# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`epson_driver exercise -- COMMAND …`: run a user's program once per fault."""

import argparse
import shlex
import shutil
import sys
import tempfile
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from epson_driver.cli.arguments import (
    Parser,
    add_controller,
    add_robot,
    parsed,
    with_start_joined,
)
from epson_driver.exercise.judge import Observed, Result, Verdict, judge, junit
from epson_driver.exercise.runner import CASES, NO_FAULT, Exercise, run_case
from epson_driver.inputs import InputError, count, number, printable, write_file
from epson_driver.processes.interrupt import INTERRUPTED, raise_at_first_signal
from epson_driver.processes.processes import RunError
from epson_driver.profiles import load_controller_profile
from epson_driver.robots import load_robot_model

USUAL_ATTEMPTS = 3
"""Maximum number of runs without a fault. A busy machine may disturb some of them."""

COLOURS = {Verdict.FINISHED: 'green', Verdict.GAVE_UP: 'cyan'}


def main() -> int:
    parser = _parser()
    arguments = parsed(parser, with_start_joined(sys.argv[1:]))
    if arguments.list:
        for name, case in CASES.items():
            print(f'{name:18} {case.what}')
        return 0
    if not arguments.command:
        parser.error('COMMAND is missing: epson_driver exercise [options] -- COMMAND …')
    if shutil.which(arguments.command[0]) is None:
        parser.error(f'{printable(arguments.command[0])}: no such program')
    if arguments.keep is not None and arguments.keep.exists():
        parser.error(f'{printable(arguments.keep)}: must be a new folder (--keep)')
    try:
        load_controller_profile(arguments.controller)
        load_robot_model(arguments.robot)
    except (OSError, InputError) as error:
        parser.error(printable(error))
    raise_at_first_signal()
    console = Console(highlight=False)
    try:
        with ExitStack() as stack:
            folder = arguments.keep or Path(
                stack.enter_context(tempfile.TemporaryDirectory(prefix='epson_driver_exercise_'))
            )
            return _exercise(arguments, folder, console)
    except (RunError, OSError) as error:
        console.print(f'[bold red]exercise failed:[/] {escape(printable(error))}')
        return 2
    except KeyboardInterrupt:
        console.print('stopped')
        return INTERRUPTED


def _exercise(arguments: argparse.Namespace, folder: Path, console: Console) -> int:
    exercise = Exercise(
        command=arguments.command,
        robot=arguments.robot,
        controller=arguments.controller,
        arguments=() if arguments.start is None else (f'--start={arguments.start}',),
        seed=arguments.seed,
        timeout=arguments.timeout,
        enabled=not arguments.not_enabled,
    )
    usual = _usual(exercise, folder, console)
    if usual.code != 0 or not usual.moved:
        why = _why_not_usual(usual, arguments.timeout)
        console.print(f'[bold red]failed before a fault was started:[/] {escape(why)}')
        return 2
    console.print(
        f'finished in {usual.seconds:.1f} s, {usual.trajectories} trajectories', style='green'
    )
    results = []
    for name in arguments.fault or CASES:
        result = judge(run_case(exercise, CASES[name], folder / name, usual), usual)
        results.append(result)
        console.print(f'{name}: [{_colour(result)}]{result.verdict.value}[/]')
    console.print(_matrix(results))
    if arguments.junit is not None:
        write_file(arguments.junit, junit(results, shlex.join(arguments.command)))
        console.print(f'JUnit: {arguments.junit}', markup=False)
    if arguments.keep is not None:
        console.print(
            f'logs and traces: {arguments.keep} (epson_driver report FOLDER/*/wire.pcap)',
            markup=False,
        )
    bad = sum(not item.good for item in results)
    if bad:
        console.print(f'[bold red]{bad} of {len(results)} failed[/]')
        return 1
    console.print(f'[bold green]all {len(results)} passed[/]')
    return 0


def _usual(exercise: Exercise, folder: Path, console: Console) -> Observed:
    for attempt in range(1, USUAL_ATTEMPTS + 1):
        console.print(f'{NO_FAULT.name} …')
        name = 'no_fault' if attempt == 1 else f'no_fault_{attempt}'
        usual = run_case(exercise, NO_FAULT, folder / name, None)
        if not usual.aborted:
            break
        console.print(f'[yellow]a goal was aborted:[/] {escape(usual.aborted)}')
    return usual


def _why_not_usual(usual: Observed, timeout: float) -> str:
    if usual.code is None:
        return (
            f'still running after {timeout:g} s (--timeout), last line: {usual.last_line or "-"}'
        )
    if usual.code:
        return f'exit code {usual.code}, last line: {usual.last_line or "-"}'
    return 'it ended without moving the arm'


def _colour(result: Result) -> str:
    return COLOURS.get(result.verdict, 'bold red')


def _matrix(results: Sequence[Result]) -> Table:
    table = Table(box=SIMPLE_HEAD, show_edge=False)
    for column in ('fault', 'result', 's', 'reason'):
        table.add_column(column, justify='right' if column == 's' else 'left')
    for result in results:
        table.add_row(
            result.case,
            f'[{_colour(result)}]{result.verdict.value}[/]',
            f'{result.seconds:.1f}',
            escape(result.why),
        )
    return table


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        'exercise',
        'Run a ROS program that uses the driver against the simulated controller, once per '
        'fault, and report how it reacted. A program that uses Robot needs no driver: test it '
        'with Robot.simulated() and robot.simulation.fault().',
        (
            'exercise -- python3 my_program.py',
            'exercise --fault estop --junit results.xml -- ros2 launch my_cell cell.launch.py',
        ),
        '0 it finished or gave up with a reason in every case, 1 it did not, '
        '2 invalid arguments or a failure without a fault, 130 Ctrl-C',
    )
    parser.add_argument(
        'command', nargs='*', metavar='COMMAND', help='command line of the program, after --'
    )
    parser.option(
        '--fault NAME',
        'fault to test (repeatable, default: all of --list)',
        action='append',
        choices=list(CASES),
    )
    parser.option('--list', 'list the faults and exit')
    parser.option('--seed N', 'seed for random faults', count(0, 2**31 - 1), 0)
    parser.option('--timeout S', 'time limit of a run, s', number(1.0, 3600.0), 60.0)
    add_robot(parser)
    add_controller(parser)
    parser.option('--start Q1,Q2,…', 'initial joint positions, rad or m (default: all 0)')
    parser.option('--not-enabled', 'start with a disabled arm: the program calls ~/enable')
    parser.option('--junit FILE', 'JUnit XML file for the results (default: none)', Path)
    parser.option(
        '--keep FOLDER',
        'new folder in which logs and traces are kept (default: they are deleted at the end)',
        Path,
    )
    return parser
