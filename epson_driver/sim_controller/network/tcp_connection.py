# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""One client's TCP connection, from the controller's side."""

import asyncio
import ipaddress
import logging
import socket
import struct
from contextlib import suppress

CHUNK_BYTES = 4096

KEEPALIVE = {'TCP_KEEPIDLE': 1, 'TCP_KEEPINTVL': 1, 'TCP_KEEPCNT': 3, 'TCP_USER_TIMEOUT': 3000}
"""Socket options that detect the loss of a peer after about 4 s, if the system supports them."""

_log = logging.getLogger(__name__)


class TcpConnection:
    """The connection with one client.

    A client that does not read is disconnected when more than `max_unsent` bytes are queued. This
    bounds the memory, and no client receives stale data.
    """

    def __init__(
        self,
        name: str,
        reader: asyncio.StreamReader,
        writer: asyncio.StreamWriter,
        max_unsent: int,
        chunk: int = CHUNK_BYTES,
    ) -> None:
        host, port = writer.get_extra_info('peername')[:2]
        self.name = f'{name} client {host}:{port}'
        self.local = _is_loopback(host)
        self._reader = reader
        self._writer = writer
        self._max_unsent = max_unsent
        self._chunk = chunk
        sock: socket.socket = writer.get_extra_info('socket')
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        for option, value in KEEPALIVE.items():
            if hasattr(socket, option):
                sock.setsockopt(socket.IPPROTO_TCP, getattr(socket, option), value)

    @property
    def closed(self) -> bool:
        return self._writer.transport.is_closing()

    def send(self, data: bytes) -> None:
        if self.closed:
            return
        self._writer.write(data)
        if self._writer.transport.get_write_buffer_size() > self._max_unsent:
            _log.warning('%s does not read: disconnected', self.name)
            self.abort()

    async def receive(self) -> bytes:
        """Return the next bytes, or b'' if the client has closed the connection or is lost."""
        try:
            return await self._reader.read(self._chunk)
        except OSError as error:
            _log.info('%s: %s', self.name, error)
            return b''

    async def lost(self) -> None:
        with suppress(OSError):
            await self._writer.wait_closed()

    def close(self) -> None:
        """Close the connection. Unsent bytes are dropped, because their client does not read."""
        if self._writer.transport.get_write_buffer_size():
            self.abort()
        else:
            self._writer.close()

    def abort(self) -> None:
        """Close immediately. Unsent bytes are dropped, including bytes in the system's buffers."""
        sock: socket.socket = self._writer.get_extra_info('socket')
        if sock.fileno() >= 0:
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack('ii', 1, 0))
        self._writer.transport.abort()


def _is_loopback(host: str) -> bool:
    address = ipaddress.ip_address(host.partition('%')[0])  # an IPv6 address may name its zone
    mapped = address.ipv4_mapped if isinstance(address, ipaddress.IPv6Address) else None
    return (mapped or address).is_loopback
