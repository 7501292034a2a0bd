# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A controller's ports in memory and in virtual time: thousands of messages a second."""

import asyncio
from collections.abc import Callable
from typing import Any

from simulation.network import HOST, Network
from simulation.virtual_loop import VirtualLoop

DELAY_S = 1e-6
"""Transit time of bytes, s."""


class ServedEnd(asyncio.Protocol):
    """The controller's end of a connection. `on_bytes` and `on_end` are called by the network."""

    transport: Any

    def __init__(self) -> None:
        self.on_bytes: Callable[[bytes], None] = lambda data: None
        self.on_end: Callable[[], None] = lambda: None

    def connection_made(self, transport: Any) -> None:
        """Keep the transport."""
        self.transport = transport

    def data_received(self, data: bytes) -> None:
        """Pass bytes to the controller."""
        self.on_bytes(data)

    def connection_lost(self, _error: Exception | None) -> None:
        """Report the end of the connection."""
        self.on_end()

    def feed(self, data: bytes) -> None:
        """Send bytes, unless the connection is closed."""
        if not self.transport.is_closing():
            self.transport.write(data)

    def hang_up(self, *, reset: bool = False) -> None:
        """Close the connection, after the data sent before or by a reset."""
        self.transport.lingers = not reset
        (self.transport.abort if reset else self.transport.close)()


def listen(loop: VirtualLoop, port: int, accept: Callable[[ServedEnd], None]) -> None:
    """Listen on a port, and pass each connection to `accept`."""
    listener = loop.network.create_server((HOST, port))

    def connected() -> None:
        end = ServedEnd()
        listener.accept()[0].attach(end, loop)
        accept(end)

    listener.watch(loop, connected, ())


def new_loop() -> VirtualLoop:
    """Return a loop with a network that has no ports yet."""
    return VirtualLoop(Network(lambda: DELAY_S))
