# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`epson_driver doctor [ADDRESS]`: diagnose this machine and its connection to the controller."""

import argparse
import asyncio
import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from functools import partial
from itertools import groupby
from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.padding import Padding
from rich.table import Table

from epson_driver.cli.arguments import (
    DEFAULT_MODEL,
    Parser,
    parsed,
    path_with,
)
from epson_driver.cli.robot_arguments import add_robot_arguments, look, question
from epson_driver.doctor.controller_checks import MIN_LISTENING_S, check_controller
from epson_driver.doctor.environment import check_environment
from epson_driver.doctor.findings import Finding, Findings, Level, as_text, report_drivers
from epson_driver.doctor.learning import profile_text, unknown, why_not
from epson_driver.doctor.look import report_look
from epson_driver.doctor.state_facts import Facts
from epson_driver.inputs import InputError, number, printable, write_file
from epson_driver.processes.command import module_command
from epson_driver.processes.interrupt import INTERRUPTED
from epson_driver.profiles import load_controller_profile
from epson_driver.robots import RobotModel, load_robot_model

COLOURS = {
    Level.OK: 'green',
    Level.NOTE: 'yellow',
    Level.WRONG: 'bold red',
    Level.INHIBIT: 'bold red',
    Level.SKIPPED: 'dim',
}

DISCOVERY_S = 3.0
"""Time for ROS to discover the other nodes, s."""

ORDER = (Level.WRONG, Level.INHIBIT, Level.NOTE, Level.SKIPPED, Level.OK)

GRAPH_TIMEOUT_S = 60.0


def main() -> int:
    parser = _parser()
    arguments = parsed(parser, positional='robot_ip')
    if arguments.address is None and (arguments.learn or arguments.ask or arguments.jog):
        parser.error('--learn, --ask and --jog need the address of a controller')
    if arguments.learn and arguments.learn.exists():
        parser.error(f'--learn {printable(arguments.learn)}: must be a new file')
    console = Console(highlight=False)
    at_once = partial(print_finding, console) if arguments.jog else lambda finding: None
    try:
        if arguments.controller:
            load_controller_profile(arguments.controller)
        model = load_robot_model(arguments.robot or DEFAULT_MODEL)
        with Console(stderr=True).status('') as status, _graph_reader() as graph:
            findings = Findings(at_once, status.update)
            facts, model = asyncio.run(_check(arguments, findings, status.stop)) or ({}, model)
            findings.busy('importing ROS')
            if check_environment(findings):
                findings.busy('looking for drivers and MoveIt in this ROS domain')
                _check_graph(graph, model, findings)
        return _finish(arguments, findings, facts, console)
    except (OSError, InputError) as error:
        parser.error(printable(error))
    except EOFError:
        return INTERRUPTED


async def _check(
    arguments: argparse.Namespace, findings: Findings, before: Callable[[], None]
) -> tuple[Facts, RobotModel] | None:
    if arguments.address is None:
        return None
    if arguments.controller is None:
        findings.busy(f'looking at {arguments.address}: Remote Ethernet and state ports')
        seen = await look(arguments, real_time=arguments.ask)
        if not report_look(seen, findings):
            return None
        arguments.controller, arguments.robot = seen.profile, seen.model or None
    checks = question(arguments, arguments.seconds, arguments.ask, arguments.io)
    ask = partial(_asked, before) if arguments.jog else None
    return await check_controller(checks, findings, ask), checks.model


async def _asked(before: Callable[[], None], sentence: str) -> str:
    before()  # ends the other output while a person types
    return await asyncio.to_thread(input, sentence)


@contextmanager
def _graph_reader() -> Iterator[subprocess.Popen[str]]:
    command = module_command('epson_driver.doctor.ros_graph', f'{DISCOVERY_S:g}')
    with subprocess.Popen(  # noqa: S603 - our own
        command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    ) as process:
        try:
            yield process
        finally:
            process.kill()


def _finish(
    arguments: argparse.Namespace, findings: Findings, facts: Facts, console: Console
) -> int:
    if arguments.learn is not None:
        if facts:
            about = f'{arguments.address}, {datetime.now(UTC):%Y-%m-%d %H:%M} UTC'
            text = profile_text(arguments.learn.stem, facts, arguments.like, about)
            write_file(arguments.learn, text)
            console.print(f'profile: {arguments.learn}, {len(facts)} keys found, unknown keys:')
            for why, keys in groupby(sorted(unknown(facts), key=why_not), why_not):
                console.print(Padding(f'{why}:', (0, 0, 0, 2)), style='dim')
                console.print(Padding(', '.join(keys), (0, 0, 0, 4)), style='dim')
        else:
            findings.wrong(
                '--learn', 'nothing was found out, so no profile is written', 'see above'
            )
    if not arguments.jog:  # then they were printed at once
        _show(console, findings, everything=arguments.all)
    if arguments.save is not None:
        head = [f'epson_driver doctor {" ".join(sys.argv[1:])}', f'{datetime.now(UTC):%F %T} UTC']
        write_file(arguments.save, as_text(findings, head))
        console.print(f'text: {arguments.save}', markup=False)
    style = 'bold red' if findings.exit_code else 'bold yellow' if findings.doubt else 'bold green'
    message = f'[{style}]{escape(printable(findings.verdict))}[/]'
    console.print(message, soft_wrap=not console.is_terminal)
    return findings.exit_code


def print_finding(console: Console, finding: Finding) -> None:
    """Print a finding, and its remedy on the next line. A terminal wraps both between words."""
    about, result = escape(printable(finding.about)), escape(printable(finding.text))
    level = f'[{COLOURS[finding.level]}]{finding.level.value:8}[/]'
    rows = [(level, f'[bold]{about}[/]: {result}')]
    if finding.remedy:
        rows.append((' ' * 8, f'→ {escape(finding.remedy)}'))
    if not console.is_terminal:
        for row in rows:
            console.print(*row, sep='', soft_wrap=True)
        return
    grid = Table.grid()
    grid.add_column(min_width=8)
    for row in rows:
        grid.add_row(*row)
    console.print(grid)


def _show(console: Console, findings: Findings, *, everything: bool) -> None:
    """Print the findings, the worst first.

    Without `everything`, passed checks share one line.
    """
    shown = sorted(findings.all, key=lambda item: ORDER.index(item.level))
    fine = [item for item in shown if item.level is Level.OK]
    if not everything and fine:
        del shown[-len(fine) + 1 :]
        names = ', '.join(dict.fromkeys(item.about for item in fine[1:]))
        shown.append(Finding(Level.OK, 'also in order', names))
    for item in shown:
        print_finding(console, item)


def _check_graph(process: subprocess.Popen[str], model: RobotModel, findings: Findings) -> None:
    try:
        report, _ = process.communicate(timeout=GRAPH_TIMEOUT_S)
        result = json.loads(report.strip().rpartition('\n')[2])
    except (subprocess.TimeoutExpired, ValueError):
        findings.skipped('driver, MoveIt', 'unknown: ROS does not start, see below')
        return
    report_drivers(result['drivers'], findings)
    joints = result['moveit']
    if joints is None:
        findings.skipped('MoveIt', 'no move_group runs in this domain')
        return
    missing = [name for name in model.joint_names if name not in joints]
    if missing:
        text = f'its robot lacks {", ".join(missing)} (it has {", ".join(joints) or "none"})'
        remedy = "joint_names of the driver must be those of MoveIt's URDF, in controller order"
        findings.wrong('MoveIt', text, remedy)
    else:
        findings.ok('MoveIt', f'knows {", ".join(model.joint_names)}')


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        'doctor',
        'Find out why the arm does not move, and report errors from this machine to the '
        'controller with their remedies. It looks and listens. Options permit more.',
        ('doctor 192.168.0.1', 'doctor 192.168.0.1 --controller spel --save doctor.txt'),
        '0 nothing is wrong and enabling suffices to move, 1 otherwise, '
        '2 invalid arguments, 130 Ctrl-C',
    )
    add_robot_arguments(
        parser,
        'address of the controller (default: none, only ROS and this machine are checked)',
    )
    parser.option('--all', 'print each check that passed, too')
    parser.option('--seconds S', 'listening time, s', number(MIN_LISTENING_S, 600.0), 5.0)
    parser.option(
        '--ask',
        'permission to query the motion and remote ports with the motors off: nothing moves, '
        'but an error may remain, and no other client can connect during it',
    )
    parser.option('--io', 'permission to query the I/O port: outputs may change at the end')
    parser.option('--jog', 'prompts to jog each joint and to read X Y Z U V W from the pendant')
    parser.option(
        '--learn FILE', 'new file for a controller profile, NAME.yaml', path_with('.yaml')
    )
    parser.option(
        '--like PROFILE', 'profile for the keys that cannot be learned', default='generic'
    )
    parser.option('--save FILE', 'text file with all findings, for a bug report', Path)
    return parser
