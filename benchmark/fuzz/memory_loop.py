# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""An event loop in virtual time with connections in memory: thousands of messages a second.

A connection is passed to the function `accept`. The loop has no sockets, threads or processes to
wait for.
"""

import asyncio
import selectors
from collections.abc import Callable
from typing import Any

START_S = 1000.0
TURN_S = 1e-6
"""Duration of a turn of the loop, s, so that no timer is due repeatedly without progress."""


class MemoryTransport(asyncio.Transport):
    """One end of a connection. `on_bytes` and `on_end` represent the other end."""

    def __init__(self, loop: asyncio.AbstractEventLoop, protocol: Any) -> None:
        super().__init__()
        self._loop = loop
        self._protocol = protocol
        self._closing = False
        self._paused = False
        self._hung_up = False
        self._waiting: list[bytes | None] = []
        """Data that has not been read yet. None: EOF."""
        self.on_bytes: Callable[[bytes], None] = lambda data: None
        self.on_end: Callable[[], None] = lambda: None

    # the controller's end

    def feed(self, data: bytes) -> None:
        """Deliver bytes, unless the connection was closed by `hang_up`."""
        if data and not self._hung_up:
            self._arrive(data)

    def hang_up(self, error: Exception | None = None) -> None:
        """Close the connection from the controller's side.

        An error takes effect immediately. Otherwise the data sent before is delivered first.
        """
        if error is not None:
            self._end(error)
        elif not self._hung_up:
            self._hung_up = True
            self._arrive(None)

    def _arrive(self, data: bytes | None) -> None:
        if self._paused:
            self._waiting.append(data)
        else:
            self._hand_over(data)

    def _hand_over(self, data: bytes | None) -> None:
        if self._closing:
            return
        if data is None:
            if not self._protocol.eof_received():
                self.close()
            return
        if not isinstance(self._protocol, asyncio.BufferedProtocol):
            self._protocol.data_received(data)
            return
        while data and not self._closing:
            buffer = memoryview(self._protocol.get_buffer(len(data)))
            taken, data = data[: len(buffer)], data[len(buffer) :]
            buffer[: len(taken)] = taken
            self._protocol.buffer_updated(len(taken))

    # what asyncio calls

    def write(self, data: Any) -> None:
        """Pass bytes to the other end."""
        if not self._closing:
            self.on_bytes(bytes(data))

    def close(self) -> None:
        """Close the connection."""
        self._end(None)

    def abort(self) -> None:
        """Close the connection."""
        self._end(None)

    def is_closing(self) -> bool:
        """Return whether it is closed."""
        return self._closing

    def get_write_buffer_size(self) -> int:
        """Return 0: the other end has read everything."""
        return 0

    def pause_reading(self) -> None:
        """Pause reading and store further data."""
        self._paused = True

    def resume_reading(self) -> None:
        """Resume reading and deliver the stored data."""
        self._paused = False
        while self._waiting and not self._paused:
            self._hand_over(self._waiting.pop(0))

    def is_reading(self) -> bool:
        """Return whether received data is delivered."""
        return not self._paused

    def _end(self, error: Exception | None) -> None:
        if not self._closing:
            self._closing = True
            self._loop.call_soon(self._protocol.connection_lost, error)
            self.on_end()


class _Selector(selectors.DefaultSelector):
    """Advances the time instead of waiting."""

    loop: 'MemoryLoop'

    def select(self, timeout: float | None = None) -> list[Any]:
        if timeout is None:
            raise RuntimeError('nothing is left to wait for')
        self.loop.now += max(timeout, 0.0)
        return []


class MemoryLoop(asyncio.SelectorEventLoop):
    """The loop. `accept` receives the port and the transport, or raises ConnectionRefusedError."""

    def __init__(self) -> None:
        self.now = START_S
        self.accept: Callable[[int, MemoryTransport], None]
        self.turns = 0
        selector = _Selector()
        selector.loop = self
        super().__init__(selector)

    def time(self) -> float:
        """Return the virtual time, s."""
        return self.now

    async def create_connection(self, protocol_factory: Any, *address: Any, **_: Any) -> Any:
        """Connect to the port in memory."""
        await asyncio.sleep(0)
        protocol = protocol_factory()
        transport = MemoryTransport(self, protocol)
        self.accept(address[1], transport)
        protocol.connection_made(transport)
        return transport, protocol

    def _run_once(self) -> None:
        self.now += TURN_S
        self.turns += 1
        super()._run_once()  # type: ignore[misc]
