# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`epson_driver spel run`: a SPEL+ program on the simulated controller, in the terminal.

Print goes to stdout, Input reads stdin. It ends when all tasks are over, or an error has ended
one. What people do at the controller (`pendant io`, E-stop, door) comes over the remote port.
"""

import asyncio
import sys
import threading
from collections import deque
from collections.abc import Mapping
from dataclasses import replace

from epson_driver.profiles.profile import load_controller_profile
from epson_driver.robots import load_robot_model
from epson_driver.sim_controller.assembly import SpelSource, new_controller, program_network
from epson_driver.sim_controller.condition.states import Fault, Tasks
from epson_driver.sim_controller.core import CYCLE_PERIOD_S, Controller
from epson_driver.sim_controller.network.servers import ControllerServers, Ports
from epson_driver.sim_controller.spel_host.terminals import CANCEL
from epson_driver.spel import Caller, Surroundings, build, with_defines, with_setup

LOOK_S = 0.02
"""How often it is looked at whether the program is over, s of the controller's time."""

ALL_BITS, ALL_FLAGS = 4096, 1024
"""Inputs, outputs; memory bits: no file of a project tells which boards a controller has."""

FAILED, NOT_OVER = 1, 3
"""Exit codes: a task has ended with an error; the time was over before the program."""


class Console:
    """The terminal that the command was started in."""

    def __init__(self) -> None:
        self._typed: deque[str] = deque()

    def typed(self, line: str) -> None:
        """Keep a line that a person has typed."""
        self._typed.append(line)

    def write(self, _caller: Caller, text: str) -> None:
        """Print."""
        sys.stdout.write(text)
        sys.stdout.flush()

    def read_line(self) -> str | None:
        """Return the next line that was typed."""
        return self._typed.popleft() if self._typed else None

    def message_box(self, caller: Caller, text: str, _buttons: int, title: str) -> int | None:
        """Show the text and answer Cancel."""
        self.write(caller, f'MsgBox {title}: {text} (answered with Cancel)\n')
        return CANCEL


class WaitingConsole(Console):
    """The same where time stands still while a person types."""

    def read_line(self) -> str | None:
        """Wait for a line, or None at the end of the input."""
        return sys.stdin.readline().removesuffix('\n') or None


def run(
    project: Mapping[str, str],
    defines: Mapping[str, str],
    robot: str,
    controller_profile: str,
    remote_port: int,
    *,
    fast: bool,
    seconds: float | None,
    around: Surroundings,
    setup: str = '',
) -> int:
    """Run a program to its end or for a time, and return the exit code.

    `fast`: as fast as this machine can, without ports. `setup`: statements that main begins with.
    Raises OSError, InputError, ProgramError.
    """
    files = with_defines(project, dict(defines))
    files = with_setup(files, setup) if setup else files
    model = load_robot_model(robot)
    profile = load_controller_profile(controller_profile)
    boards = replace(
        profile.io, digital_inputs=ALL_BITS, digital_outputs=ALL_BITS, flags=ALL_FLAGS
    )
    profile = replace(profile, io=boards)
    console = WaitingConsole() if fast else Console()
    source = SpelSource(build(files), program_network(profile), console, around)
    controller = new_controller(model, profile, spel=source)
    if fast:
        return _run_fast(controller, seconds or 600.0)
    return asyncio.run(_run(controller, source, console, remote_port, seconds))


def _run_fast(controller: Controller, seconds: float) -> int:
    """Let the controller's time pass as fast as this machine can."""
    while (code := _exit_code(controller)) is None and controller.clock.now < seconds:
        controller.step(CYCLE_PERIOD_S)
    return _ended(controller, code)


async def _run(
    controller: Controller,
    source: SpelSource,
    console: Console,
    remote_port: int,
    seconds: float | None,
) -> int:
    servers = ControllerServers(controller, None, source.network)
    ports = await servers.open('127.0.0.1', Ports(0, 0, 0, remote_port))
    listening = ' '.join(f'{name}={port}' for name, port in ports._asdict().items())
    print(f'listening {listening}', file=sys.stderr, flush=True)
    over = asyncio.Event()

    def look() -> None:
        late = seconds is not None and controller.clock.now >= seconds
        if late or _exit_code(controller) is not None:
            over.set()

    controller.clock.every(LOOK_S, look, first=LOOK_S)
    _read_stdin(console, servers)
    try:
        await servers.run_until(over)
    finally:
        await servers.close()
    return _ended(controller, _exit_code(controller))


def _read_stdin(console: Console, servers: ControllerServers) -> None:
    """Read typed lines in a thread, as a terminal allows no other way."""
    loop = asyncio.get_running_loop()

    def typed(line: str) -> None:
        with servers.pacer.present():
            console.typed(line)

    def read() -> None:
        for line in sys.stdin:
            try:
                loop.call_soon_threadsafe(typed, line.removesuffix('\n'))
            except RuntimeError:  # the loop is closed: the program is over
                return

    threading.Thread(target=read, daemon=True).start()


def _exit_code(controller: Controller) -> int | None:
    """Return the exit code of a program that is over, or None while it is not.

    Tasks that an E-stop has ended can be started again.
    """
    condition = controller.condition
    if condition.fault is not Fault.NONE:
        return FAILED
    background = any(row.type == 'background' for row in controller.tasks())
    over = condition.tasks is Tasks.STOPPED and not controller.in_motion and not background
    return 0 if over else None


def _ended(controller: Controller, code: int | None) -> int:
    if code is not None:
        return code
    print(f'not over after {controller.clock.now:.2f} s of the controller:', file=sys.stderr)
    for row in controller.tasks():
        print(f'  task {row.number} {row.name} ({row.type}): {row.state}', file=sys.stderr)
    return NOT_OVER
