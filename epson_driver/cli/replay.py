# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`epson_driver replay`: plays the controller's side of a recorded run, for bug reports."""

import argparse
import asyncio
import contextlib
import functools
import socket
import struct
import sys
from pathlib import Path

from epson_driver.cli.arguments import FREE_PORT, argument, host, if_in_use
from epson_driver.cli.interrupt import ended_by_signals
from epson_driver.inputs import InputError, number, printable
from epson_driver.socket_errors import reason
from epson_driver.trace.pcap import PcapError
from epson_driver.trace.player import Order, Player, Score
from epson_driver.trace.recording import read_recording
from epson_driver.trace.script import ROLES, Kind, Script, ScriptError, make_script

WAITING_NOTICE_S = 2.0
"""After how long a message says what the player is waiting for, s."""

RESET_AT_CLOSE = struct.pack('ii', 1, 0)
"""Of SO_LINGER: without it the system closes a connection in order, which a client sees."""


def main() -> int:
    """Play a file once. Returns 0 if the client did all that was recorded and nothing else."""
    parser = _parser()
    args = parser.parse_args()
    try:
        script = make_script(read_recording(args.file), args.controller)
    except (PcapError, ScriptError) as error:
        parser.error(printable(f'{args.file}: {error}'))
    except InputError as error:
        parser.error(str(error))
    player = Player(script, args.speed, _tell)
    asked = {role: getattr(args, f'{role}_port') for role in ROLES}
    ports = {
        role: port if asked[role] is None else asked[role] for role, port in script.ports.items()
    }
    try:
        asyncio.run(_run(player, script, args.host, ports))
    except OSError as error:
        print(f'epson_driver replay: {error}{if_in_use(error.__cause__)}', file=sys.stderr)
        return 2
    score = player.finish()
    print(_report(score))
    return 0 if score.unknown == score.missing == 0 else 1


async def _run(player: Player, script: Script, host: str, ports: dict[str, int]) -> None:
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    with ended_by_signals(loop, stop.set):
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
        telling = asyncio.create_task(_tell_what_is_missing(player))
        await stop.wait()
        telling.cancel()
        for server in servers.values():
            server.close()
        playback.close()
        await asyncio.sleep(0)  # let the transports close


async def _tell_what_is_missing(player: Player) -> None:
    before = told = ''
    while True:
        await asyncio.sleep(WAITING_NOTICE_S)
        missing = player.waits_for
        if missing and missing == before and missing != told:
            _tell(f'waiting for {missing}')
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


def _report(score: Score) -> str:
    requests = score.same + score.alike
    return '\n'.join(
        (
            f'requests: {requests} as recorded ({score.same} to the byte), '
            f'{score.unknown} not recorded, {score.missing} missing',
            f'messages: {score.sent} sent, {score.repeated} repeated while waiting, '
            f'{score.left_out} left out',
        )
    )


def _tell(text: str) -> None:
    with contextlib.suppress(BrokenPipeError):
        print(f'epson_driver replay: {text}', file=sys.stderr, flush=True)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog='epson_driver replay',
        description="Plays the controller's side of a recorded run once. Exit code 0: the client "
        'did exactly what was recorded; 1: it did not; 2: the file cannot be played.',
        allow_abbrev=False,
    )
    parser.add_argument('file', type=Path, metavar='FILE', help='a trace, or a pcap of tcpdump')
    parser.add_argument(
        '--host', type=host, default='127.0.0.1', help='address to listen on (%(default)s)'
    )
    for role in ROLES:
        text = f'{role} port, 0 for any free one (the recorded one)'
        parser.add_argument(f'--{role}-port', type=argument(FREE_PORT), metavar='PORT', help=text)
    parser.add_argument(
        '--speed',
        type=argument(number(0.01, 100.0)),
        default=1.0,
        metavar='FACTOR',
        help='how many times as fast as recorded (%(default)s)',
    )
    parser.add_argument(
        '--controller', metavar='ADDRESS', help='which controller to play, if the file has several'
    )
    return parser
