# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Recording of commands that reach a controller, and faults of its Remote Ethernet port."""

import asyncio
import contextlib
import re
from collections.abc import AsyncIterator, Awaitable, Callable
from dataclasses import dataclass
from typing import Any

from epson_driver.rtmc.messages import Request
from epson_driver.simple_message import (
    Framer,
    JointTrajPt,
    JointTrajPtFull,
    SpecialSequence,
    decode,
)

STAYS_S = 0.5
"""Time for which another client occupies the port, s."""


@dataclass
class Answers:
    """A replacement for the next line to the client that matches a pattern."""

    pattern: str = ''
    instead: bytes = b''

    def changed(self, data: bytes) -> bytes:
        """Return the bytes to send in place of a line."""
        if not self.pattern or not re.match(self.pattern, data.decode()):
            return data
        self.pattern = ''
        return self.instead


class Tapped:
    """The clients of a controller, with recorded moves and replaceable answers."""

    def __init__(self, clients: Any, moves: list[Any]) -> None:
        self._clients = clients
        self._moves = moves
        self.answers = Answers()
        self.remote: list[Any] = []
        """All connections to the remote port."""

    def __getattr__(self, name: str) -> Any:
        return getattr(self._clients, name)

    def connect(self, port: str, client: Any) -> Any:
        """Serve a client, and record its moves."""
        if port == 'remote':
            send = client.send

            def changed(data: bytes) -> None:
                if data := self.answers.changed(data):
                    send(data)

            client.send = changed
        session = self._clients.connect(port, client)
        if port == 'remote':
            self.remote.append(session)
        look = {'motion': self._points(), 'remote': self._statements}.get(port)
        if look is not None:
            take = session.receive

            def receive(data: bytes) -> None:
                look(data)
                take(data)

            session.receive = receive
        return session

    def _points(self) -> Callable[[bytes], None]:
        framer = Framer()

        def look(data: bytes) -> None:
            framer.receive_data(data)
            while (got := framer.next_frame()) is not None:
                self.keep(decode(got).message)

        return look

    def _statements(self, data: bytes) -> None:
        self._moves += re.findall(r'(?:Go|Move|Arc3) [^"]*', data.decode())

    def keep(self, message: Any) -> None:
        """Record a point."""
        stop = getattr(message, 'sequence', None) == SpecialSequence.STOP_TRAJECTORY
        if isinstance(message, JointTrajPt | JointTrajPtFull) and not stop:
            self._moves.append(message)


def _motions(port: Any, moves: list[Any]) -> dict[int, Any]:
    """Return the requests of real-time motion, and record those that let the arm move."""
    changes = dict(port._CHANGES)  # noqa: SLF001 - no other place sees the requests
    set_mode = changes[Request.SET_MODE]

    def record(port: Any, request: Any) -> None:
        moves.extend([request] * bool(request.low))
        set_mode(port, request)

    return changes | {Request.SET_MODE: record}


def watch(controller: Any) -> list[Any]:
    """Return a list that collects the moves as they reach the controller."""
    moves: list[Any] = []
    tapped = Tapped(controller.clients, moves)
    if controller.profile.spel.project or controller.profile.program.interface == 'statements':
        controller.clients = tapped
        return moves
    if controller.real_time is not None:
        controller.real_time._CHANGES = _motions(controller.real_time, moves)  # noqa: SLF001
        return moves
    take = controller.program.receive

    def receive(frame: Any, *rest: Any) -> Any:
        tapped.keep(decode(frame).message)
        return take(frame, *rest)

    controller.program.receive = receive
    return moves


def logged_in(controller: Any) -> list[Any]:
    """Return the connections, including ended ones, on which a client has logged in."""
    return [connection for connection in controller.clients.remote if connection.session.logged_in]


@contextlib.asynccontextmanager
async def _client(harness: Any) -> AsyncIterator[tuple[Any, Any]]:
    reader, writer = await asyncio.open_connection(*harness.driver.configuration.address)
    try:
        yield reader, writer
    finally:
        writer.close()


async def second_client(harness: Any, controller: Any) -> None:
    """Try to stop the arm without a login and then to log in, as another client."""
    async with _client(harness) as (reader, writer):
        writer.write(b'$Abort\r\n')
        assert await reader.readline() == b'!Abort,11\r\n'
        writer.write(b'$Login,\r\n')
        with contextlib.suppress(ConnectionResetError):
            assert await reader.read() == b''


async def other_client_first(harness: Any, controller: Any) -> None:
    """Disconnect the driver, and log in as another client for a while before it reconnects."""
    async with _client(harness) as (reader, writer):
        for connection in logged_in(controller):
            connection.hang_up()
        writer.write(b'$Login,\r\n')
        assert await reader.readline() == b'#Login,0\r\n'
        await asyncio.sleep(STAYS_S)
        assert not harness.driver.state_link.connected
        assert any('another Remote Ethernet client' in why for _, why in harness.events.links)


async def logged_out(harness: Any, controller: Any) -> None:
    """Reset the login at the controller."""
    for connection in logged_in(controller):
        connection.session._dialogue.logged_in = False  # noqa: SLF001 - no other reset


async def wrong_answer(harness: Any, controller: Any) -> None:
    """Send an unsolicited line."""
    controller.clients.answers = Answers('#GetStatus', b'#Hello,0\r\n')


async def lost_answer(harness: Any, controller: Any) -> None:
    """Drop the answer to the statement that moves the arm."""
    controller.clients.answers = Answers('.Execute')


async def lost_abort(harness: Any, controller: Any) -> None:
    """Drop the answer to STOP."""
    controller.clients.answers = Answers('.Abort')


STRIKES: dict[str, Callable[[Any, Any], Awaitable[None]]] = {
    strike.__name__: strike
    for strike in (
        second_client,
        other_client_first,
        logged_out,
        wrong_answer,
        lost_answer,
        lost_abort,
    )
}
"""Faults of a driver and its controller by name."""
