# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Ports of one program that are each other's peers: a client of the TCP port that one serves."""

from epson_driver.spel.errors import ErrorNumber, SpelError
from epson_driver.spel.host import NetSettings


class _End:
    """One open port, and what has come for it."""

    def __init__(self, settings: NetSettings, server: bool) -> None:
        self.tcp_port = settings.tcp_port
        self.server = server
        self.peer: _End | None = None
        self.met = False
        """Whether it has, or had, a peer: it must be opened again for the next one."""
        self.unread = bytearray()


class Loopback:
    """All ports of a program, without any network."""

    def __init__(self) -> None:
        self._ends: dict[int, _End] = {}

    def open_net(self, port: int, settings: NetSettings, server: bool) -> None:
        """Serve a TCP port, or look for who serves it."""
        self.close_net(port)
        end = self._ends[port] = _End(settings, server)
        for other in self._ends.values():
            fits = other.tcp_port == end.tcp_port and other.server != server
            if fits and not other.met and end.tcp_port:
                end.peer, other.peer = other, end
                end.met = other.met = True
                return

    def close_net(self, port: int) -> None:
        """Close a port: its peer is alone."""
        end = self._ends.pop(port, None)
        if end is not None and end.peer is not None:
            end.peer.peer = None

    def connected(self, port: int) -> bool:
        """Return whether a port has a peer."""
        return port in self._ends and self._ends[port].peer is not None

    def received(self, port: int) -> bytes:
        """Return what has come and is not taken."""
        return bytes(self._ends[port].unread) if port in self._ends else b''

    def take(self, port: int, count: int) -> bytes:
        """Take the first bytes of it."""
        if port not in self._ends:
            return b''
        unread = self._ends[port].unread
        data = bytes(unread[:count])
        del unread[:count]
        return data

    def send(self, port: int, data: bytes) -> None:
        """Send to the peer. Raises SpelError 2902."""
        end = self._ends.get(port)
        if end is None or end.peer is None:
            raise SpelError(ErrorNumber.NETWORK, f'port {port} has no peer')
        end.peer.unread += data
