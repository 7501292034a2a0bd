# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A server on a free port of this machine, and a link whose packets and states are recorded."""

import asyncio
import contextlib
import socket
import struct
from typing import Any

from epson_driver.link import Link
from support.event_loop import accepted, now, run, until  # noqa: F401 - for the tests


def frame(msg_type, comm_type, reply_code=0, body=b'', order='<'):
    return struct.pack(order + '4i', 12 + len(body), msg_type, comm_type, reply_code) + body


def joints(*values, comm_type=1, reply_code=0, sequence=0, order='<', real='f'):
    """Return a JOINT_POSITION frame."""
    ten = [*values, *[0.0] * (10 - len(values))]
    body = struct.pack(f'{order}i10{real}', sequence, *ten)
    return frame(10, comm_type, reply_code, body, order)


class Peer:
    """A peer in place of a controller. The test's `talk(connection)` runs for each connection.

    `received` has the bytes of all connections, `times` their start times (loop time, s).
    """

    def __init__(self, talk, port=0, family=socket.AF_INET):
        self._talk = talk
        self._tasks = set()
        self._socket = socket.create_server(('127.0.0.1', port), family=family)
        self.port = self._socket.getsockname()[1]
        self.times = []
        self.received = bytearray()

    async def __aenter__(self):
        self._server = await asyncio.start_server(self._accept, sock=self._socket)
        return self

    async def __aexit__(self, *_):
        await accepted()
        self._server.close()
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    @property
    def connections(self):
        return len(self.times)

    @property
    def busy(self):
        """Whether a link is still connected."""
        return bool(self._tasks)

    def _accept(self, reader, writer):
        self.times.append(asyncio.get_running_loop().time())
        task = asyncio.create_task(self._attend(Connection(self, reader, writer)))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _attend(self, connection):
        try:
            with contextlib.suppress(ConnectionError):
                await self._talk(connection)
        finally:
            connection.close()


class Connection:
    """One link's connection, from the peer's side; `number` counts from 1."""

    def __init__(self, peer, reader, writer):
        self.number = peer.connections
        self._peer = peer
        self._reader = reader
        self._writer = writer
        self.socket = writer.get_extra_info('socket')
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    async def send(self, *chunks):
        for data in chunks:
            self._writer.write(data)
            await self._writer.drain()

    async def receive(self, count):
        data = await self._reader.readexactly(count)
        self._peer.received += data
        return data

    async def read_frame(self):
        prefix = await self.receive(4)
        return prefix + await self.receive(struct.unpack('<i', prefix)[0])

    async def stay(self):
        """Read until the link disconnects."""
        with contextlib.suppress(ConnectionError):
            while data := await self._reader.read(4096):
                self._peer.received += data

    def reset(self):
        """Close the connection like a crashed controller."""
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack('ii', 1, 0))
        self._writer.transport.abort()

    def close(self):
        self._writer.close()


class Harness:
    """A link that runs inside `async with`, and everything that it reported."""

    def __init__(self, port, **options):
        self.packets = []
        self.changes: list[Any] = []
        self.on_packet = lambda packet: None
        self.link = Link(
            'test',
            '127.0.0.1',
            port,
            on_packet=self._take,
            on_state=lambda state, why: self.changes.append((state, why)),
            **options,
        )

    async def __aenter__(self):
        self._task = asyncio.create_task(self.link.run())
        return self

    async def __aexit__(self, *_):
        await self.stop()

    def _take(self, packet):
        self.packets.append(packet)
        self.on_packet(packet)

    async def stop(self):
        self._task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await self._task

    @property
    def running(self):
        return not self._task.done()

    @property
    def messages(self):
        return [packet.message for packet in self.packets]

    @property
    def states(self):
        return [state.value for state, _ in self.changes]

    def reasons(self, state):
        """Return the reasons for all transitions into a state."""
        return [why for entered, why in self.changes if entered.value == state]

    async def connected(self):
        await until(lambda: self.link.connected)
