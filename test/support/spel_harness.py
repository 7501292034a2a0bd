# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""SPEL+ programs on a host whose ports, buttons and arm a test plays."""

from collections.abc import Sequence
from textwrap import dedent
from typing import Any

from epson_driver.spel import (
    ErrorNumber,
    Machine,
    MotionRequest,
    NetSettings,
    SpelError,
    Timing,
    Value,
    build,
)
from epson_driver.spel.bare_host import BareHost
from epson_driver.spel.values import Array, Point


class Motion:
    """A motion, or motors being switched: over when the test says so."""

    def __init__(self, request: MotionRequest | None = None) -> None:
        self.request = request
        self.done = False
        self.share = 0.0
        self.error: SpelError | None = None


class Peer:
    """Who is at the other end of a port."""

    def __init__(self, settings: NetSettings, server: bool) -> None:
        self.settings = settings
        self.server = server
        self.there = False
        self.incoming = b''
        self.sent = b''


class ScriptedHost(BareHost):
    """A bare host with peers on its ports, and motions that take as long as the test wants."""

    def __init__(self) -> None:
        super().__init__()
        self.peers: dict[int, Peer] = {}
        self.slow = False
        self.running: list[Motion] = []
        self.commands: list[tuple[str, tuple[object, ...], tuple[str, ...]]] = []
        self.pauses: list[bool] = []
        self.library: list[tuple[str, str, list[object]]] = []
        self.button: int | None = 2

    @property
    def text(self) -> str:
        """Return all that was printed."""
        return ''.join(self.printed)

    def message_box(self, caller, text, buttons, title):
        """Return the button as soon as the test has one."""
        return self.button

    def open_net(self, port: int, settings: NetSettings, server: bool) -> None:
        self.peers[port] = Peer(settings, server)

    def close_net(self, port: int) -> None:
        self.peers.pop(port, None)

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

    def command(self, name, arguments, words):
        self.commands.append((name, tuple(arguments), words))
        super().command(name, arguments, words)
        if self.slow:
            self.running.append(Motion())
            return self.running[-1]
        return None

    def move(self, request: MotionRequest) -> Motion:
        super().move(request)
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

    def paused(self, on: bool) -> bool:
        self.pauses.append(on)
        return True


def files(source: str, **others: str) -> dict[str, str]:
    """Return a project with main.prg and other files (name_inc is name.inc)."""
    named = {name.replace('_inc', '.inc').replace('_prg', '.prg'): t for name, t in others.items()}
    return {'main.prg': dedent(source).lstrip('\n'), **named}


def machine(source: str, host: BareHost | None = None, **timing: Any) -> Machine:
    """Return a machine for a program, without any task yet."""
    made = Timing(**timing)
    return Machine(build(files(source)), host or ScriptedHost(), made)


def run(source: str, seconds: float = 10.0, host: ScriptedHost | None = None) -> ScriptedHost:
    """Run main of a program for a time; return its host."""
    host = host or ScriptedHost()
    made = machine(source, host)
    made.start()
    made.advance(seconds)
    return host


def printed(body: str, declarations: str = '', before: str = '') -> list[str]:
    """Return the lines that the statements of a main print; no error may end it."""
    lines = '\n'.join(f'  {line.strip()}' for line in dedent(body).strip().splitlines())
    source = f'{before}\n{declarations}\nFunction main\n{lines}\nFend\n'
    host = run(source)
    assert host.failures == [], [str(failure) for failure in host.failures]
    return host.text.splitlines()


def value(expression: str, declarations: str = '') -> str:
    """Return what Print shows of an expression."""
    lines = printed(f'Print {expression}', declarations)
    assert len(lines) == 1
    return lines[0]
