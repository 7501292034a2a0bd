# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`epson_driver first_run ADDRESS`: guides an operator through the first run of a real robot."""

import argparse
import asyncio
import os
import platform
import sys
import termios
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from rich.console import Console
from rich.markup import escape

from epson_driver.cli.arguments import Parser, parsed
from epson_driver.cli.doctor import print_finding
from epson_driver.cli.robot_arguments import add_robot_arguments, look, question
from epson_driver.doctor.findings import ABOUT, Finding, Findings, Level
from epson_driver.doctor.look import report_look
from epson_driver.driver.inhibit import Cause
from epson_driver.first_run.record import FirstRunRecord, load
from epson_driver.first_run.run import go_through
from epson_driver.first_run.steps import FirstRun
from epson_driver.inputs import InputError, printable
from epson_driver.processes.interrupt import INTERRUPTED
from epson_driver.robots.catalogue import model_name

LISTENING_S = 5.0


def main() -> int:
    parser = _parser()
    arguments = parsed(parser, positional='robot_ip')
    if arguments.address is None:
        parser.error('the address of a controller, or a file of connect, is needed')
    path = arguments.file or Path(f'first_run_{arguments.address}.html'.replace(':', '_'))
    console = Console(highlight=False)
    findings = Findings(lambda finding: _print_if_useful(console, finding))
    try:
        if not (arguments.controller and arguments.robot):
            seen = asyncio.run(look(arguments))
            if not report_look(seen, findings):
                return findings.exit_code
            if not seen.model:
                parser.error('the controller does not report its model: give --robot MODEL')
            arguments.controller, arguments.robot = seen.profile, seen.model
        arguments.robot = model_name(arguments.robot)
        checks = question(arguments, LISTENING_S)
        if checks.profile.program.interface == 'rtmc':
            parser.error('it has no steps for Real-time Motion Control: see docs/controllers.md')
        about = {
            'address': arguments.address,
            'controller': arguments.controller,
            'robot': arguments.robot,
        }
        record = load(path) if path.exists() else FirstRunRecord(about | _versions())
        for key, value in about.items():
            if record.about[key] != value:
                rule = f'is for {key} {record.about[key]}: use that, or another --file'
                raise InputError(f'{printable(path)}: {rule}')
        run = FirstRun(checks, _Keyboard().ask, findings)
        ended = asyncio.run(go_through(run, record, path, lambda text: _say(console, text)))
    except (OSError, InputError) as error:
        parser.error(printable(error))
    except (KeyboardInterrupt, EOFError):
        console.print(f'\nended, completed steps are saved in {escape(printable(path))}')
        return INTERRUPTED
    if record.habits:
        console.print('[bold]differences from the profile:[/]')
    for habit in record.habits:
        console.print(f'  {escape(printable(habit))}', soft_wrap=not console.is_terminal)
    console.print(f'page, also for sim_controller --profile-from: {printable(path)}')
    failed = any(item.state == 'failed' for item in record.entries.values())
    return int(failed or not ended)


def _print_if_useful(console: Console, finding: Finding) -> None:
    later = finding.level is Level.SKIPPED or finding.about == ABOUT[Cause.MOTORS_OFF]
    if not later:  # a later step makes the skipped checks, and asks for the motors
        print_finding(console, finding)


def _say(console: Console, text: str) -> None:
    style = 'bold yellow' if 'THE ARM MOVES' in text else 'bold'
    console.print(f'[{style}]{escape(text)}[/]', soft_wrap=not console.is_terminal)


class _Keyboard:
    """Reads lines of standard input without a thread, because a thread would delay Ctrl-C."""

    def __init__(self) -> None:
        self._typed = b''

    async def ask(self, sentence: str) -> str:
        loop, file = asyncio.get_running_loop(), sys.stdin.fileno()
        if os.isatty(file):  # drop lines typed before the question
            termios.tcflush(file, termios.TCIFLUSH)
            self._typed = b''
        print(sentence, end='', flush=True)
        while b'\n' not in self._typed:
            ready = asyncio.Event()
            try:
                loop.add_reader(file, ready.set)
            except PermissionError:  # a regular file, which is always readable
                ready.set()
            try:
                await ready.wait()
            finally:
                loop.remove_reader(file)
            self._take(file)
        line, _, self._typed = self._typed.partition(b'\n')
        return line.decode(errors='replace')

    def _take(self, file: int) -> None:
        data = os.read(file, 4096)
        if not data:
            raise EOFError
        self._typed += data


def _versions() -> dict[str, str]:
    try:
        own = version('epson_driver')
    except PackageNotFoundError:  # run from a source tree
        own = 'not installed'
    return {
        'when': f'{datetime.now(UTC):%Y-%m-%d %H:%M} UTC',
        'epson_driver': own,
        'Python': platform.python_version(),
        'system': platform.platform(),
    }


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        'first_run',
        'Check a real robot step by step on its first day: listen, compare, then move slowly. '
        'Each step is explained and needs confirmation. Run the same command again to '
        'continue. Keep a hand on the E-stop. No person may be in the cell.',
        (
            'first_run robot.yaml',
            'first_run 192.168.0.1 --controller spel --robot t6_602s --file cell_3.html',
        ),
        '0 all steps done, 1 some steps remain or failed, 2 invalid arguments, 130 Ctrl-C',
    )
    add_robot_arguments(parser, 'address of the controller, or robot.yaml')
    parser.option('--file FILE', 'page with the results (default: first_run_ADDRESS.html)', Path)
    return parser
