# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Play the controller's side of a recording over sockets, once."""

import asyncio
import functools
import socket
import struct
from collections.abc import Callable

from epson_driver.socket_errors import reason
from epson_driver.trace.player import Order, Player
from epson_driver.trace.script import Kind, Script

WAITING_NOTICE_S = 2.0
"""After how long a message says what the player is waiting for, s."""

RESET_AT_CLOSE = struct.pack('ii', 1, 0)
"""Of SO_LINGER: without it the system closes a connection in order, which a client sees."""


async def play(
    player: Player,
    script: Script,
    host: str,
    ports: dict[str, int],
    stop: asyncio.Event,
    tell: Callable[[str], object],
) -> None:
    """Serve a script at ports of a host until it is over, which sets `stop`, or that is set.

    `tell` is called with sentences for a person. Raises OSError that names the port.
    """
    loop = asyncio.get_running_loop()
    playback = _Playback(player, stop)
    servers: dict[str, asyncio.Server] = {}
    for role, port in ports.items():
        connection = functools.partial(_Connection, playback, script.ports[role])
        try:
            servers[role] = await loop.create_server(connection, host, port)
        except OSError as error:
            raise OSError(f'{role} port {host}:{port}: {reason(error)}') from error
    open_ports = {role: each.sockets[0].getsockname()[1] for role, each in servers.items()}
    print('listening', *(f'{role}={port}' for role, port in open_ports.items()), flush=True)
    telling = asyncio.create_task(_tell_what_is_missing(player, tell))
    await stop.wait()
    telling.cancel()
    for server in servers.values():
        server.close()
    playback.close()
    await asyncio.sleep(0)  # let the transports close


async def _tell_what_is_missing(player: Player, tell: Callable[[str], object]) -> None:
    before = told = ''
    while True:
        await asyncio.sleep(WAITING_NOTICE_S)
        missing = player.waits_for
        if missing and missing == before and missing != told:
            tell(f'waiting for {missing}')
            told = missing
        before = missing


class _Playback:
    """Runs the player against the clock, and carries out its orders on the connections."""

    def __init__(self, player: Player, stop: asyncio.Event) -> None:
        self.player = player
        self._stop = stop
        self._loop = asyncio.get_running_loop()
        self._timer: asyncio.TimerHandle | None = None
        self._transports: dict[int, asyncio.Transport] = {}

    def connect(self, port: int, transport: asyncio.Transport) -> int | None:
        """Return the number of the recorded connection that a new one plays, or None."""
        number = self.player.connect(port, self._loop.time())
        if number is not None:
            self._transports[number] = transport
        return number

    def leave(self, number: int) -> None:
        """Forget a connection that is gone."""
        if self._transports.pop(number, None) is not None:
            self.player.leave(number)
            self.go_on()

    def go_on(self) -> None:
        """Carry out the orders that are due, and schedule the next ones."""
        if self._timer is not None:
            self._timer.cancel()
        for order in self.player.advance(self._loop.time()):
            self._obey(order)
        if self.player.done:
            self._stop.set()
            return
        pause = self.player.wait()
        if pause is not None:
            self._timer = self._loop.call_later(pause, self.go_on)

    def close(self) -> None:
        """Close all connections."""
        if self._timer is not None:
            self._timer.cancel()
        for transport in self._transports.values():
            transport.close()
        self._transports.clear()

    def _obey(self, order: Order) -> None:
        if order.kind is Kind.SEND:
            self._transports[order.connection].write(order.data)
            return
        transport = self._transports.pop(order.connection)
        if order.kind is Kind.RESET:
            sock: socket.socket = transport.get_extra_info('socket')
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, RESET_AT_CLOSE)
            transport.abort()
        else:
            transport.close()


class _Connection(asyncio.Protocol):
    """A client on one of the ports."""

    def __init__(self, playback: _Playback, port: int) -> None:
        self._playback = playback
        self._port = port
        self._number: int | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Start playing, or close the connection if the recording has none for it."""
        assert isinstance(transport, asyncio.Transport)  # noqa: S101 - for the type checker
        self._number = self._playback.connect(self._port, transport)
        if self._number is None:
            transport.close()
        else:
            self._playback.go_on()

    def data_received(self, data: bytes) -> None:
        """Hand the bytes of the client to the player."""
        if self._number is not None and self._playback.player.plays(self._number):
            self._playback.player.receive(self._number, data)
            self._playback.go_on()

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget the connection."""
        if self._number is not None:
            self._playback.leave(self._number)
