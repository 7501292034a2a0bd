# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""TCP in memory, indistinguishable from the system's for driver and controller.

Bytes arrive in order, after a delay, or not at all while a port is stalled. A connection ends by a
FIN after the data sent, or by a reset that drops unread data. Unread data counts as unsent at the
other end once the system's buffers would be full.
"""

import asyncio
import errno
import socket
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from contextvars import Context, ContextVar, copy_context
from typing import Any

PROCESS: ContextVar[str] = ContextVar('process', default='')
"""The process of a callback, or '' for the world itself."""

HOST = '127.0.0.1'
FIRST_PORT = 20000
BUFFER_BYTES = 32_768
"""Capacity of the system's buffers in one direction."""

CHUNK_BYTES = 16_384
"""Maximum number of bytes that arrive together."""

HIGH_WATER_BYTES = 65_536
"""Unsent bytes above which a protocol must pause writing, like in asyncio."""


class Network:
    """All listening ports and connections. Attributes may be changed at any time.

    `delay(port)` draws the transit time of bytes, s. `stalled`: ports on which bytes of both
    directions are held and connection attempts wait.
    """

    def __init__(self, delay: Callable[[], float]) -> None:
        self.delay = delay
        self.stalled: set[int] = set()
        self.listeners: dict[int, Listener] = {}
        self.ends: list[End] = []
        self.flips: dict[int, Callable[[bytes], bytes]] = {}
        """Port → function for the next bytes sent by the controller on it, applied once."""
        self._next_port = FIRST_PORT
        self._waiting: list[asyncio.Future[None]] = []

    def create_server(self, address: tuple[str, int], **_: Any) -> 'Listener':
        """Listen, as `socket.create_server`. Raises OSError if the port is in use."""
        port = address[1] or self.new_port()
        if port in self.listeners:
            raise OSError(errno.EADDRINUSE, 'Address already in use')
        self.listeners[port] = listener = Listener(self, port)
        return listener

    def new_port(self) -> int:
        self._next_port += 1
        return self._next_port

    async def connect(self, host: str, port: int) -> 'Socket':
        """Return the client's side of a new connection. Raises ConnectionRefusedError."""
        await asyncio.sleep(self.delay())
        while port in self.stalled:
            waiting = asyncio.get_running_loop().create_future()
            self._waiting.append(waiting)
            await waiting
        listener = self.listeners.get(port)
        if listener is None:
            text = f'Connect call failed {(host, port)}'
            raise ConnectionRefusedError(errno.ECONNREFUSED, text)
        own, others = Socket(self, port, self.new_port()), Socket(self, port, 0)
        own.end, others.end = End(self, port, at_server=False), End(self, port, at_server=True)
        own.end.process = PROCESS.get()  # it may die before it is served
        own.end.peer, others.end.peer = others.end, own.end
        others.number = own.number
        self.ends += [own.end, others.end]
        listener.arrived(others)
        return own

    def stall(self, port: int) -> None:
        self.stalled.add(port)

    def release(self, port: int) -> None:
        self.stalled.discard(port)
        for end in list(self.ends):
            end.flush()
        waiting, self._waiting = self._waiting, []
        for item in waiting:
            if not item.done():
                item.set_result(None)

    def reset(self, port: int) -> None:
        """Reset the connections of a port, like a network device that has lost its state."""
        for end in [item for item in self.ends if item.port == port]:
            end.receive_reset()

    def half_close(self, port: int) -> None:
        """Send EOF to the controller for its clients of a port. It continues to read."""
        for end in [item for item in self.ends if item.port == port and item.at_server]:
            end.receive_eof()

    def process_died(self, process: str) -> None:
        """Close the connections of a process, as the system does."""
        for end in [item for item in self.ends if item.process == process]:
            end.vanish()


class Listener:
    """A listening socket, with the methods used by PortServer."""

    def __init__(self, network: Network, port: int) -> None:
        self._network = network
        self._port = port
        self._queue: deque[Socket] = deque()
        self._watch: tuple[Any, Callable[..., Any], tuple[Any, ...], Context] | None = None

    def watch(self, loop: Any, callback: Callable[..., Any], args: tuple[Any, ...]) -> None:
        self._watch = (loop, callback, args, copy_context())
        for _ in self._queue:
            self._call()

    def forget(self) -> None:
        self._watch = None

    def arrived(self, sock: 'Socket') -> None:
        self._queue.append(sock)
        self._call()

    def _call(self) -> None:
        if self._watch is not None:
            loop, callback, args, context = self._watch
            loop.call_soon(self._called, callback, args, context=context)

    def _called(self, callback: Callable[..., Any], args: tuple[Any, ...]) -> None:
        if self._watch is not None and self._queue:
            callback(*args)

    def accept(self) -> tuple['Socket', tuple[str, int]]:
        """Return the next connection and its address. Raises BlockingIOError."""
        if not self._queue:
            raise BlockingIOError(errno.EAGAIN, 'nobody waits')
        sock = self._queue.popleft()
        return sock, (HOST, sock.number)

    def getsockname(self) -> tuple[str, int]:
        return HOST, self._port

    def setsockopt(self, *_: Any) -> None: ...

    def setblocking(self, _flag: bool) -> None: ...

    def close(self) -> None:
        self._network.listeners.pop(self._port, None)
        for sock in self._queue:
            sock.close()
        self._queue.clear()
        self.forget()


class Socket:
    """One side of a connection before it has a transport, and its options after that."""

    type = socket.SOCK_STREAM
    end: 'End'

    def __init__(self, network: Network, port: int, number: int) -> None:
        self.network = network
        self.port = port
        self.number = number

    def attach(self, protocol: Any, loop: Any) -> 'End':
        self.end.attach(protocol, loop, self)
        return self.end

    def setsockopt(self, _level: int, option: int, _value: Any) -> None:
        """Record whether closing sends a reset."""
        if option == socket.SO_LINGER:
            self.end.lingers = False

    def fileno(self) -> int:
        return -1 if self.end.is_closing() else self.number

    def close(self) -> None:
        self.end.vanish()


class End(asyncio.Transport):
    """One end of a connection. Its data is delivered to the peer's protocol."""

    peer: 'End'
    _loop: Any

    def __init__(self, network: Network, port: int, *, at_server: bool) -> None:
        super().__init__()
        self.port = port
        self.at_server = at_server
        self.lingers = True
        self.process = ''
        self._network = network
        self._protocol: Any = None
        self._context: Context | None = None
        self._socket: Socket | None = None
        self._inbox: deque[bytes | None] = deque()
        self._under_way = 0
        """Bytes written by this end and not yet read by the peer."""
        self._last_arrival = 0.0
        self._paused = False
        self._asked_to_pause = False
        self._closing = False
        self._gone = False
        self._eof_sent = False
        self._ended = False
        """Whether a FIN has been received."""
        self._flushing = False

    def attach(self, protocol: Any, loop: Any, sock: Socket) -> None:
        self._protocol, self._loop, self._socket = protocol, loop, sock
        self._context = copy_context()
        self.process = PROCESS.get()
        protocol.connection_made(self)
        if self._gone and not self._closing:  # it was reset before
            self._lose(_reset_error())
        self.flush()

    # --- as a transport --------------------------------------------------------------------

    def write(self, data: Any) -> None:
        if self._closing or self._gone or self._eof_sent or not data:
            return
        data = bytes(data)
        if self.at_server and self.port in self._network.flips:
            data = self._network.flips.pop(self.port)(data)
        self._under_way += len(data)
        for at in range(0, len(data), CHUNK_BYTES):
            self._send(data[at : at + CHUNK_BYTES])
        if not self._asked_to_pause and self.get_write_buffer_size() > HIGH_WATER_BYTES:
            self._asked_to_pause = True
            self._protocol.pause_writing()

    def writelines(self, list_of_data: Any) -> None:
        self.write(b''.join(list_of_data))

    def write_eof(self) -> None:
        if not self._eof_sent and not self._closing:
            self._eof_sent = True
            self._send(None)

    def can_write_eof(self) -> bool:
        return True

    def close(self) -> None:
        if not self._closing:
            self.write_eof()
            self._lose(None)

    def abort(self) -> None:
        """Close the connection immediately, by a reset if its socket does not linger."""
        if self._closing:
            return
        if self.lingers:
            self.close()
        else:
            self.peer.receive_reset()
            self._lose(None)

    def is_closing(self) -> bool:
        return self._closing

    def pause_reading(self) -> None:
        self._paused = True

    def resume_reading(self) -> None:
        self._paused = False
        self.flush()

    def is_reading(self) -> bool:
        return not self._paused and not self._closing

    def get_write_buffer_size(self) -> int:
        """Return the number of bytes beyond the system's buffers."""
        return max(self._under_way - BUFFER_BYTES, 0)

    def get_write_buffer_limits(self) -> tuple[int, int]:
        return HIGH_WATER_BYTES // 4, HIGH_WATER_BYTES

    def set_write_buffer_limits(self, high: int | None = None, low: int | None = None) -> None: ...

    def set_protocol(self, protocol: Any) -> None:
        self._protocol = protocol

    def get_protocol(self) -> Any:
        return self._protocol

    def get_extra_info(self, name: str, default: Any = None) -> Any:
        number = self._socket.number if self._socket else 0
        ends = (HOST, self.port), (HOST, number)
        own, other = ends if self.at_server else ends[::-1]
        return {'socket': self._socket, 'sockname': own, 'peername': other}.get(name, default)

    # --- received data -----------------------------------------------------------------------

    def receive_eof(self) -> None:
        self._arrive(None)

    def receive_reset(self) -> None:
        """Receive a reset. Unread data is lost."""
        if self._gone:
            return
        self._inbox.clear()
        self._gone = True
        if self._protocol is not None and not self._closing:
            self._lose(_reset_error())

    def vanish(self) -> None:
        """Close the end without notifying the protocol, as the system does."""
        if not self._closing:
            self._closing = self._gone = True
            if not self._eof_sent:
                self._send(None)
            self._forget()

    def flush(self) -> None:
        """Deliver received data to the protocol, in a separate turn of the loop."""
        if self._inbox and self._protocol is not None and not self._flushing:
            self._flushing = True
            self._loop.call_soon(self._hand_over, context=self._context)

    def _send(self, data: bytes | None) -> None:
        loop = asyncio.get_running_loop()
        arrival = max(loop.time() + self._network.delay(), self._last_arrival + 1e-9)
        self._last_arrival = arrival
        loop.call_at(arrival, self.peer._arrive, data, context=Context())  # noqa: SLF001

    def _arrive(self, data: bytes | None) -> None:
        if self._ended:  # nothing is read after a FIN
            return
        self._ended = data is None
        if self._gone or self._closing:
            if data is not None and self._closing:
                self.peer.receive_reset()  # the receiver is gone
            return
        self._inbox.append(data)
        self.flush()

    def _hand_over(self) -> None:
        self._flushing = False
        while self._inbox and not self._paused and not self._closing:
            if self.port in self._network.stalled:
                return
            data = self._inbox.popleft()
            if data is None:
                if not self._protocol.eof_received():
                    self.close()
                return
            self._take(data)
            self.peer._read(len(data))  # noqa: SLF001

    def _take(self, data: bytes) -> None:
        if isinstance(self._protocol, asyncio.BufferedProtocol):
            while data:
                buffer = memoryview(self._protocol.get_buffer(-1))
                size = min(len(buffer), len(data))
                buffer[:size] = data[:size]
                self._protocol.buffer_updated(size)
                data = data[size:]
        else:
            self._protocol.data_received(data)

    def _read(self, size: int) -> None:
        self._under_way -= size
        if self._asked_to_pause and self.get_write_buffer_size() <= HIGH_WATER_BYTES // 4:
            self._asked_to_pause = False
            if not self._closing:
                self._protocol.resume_writing()

    def _lose(self, error: Exception | None) -> None:
        self._closing = True
        self._loop.call_soon(self._protocol.connection_lost, error, context=self._context)
        self._forget()

    def _forget(self) -> None:
        with suppress(ValueError):
            self._network.ends.remove(self)


def _reset_error() -> ConnectionResetError:
    return ConnectionResetError(errno.ECONNRESET, 'Connection reset by peer')
