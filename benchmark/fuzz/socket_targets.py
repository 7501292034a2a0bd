# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Fuzzing through real sockets: the processes `sim_controller` and `client`, and the panel's page.

Properties of whole processes are checked here: resident memory, log lines, the exit code.
"""

import asyncio
import http.client
import random
import socket
import struct
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from benchmark.fuzz import messages
from benchmark.fuzz.messages import Chance
from benchmark.fuzz.runner import PAGE_BYTES, Figures
from epson_driver.processes import processes
from epson_driver.processes.processes import Ports, Process
from epson_driver.simple_message import (
    Framer,
    JointTrajPt,
    JointTrajPtFull,
    SimpleMessageError,
    SpecialSequence,
    decode,
)

HERE = '127.0.0.1'
PATIENCE_S = 120.0
MAX_GROWTH_BYTES = 25_000_000
LINES_AT_ONCE, LINES_PER_S = 2_000, 60.0
"""Maximum log lines of a process. A log call is limited to 20 lines, then one a second, and some
dozens of them exist."""

PER_CONNECTION = 60
SAFE_COMMANDS = (
    'Login',
    'Logout',
    'GetStatus',
    'GetIO',
    'SetIO',
    'GetMotor',
    'Sim,io',
    'Nonsense',
)
"""Commands that switch no motors on."""


def controller(inputs: int, seed: int) -> Figures:
    """Fuzz the process sim_controller with its motors off. Its arm must not move."""
    chance, figures = random.Random(f'{seed}/controller'), Figures()
    with tempfile.TemporaryDirectory() as folder:
        process = processes.sim_controller(Path(folder, 'log'), '--motion=ptp')
        with processes.ended_at_exit(process):
            ports = process.ports()
            stood = _joints(ports.state)
            _flood(ports, chance, max(inputs // 10, 200), Figures())  # first-use allocations
            before, began = _resident(process), time.monotonic()
            _flood(ports, chance, inputs, figures)
            figures.seconds = time.monotonic() - began
            _check(process, before, figures)
            if _joints(ports.state) != stood:
                figures.found.append('the arm of the process sim_controller has moved')
            if code := process.end():
                figures.found.append(f'sim_controller ended with {code}')
    return figures


def _flood(ports: Ports, chance: Chance, inputs: int, figures: Figures) -> None:
    until = time.monotonic() + PATIENCE_S + inputs / 50.0
    while figures.inputs < inputs and time.monotonic() < until:
        port = chance.choice(('motion', 'motion', 'motion', 'state', 'io', 'remote'))
        with suppress(OSError), socket.create_connection((HERE, getattr(ports, port))) as sock:
            sock.settimeout(0.2)
            for _ in range(PER_CONNECTION):
                figures.inputs += 1
                if port == 'remote':
                    data = messages.command(chance, SAFE_COMMANDS)
                else:
                    data = messages.message(chance)
                sock.sendall(messages.mutated(chance, data) if chance.random() < 0.7 else data)
            with suppress(TimeoutError):
                sock.recv(65_536)
        figures.cases += 1


def _joints(port: int) -> bytes:
    """Return the body of the next joint position, once the port serves a client."""
    until = time.monotonic() + PATIENCE_S
    while True:
        with suppress(OSError), socket.create_connection((HERE, port), timeout=10.0) as sock:
            framer = Framer()
            while data := sock.recv(4096):
                framer.receive_data(data)
                while (frame := framer.next_frame()) is not None:
                    if frame.msg_type == 10:
                        return frame.body
        if time.monotonic() > until:
            raise TimeoutError(f'no joint position on port {port}')
        time.sleep(0.1)


def client(inputs: int, seed: int) -> Figures:
    """Fuzz the process client without any command. It must send no point."""
    figures = Figures()
    with tempfile.TemporaryDirectory() as folder:
        asyncio.run(_fuzz_client(inputs, random.Random(f'{seed}/client'), figures, Path(folder)))
    return figures


async def _fuzz_client(inputs: int, chance: Chance, figures: Figures, folder: Path) -> None:
    peer = _FuzzingController(chance, figures)
    servers = [
        await asyncio.start_server(serve, HERE, 0)
        for serve in (peer.motion, peer.state, peer.remote)
    ]
    motion, state, remote = (item.sockets[0].getsockname()[1] for item in servers)
    process = processes.client(
        folder / 'log',
        Ports(motion, state, 0, remote),
        processes.free_ros_domain(),
        state_timeout=30.0,
    )
    with processes.ended_at_exit(process):
        async with asyncio.timeout(PATIENCE_S):
            await peer.came.wait()
        warm = max(inputs // 10, 200)
        while figures.inputs < warm:  # noqa: ASYNC110 - only a count to wait for
            await asyncio.sleep(0.05)
        before, figures.inputs, began = _resident(process), 0, time.monotonic()
        while figures.inputs < inputs and process.returncode is None:  # noqa: ASYNC110
            await asyncio.sleep(0.05)
        figures.seconds = time.monotonic() - began
        _check(process, before, figures)
        if code := await asyncio.to_thread(process.end):
            figures.found.append(f'client ended with {code}:\n{process.log_text()[-2000:]}')
    for server in servers:
        server.close()


class _FuzzingController:
    """Serves unexpected data to a driver."""

    def __init__(self, chance: Chance, figures: Figures) -> None:
        self.came = asyncio.Event()
        self._chance = chance
        self._figures = figures

    async def state(self, _reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Send states: valid, of other types, and mutated."""
        self.came.set()
        chance = self._chance
        with suppress(OSError):
            for _ in range(chance.choice((5, 50, 500, 2000))):
                self._figures.inputs += 1
                kinds = messages.STATES if chance.random() < 0.8 else ()
                data = messages.message(chance, kinds)
                writer.write(messages.mutated(chance, data) if chance.random() < 0.3 else data)
                await writer.drain()
                await asyncio.sleep(0.0 if chance.random() < 0.9 else 0.005)
        writer.close()

    async def motion(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Send unrequested replies, and check for points without a command."""
        framer, chance = Framer(), self._chance
        with suppress(OSError, SimpleMessageError):
            for _ in range(chance.choice((5, 50, 500))):
                self._figures.inputs += 1
                data = messages.message(chance)
                writer.write(messages.mutated(chance, data) if chance.random() < 0.5 else data)
                await writer.drain()
                with suppress(TimeoutError):
                    async with asyncio.timeout(0.005):
                        framer.receive_data(await reader.read(4096))
                while (frame := framer.next_frame()) is not None:
                    self._look(decode(frame).message)
        writer.close()

    def _look(self, message: object) -> None:
        if not isinstance(message, JointTrajPt | JointTrajPtFull):
            return
        if message.sequence != SpecialSequence.STOP_TRAJECTORY:
            self._figures.found.append(f'nobody commanded it, and the client sent {message}')

    async def remote(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Answer lines, validly or not."""
        with suppress(OSError):
            while line := await reader.readline():
                self._figures.inputs += 1
                writer.write(messages.answer(self._chance, line))
        writer.close()


def _resident(process: Process) -> int:
    text = Path(f'/proc/{process.process_id}/statm').read_text(encoding='ascii')
    return int(text.split()[1]) * PAGE_BYTES


def _check(process: Process, before: int, figures: Figures) -> None:
    """Check that a process is alive, has not grown, and has not logged too much."""
    if process.returncode is not None:
        text = process.log_text()[-2000:]
        figures.found.append(f'{process.name} ended with {process.returncode}:\n{text}')
        return
    grown = _resident(process) - before
    if grown > MAX_GROWTH_BYTES:
        figures.found.append(f'{process.name} grew by {grown / 1e6:.1f} MB')
    log = process.log_text()
    if 'Traceback' in log:
        figures.found.append(f'{process.name} wrote a traceback:\n{log[-2000:]}')
    lines = log.count('\n')
    if lines > LINES_AT_ONCE + LINES_PER_S * figures.seconds:
        figures.found.append(f'{process.name} wrote {lines} lines in {figures.seconds:.0f} s')


REQUEST = (
    b'GET / HTTP/1.1\r\nHost: 127.0.0.1:%d\r\nConnection: close\r\n\r\n',
    b'GET / HTTP/1.1\r\nHost: 127.0.0.1:%d\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n'
    b'Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n'
    b'Origin: http://127.0.0.1:%d\r\n\r\n',
)
TEXTS = (
    b'POST', b'../../etc/passwd', b'HTTP/9.9', b'Host: evil.example', b'Content-Length: -1',
    b'Content-Length: 99999999', b'Transfer-Encoding: chunked', b'\r\n\r\n', b'\x00' * 64,
    b'A' * 70_000, b'Cookie: token=' + b'x' * 5000, b'Origin: null',
)  # fmt: skip


def panel(inputs: int, seed: int) -> Figures:
    """Fuzz the panel's web server with nearly valid HTTP requests and websocket frames."""
    figures = Figures()
    try:
        from epson_driver.panel.requests import message_of
        from epson_driver.panel.web_server import WebServer
    except ImportError:  # the panel is not installed
        return figures
    listener = _Listener(message_of)
    chance, server = (
        random.Random(f'{seed}/panel'),
        WebServer(HERE, 0, None, listener, listener.fail),
    )
    began = time.monotonic()
    try:
        for _ in range(max(inputs // 20, 20)):
            figures.inputs += 1
            with suppress(OSError), socket.create_connection((HERE, server.port), 10.0) as sock:
                sock.settimeout(0.05)
                sock.sendall(_web_request(chance, server.port))
                with suppress(TimeoutError):
                    sock.recv(65_536)
                if chance.random() < 0.5:  # a frame: length, mask and payload
                    size = chance.choice((0, 1, 125, 126, 127))
                    head = struct.pack('BB', chance.randrange(256), 128 | size)
                    sock.sendall(head + chance.randbytes(chance.choice((4, 200, 5000))))
        connection = http.client.HTTPConnection(HERE, server.port, timeout=PATIENCE_S)
        connection.request('GET', '/')
        if (status := connection.getresponse().status) != 200:
            figures.found.append(f'the page answers {status} afterwards')
        connection.close()
        if not server.alive:
            figures.found.append('the thread that serves the page has ended')
        figures.found += [f'{what}: {error!r}' for what, error in listener.failed]
    except (OSError, http.client.HTTPException) as error:
        figures.found.append(f'the page does not answer afterwards: {error}')
    finally:
        server.stop()
    figures.seconds = time.monotonic() - began
    return figures


class _Listener:
    """Decodes the windows' messages, and records failures."""

    def __init__(self, read: Callable[[str | bytes], object]) -> None:
        self.failed: list[tuple[str, BaseException]] = []
        self._read = read

    def add(self, window: Any) -> None:
        """Ignore the window."""

    def remove(self, window: Any) -> None:
        """Ignore the window."""

    def received(self, _window: Any, text: str | bytes) -> None:
        """Decode a request."""
        self._read(text)

    def fail(self, what: str, error: BaseException) -> None:
        """Record a failure."""
        self.failed.append((what, error))


def _web_request(chance: Chance, port: int) -> bytes:
    data = chance.choice(REQUEST).replace(b'%d', b'%d' % port)
    for _ in range(chance.randrange(4)):
        at = chance.randrange(len(data))
        draw = chance.random()
        if draw < 0.4:
            data = data[:at] + chance.choice(TEXTS) + data[at:]
        elif draw < 0.7:
            data = data[:at] + chance.randbytes(chance.choice((1, 4, 40))) + data[at:]
        else:
            data = data[:at]
            break
    return data or b'\r\n'


TARGETS: dict[str, Callable[[int, int], Figures]] = {
    'process sim_controller, all ports': controller,
    'process client': client,
    "the panel's page": panel,
}
