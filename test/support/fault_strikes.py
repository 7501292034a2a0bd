# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What a controller is sent, and what strikes the port of Remote Ethernet that moves an arm."""

import asyncio
import contextlib
import re
from collections.abc import AsyncIterator, Awaitable, Callable
from dataclasses import dataclass
from typing import Any

from epson_driver.simple_message import (
    Framer,
    JointTrajPt,
    JointTrajPtFull,
    SpecialSequence,
    decode,
)

STAYS_S = 0.5
"""How long another client keeps the port, s."""


@dataclass
class Answers:
    """Changes the next line to the client that matches a pattern, and no other."""

    pattern: str = ''
    instead: bytes = b''

    def changed(self, data: bytes) -> bytes:
        """Return what is sent for a line."""
        if not self.pattern or not re.match(self.pattern, data.decode()):
            return data
        self.pattern = ''
        return self.instead


class Tapped:
    """The clients of a controller: what moves the arm is kept, answers can be changed."""

    def __init__(self, clients: Any, moves: list[Any]) -> None:
        self._clients = clients
        self._moves = moves
        self.answers = Answers()
        self.remote: list[Any] = []
        """The connections to the remote port that there were."""

    def __getattr__(self, name: str) -> Any:
        return getattr(self._clients, name)

    def connect(self, port: str, client: Any) -> Any:
        """Serve a client, and look at what it sends."""
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
        """Keep a point."""
        stop = getattr(message, 'sequence', None) == SpecialSequence.STOP_TRAJECTORY
        if isinstance(message, JointTrajPt | JointTrajPtFull) and not stop:
            self._moves.append(message)


def watch(controller: Any) -> list[Any]:
    """Return a list that fills with what moves the arm, as it reaches the controller."""
    moves: list[Any] = []
    tapped = Tapped(controller.clients, moves)
    if controller.profile.spel.project or controller.profile.program.interface == 'statements':
        controller.clients = tapped
        return moves
    take = controller.program.receive

    def receive(frame: Any, *rest: Any) -> Any:
        tapped.keep(decode(frame).message)
        return take(frame, *rest)

    controller.program.receive = receive
    return moves


def logged_in(controller: Any) -> list[Any]:
    """Return the connections on which a client has logged in, those that ended too."""
    return [each for each in controller.clients.remote if each.session.logged_in]


@contextlib.asynccontextmanager
async def _client(harness: Any) -> AsyncIterator[tuple[Any, Any]]:
    reader, writer = await asyncio.open_connection(*harness.driver.configuration.address)
    try:
        yield reader, writer
    finally:
        writer.close()


async def second_client(harness: Any, controller: Any) -> None:
    """Let another client try to stop the arm without a login, then to log in."""
    async with _client(harness) as (reader, writer):
        writer.write(b'$Abort\r\n')
        assert await reader.readline() == b'!Abort,11\r\n'
        writer.write(b'$Login,\r\n')
        with contextlib.suppress(ConnectionResetError):
            assert await reader.read() == b''


async def other_client_first(harness: Any, controller: Any) -> None:
    """Cut the driver off, and let another client log in before it is back, and stay a while."""
    async with _client(harness) as (reader, writer):
        for connection in logged_in(controller):
            connection.hang_up()
        writer.write(b'$Login,\r\n')
        assert await reader.readline() == b'#Login,0\r\n'
        await asyncio.sleep(STAYS_S)
        assert not harness.driver.state_link.connected
        assert any('serves one client' in why for _, why in harness.events.links)


async def logged_out(harness: Any, controller: Any) -> None:
    """Have the controller forget the login."""
    for connection in logged_in(controller):
        connection.session._dialogue.logged_in = False  # noqa: SLF001 - nothing else forgets it


async def wrong_answer(harness: Any, controller: Any) -> None:
    """Send something that nobody asked for."""
    controller.clients.answers = Answers('#GetStatus', b'#Hello,0\r\n')


async def lost_answer(harness: Any, controller: Any) -> None:
    """Lose the answer to the statement that moves the arm."""
    controller.clients.answers = Answers('.Execute')


async def lost_abort(harness: Any, controller: Any) -> None:
    """Lose the answer to STOP."""
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
"""By name, what strikes a driver and its controller."""
