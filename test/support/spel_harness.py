# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""SPEL+ programs on a host with ports, buttons and an arm controlled by the test."""

from collections.abc import Sequence
from textwrap import dedent
from typing import Any

from epson_driver.sim_controller.spel_run import Bench, TestResult, run_function
from epson_driver.spel import (
    Caller,
    Completion,
    ErrorNumber,
    Machine,
    Memory,
    MotionRequest,
    NetSettings,
    ProgramEnvironment,
    SpelError,
    TaskError,
    Timing,
    Value,
    build,
)
from epson_driver.spel.values import Array, Point


class Motion:
    """A motion or a switching of motors that the test ends."""

    def __init__(self, request: MotionRequest | None = None) -> None:
        self.request = request
        self.done = False
        self.fraction = 0.0
        self.error: SpelError | None = None


class Peer:
    """The peer of a port."""

    def __init__(self, settings: NetSettings, server: bool) -> None:
        self.settings = settings
        self.server = server
        self.there = False
        self.incoming = b''
        self.sent = b''


SPEL_SETTINGS = {
    'speed': 5,
    'accel': 5,
    'speeds': 50,
    'accels': 200,
    'speedfactor': 100,
    'tool': 0,
    'limz': 0,
    'cp': 0,
    'arm': 0,
    'robot': 1,
}


class ScriptedHost:
    """A host that stores settings, with peers on its ports and motions ended by the test."""

    def __init__(self) -> None:
        self.terminal = self.network = self
        self.printed: list[str] = []
        self.typed: list[str] = []
        self.failures: list[TaskError] = []
        self.bits: dict[Memory, dict[int, int]] = {memory: {} for memory in Memory}
        self.states: dict[str, int] = {}
        """Return values of functions that are not computed."""
        self.settings: dict[str, tuple[float, ...]] = {}
        self.motors = self.power = False
        self.here = Point('xy', (0.0,) * 6)
        self.moves: list[MotionRequest] = []
        self.peers: dict[int, Peer] = {}
        self.slow = False
        self.running: list[Motion] = []
        self.commands: list[tuple[str, tuple[object, ...], tuple[str, ...]]] = []
        self.machine: Machine | None = None
        self.library: list[tuple[str, str, list[object]]] = []
        self.button: int | None = 2

    @property
    def text(self) -> str:
        """Return all that was printed."""
        return ''.join(self.printed)

    def write(self, _caller: Caller, text: str) -> None:
        self.printed.append(text)

    def read_line(self) -> str | None:
        return self.typed.pop(0) if self.typed else None

    def message_box(self, caller, text, buttons, title):
        """Return the button as soon as the test has one."""
        return self.button

    def open_net(self, port: int, settings: NetSettings, server: bool) -> None:
        self.peers[port] = Peer(settings, server)

    def close_net(self, port: int) -> None:
        self.peers.pop(port, None)

    def release_owner(self, _port: int) -> None:
        pass

    def connected(self, port: int) -> bool:
        return port in self.peers and self.peers[port].there

    def received(self, port: int) -> bytes:
        return self.peers[port].incoming if port in self.peers else b''

    def take(self, port: int, count: int) -> bytes:
        peer = self.peers[port]
        taken, peer.incoming = peer.incoming[:count], peer.incoming[count:]
        return taken

    def send(self, port: int, data: bytes) -> None:
        peer = self.peers[port]
        if not peer.there:
            raise SpelError(ErrorNumber.NETWORK)
        peer.sent += data

    def read_bits(self, memory: Memory, index: int, width: int) -> int:
        if index < 0:
            raise SpelError(ErrorNumber.ARGUMENT)
        bits = self.bits[memory]
        return sum(bits.get(index * width + item, 0) << item for item in range(width))

    def write_bits(self, memory: Memory, index: int, width: int, value: int) -> None:
        for item in range(width):
            self.bits[memory][index * width + item] = value >> item & 1

    def value(self, name: str, arguments: Sequence[int | float | Point]) -> float | Point | str:
        if name in ('here', 'curpos', 'realpos', 'findpos', 'tlset'):
            return self.here
        if name == 'ljm':
            return arguments[0]
        if name in ('cx', 'cy', 'cz', 'cu', 'cv', 'cw'):
            (point,) = arguments
            if not isinstance(point, Point) or point.kind != 'xy':
                raise SpelError(ErrorNumber.ARGUMENT)
            return point.values['xyzuvw'.index(name[1])]
        if name in ('motor', 'power'):
            return int(self.motors if name == 'motor' else self.power)
        if name in SPEL_SETTINGS:
            values = self.settings.get(name) or (SPEL_SETTINGS[name],)
            which = int(arguments[0]) if arguments else 1  # type: ignore[arg-type]
            return values[min(which, len(values)) - 1]
        return self.states.get(name, '' if name.endswith('$') else 0)

    def command(self, name, arguments, words):
        self.commands.append((name, tuple(arguments), words))
        if name == 'motor':
            self.motors = 'on' in words
        elif name == 'power':
            self.power = 'high' in words
        numbers = [float(argument) for argument in arguments if isinstance(argument, int | float)]
        self.settings[name] = tuple(numbers) if name != 'cp' else (float('on' in words),)
        if self.slow:
            self.running.append(Motion())
            return self.running[-1]
        return None

    def move(self, request: MotionRequest) -> Completion:
        if not self.motors:
            raise SpelError(4031, 'motion attempted with the motors off')
        self.moves.append(request)
        self.here = request.points[-1]
        self.running.append(Motion(request))
        self.running[-1].done = not self.slow
        return self.running[-1]

    def stored_point(self, point: Point) -> Point:
        return point

    def call_library(self, library: str, name: str, arguments: Sequence[Value | Array]) -> int:
        self.library.append((library, name, list(arguments)))
        for argument in arguments:
            if isinstance(argument, Array):
                argument.d[0] = 77
        return 5

    def task_failed(self, error: TaskError) -> None:
        self.failures.append(error)

    def paused(self, on: bool) -> None:
        if not on and self.machine is not None:
            self.machine.resume()


SCARA = Bench('t3_401s', 'simulated')


def on_controller(source: str, around: ProgramEnvironment | None = None) -> TestResult:
    """Run main on a simulated controller, for 60 s at most."""
    program = build({'main.prg': source})
    main = program.by_name['main']
    return run_function(program, main, SCARA, around or ProgramEnvironment(), max_time=60.0)


def files(source: str, **others: str) -> dict[str, str]:
    """Return a project with main.prg and other files (name_inc is name.inc)."""
    named = {name.replace('_inc', '.inc').replace('_prg', '.prg'): t for name, t in others.items()}
    return {'main.prg': dedent(source).lstrip('\n'), **named}


def machine(source: str, host: ScriptedHost | None = None, **timing: Any) -> Machine:
    """Return a machine for a program, without any task yet."""
    host = host or ScriptedHost()
    host.machine = Machine(build(files(source)), host, Timing(**timing))
    return host.machine


def run(source: str, seconds: float = 10.0, host: ScriptedHost | None = None) -> ScriptedHost:
    """Run main of a program for a time, and return its host."""
    host = host or ScriptedHost()
    made = machine(source, host)
    made.start()
    made.advance(seconds)
    return host


def printed(body: str, declarations: str = '', before: str = '') -> list[str]:
    """Return the lines printed by the statements of a main, which must not fail."""
    lines = '\n'.join(f'  {line.strip()}' for line in dedent(body).strip().splitlines())
    source = f'{before}\n{declarations}\nFunction main\n{lines}\nFend\n'
    host = run(source)
    assert host.failures == [], [str(failure) for failure in host.failures]
    return host.text.splitlines()


def value(expression: str, declarations: str = '') -> str:
    """Return the printed value of an expression."""
    lines = printed(f'Print {expression}', declarations)
    assert len(lines) == 1
    return lines[0]
