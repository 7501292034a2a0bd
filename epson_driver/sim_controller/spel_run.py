# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`epson_driver spel run` and `spel test`: SPEL+ programs on the simulated controller.

In `spel run`, Print writes to stdout, and Input reads stdin. The command ends when all tasks have
ended, or one has ended with an error. Operator actions (`pendant io`, E-stop, door) use the remote
port.

In `spel test`, each function named Test… runs on a separate controller, as fast as this machine
allows. A test passes if it ends without an unhandled error. A statement such as `If x <> 3 Then
Error 8001` makes it fail.
"""

import asyncio
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field

from epson_driver.profiles.profile import load_controller_profile
from epson_driver.robots import load_robot_model
from epson_driver.sim_controller.assembly import (
    new_controller,
    program_network,
    with_all_boards,
)
from epson_driver.sim_controller.condition.states import Fault, Tasks
from epson_driver.sim_controller.core import CYCLE_PERIOD_S, Controller
from epson_driver.sim_controller.network.servers import ControllerServers, Ports
from epson_driver.sim_controller.spel_host.program_network import ProgramNetwork
from epson_driver.sim_controller.spel_host.spel_program import MAIN, SpelProgram, SpelSource
from epson_driver.sim_controller.spel_host.terminals import KeptText, Unattended
from epson_driver.spel import (
    Caller,
    Position,
    Program,
    ProgramEnvironment,
    Terminal,
)
from epson_driver.spel.code import FunctionCode

POLL_PERIOD_S = 0.02
LONGEST_S = 600.0  # maximum duration of a fast run or a test, in the controller's time

FAILED, NOT_OVER = 1, 3  # exit codes


class Console(Unattended):
    """The terminal of `spel run`: stdout, and lines typed by the user."""

    def __init__(self) -> None:
        self._typed: deque[str] = deque()

    def typed(self, line: str) -> None:
        self._typed.append(line)

    def write(self, _caller: Caller, text: str) -> None:
        sys.stdout.write(text)
        sys.stdout.flush()

    def read_line(self) -> str | None:
        return self._typed.popleft() if self._typed else None


class WaitingConsole(Console):
    """The terminal of a fast run.

    The controller's time does not advance while the terminal waits for a line.
    """

    def read_line(self) -> str | None:
        return sys.stdin.readline().removesuffix('\n') or None


class Bench:
    def __init__(self, robot: str, controller_profile: str) -> None:
        self._model = load_robot_model(robot)
        profile = load_controller_profile(controller_profile)
        self._profile = with_all_boards(profile)

    def controller(
        self,
        program: Program,
        terminal: Terminal,
        environment: ProgramEnvironment,
        starts: str = MAIN,
    ) -> tuple[Controller, ProgramNetwork]:
        network = program_network(self._profile)
        source = SpelSource(program, network, terminal, environment, starts)
        return new_controller(self._model, self._profile, spel=source), network


def run(
    program: Program,
    bench: Bench,
    remote_port: int,
    *,
    fast: bool,
    seconds: float | None,
    environment: ProgramEnvironment,
) -> int:
    """Run a program to its end, or for at most `seconds`, and return the exit code.

    `bench` creates the controller. `remote_port`: TCP port for operator actions. `fast`: run
    without ports, as fast as this machine allows. Raises OSError if a port cannot be opened.
    """
    console = WaitingConsole() if fast else Console()
    controller, network = bench.controller(program, console, environment)
    if fast:
        return _run_fast(controller, seconds or LONGEST_S)
    return asyncio.run(_run(controller, network, console, remote_port, seconds))


def _run_fast(controller: Controller, seconds: float) -> int:
    while (code := _exit_code(controller)) is None and controller.clock.now < seconds:
        _pass_time(controller, seconds)
    return _ended(controller, code)


def _pass_time(controller: Controller, until: float) -> bool:
    """Advance to the next event, or to `until`, s. Return whether an event was pending."""
    due = controller.clock.next_due
    if controller.in_motion:
        due = controller.clock.now + CYCLE_PERIOD_S
    controller.step(min(until if due is None else due, until) - controller.clock.now)
    return due is not None


async def _run(
    controller: Controller,
    network: ProgramNetwork,
    console: Console,
    remote_port: int,
    seconds: float | None,
) -> int:
    servers = ControllerServers(controller, None, network)
    ports = await servers.open('127.0.0.1', Ports(0, 0, 0, remote_port))
    listening = ' '.join(f'{name}={port}' for name, port in ports._asdict().items())
    print(f'listening {listening}', file=sys.stderr, flush=True)
    over = asyncio.Event()

    def poll() -> None:
        late = seconds is not None and controller.clock.now >= seconds
        if late or _exit_code(controller) is not None:
            over.set()

    controller.clock.every(POLL_PERIOD_S, poll, first=POLL_PERIOD_S)
    _read_stdin(console, servers)
    try:
        await servers.run_until(over)
    finally:
        await servers.close()
    return _ended(controller, _exit_code(controller))


def _read_stdin(console: Console, servers: ControllerServers) -> None:
    """Read typed lines in a thread, because stdin cannot be read asynchronously."""
    loop = asyncio.get_running_loop()

    def typed(line: str) -> None:
        with servers.pacer.present():
            console.typed(line)

    def read() -> None:
        for line in sys.stdin:
            try:
                loop.call_soon_threadsafe(typed, line.removesuffix('\n'))
            except RuntimeError:  # the loop is closed, because the program has ended
                return

    threading.Thread(target=read, daemon=True).start()


def _exit_code(controller: Controller) -> int | None:
    """Return the exit code of a program that has ended, or None.

    After an E-stop the program has not ended.
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
    print(f'still running after {controller.clock.now:.2f} s of controller time:', file=sys.stderr)
    for row in controller.tasks():
        print(f'  task {row.number} {row.name} ({row.type}): {row.state}', file=sys.stderr)
    return NOT_OVER


@dataclass(frozen=True, slots=True)
class TestResult:
    """The result of a test.

    `error`: why the test failed (empty: it passed). `seconds`: simulated duration, s.
    """

    __test__ = False

    name: str
    position: Position
    error: str
    printed: str
    seconds: float
    lines: dict[str, dict[int, bool]] = field(default_factory=dict)
    """File → line with statements → whether the test has executed it."""


def run_tests(
    program: Program, bench: Bench, names: Callable[[str], bool], environment: ProgramEnvironment
) -> Iterator[TestResult]:
    for code in program.functions:
        if code.name.lower().startswith('test') and names(code.name):
            yield run_function(program, code, bench, environment.fresh())


def run_function(
    program: Program,
    code: FunctionCode,
    bench: Bench,
    environment: ProgramEnvironment,
    max_time: float = LONGEST_S,
) -> TestResult:
    if code.parameters:
        return TestResult(code.name, code.at, 'a test cannot have parameters', '', 0.0)
    terminal = KeptText()
    controller, _ = bench.controller(program, terminal, environment, code.name)
    spel, clock = controller.program, controller.clock
    assert isinstance(spel, SpelProgram)  # noqa: S101 - the bench makes no other
    pending = True
    while pending and not spel.failure and spel.main_runs and clock.now < max_time:
        pending = _pass_time(controller, max_time)
    position, error = code.at, ''
    if spel.failure is not None:
        position = spel.failure.position
        error = f'error {spel.failure.number}: {spel.failure.text}'
    elif spel.main_runs:
        view = next(spel.machine.tasks())
        position, error = Position(view.file, view.line), 'waits for an event that cannot occur'
        if pending:
            error = f'still running after {max_time:g} s of controller time'
    printed, lines = ''.join(terminal.printed), spel.machine.lines()
    return TestResult(code.name, position, error, printed, clock.now, lines)


def covered(results: Iterable[TestResult]) -> dict[str, dict[int, bool]]:
    executed: dict[str, dict[int, bool]] = {}
    for result in results:
        for file, lines in result.lines.items():
            known = executed.setdefault(file, {})
            for line, ran in lines.items():
                known[line] = known.get(line, False) or ran
    return executed
