# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The transport of Real-time Motion Control: a Fast DDS participant of interfaces/epson_rtmc.

A thread of this library receives all messages. During a motion it also sends the targets.
"""

import asyncio
import contextlib
import ctypes
import os
import select
import socket
import sys
import weakref
from collections.abc import Awaitable, Callable, Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

from epson_driver.motion import Array
from epson_driver.rtmc.messages import MAX_MESSAGE_BYTES

LIBRARY = 'libepson_rtmc.so'

COMMANDS, REPLIES = b'RTMC_CMD', b'RTMC_RES'
"""DDS partitions of requests, and of replies and notices."""

CONTROLLER_PORT = 7000
"""UDP port at which a controller is discovered."""

DISCOVERY_TIMEOUT_S = 3.0
DISCOVERY_PERIOD_S = 0.05

MAX_ARRIVALS_PER_TURN = 50
"""Maximum number of arrivals that are handled before other callbacks of the event loop run."""

OWN = 0
REFUSED, FAILED = -1, -2  # results of epson_rtmc_write, and of epson_rtmc_take


class TransportError(Exception):
    """The transport is missing, or cannot be opened. The text gives the remedy."""


class Arrival(NamedTuple):
    """A message of a peer, and its time of arrival, s.

    `data` is None if the peer has left, or has been silent for the lease of 1 s. The messages of
    this side have the sender OWN. They are reported only to a trace.
    """

    sender: int
    data: bytes | None
    time: float


@cache
def library() -> ctypes.CDLL:
    prefixes = [sys.prefix, *os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)]
    paths = [path for prefix in prefixes if (path := Path(prefix, 'lib', LIBRARY)).is_file()]
    if not paths:
        raise TransportError(
            'Real-time Motion Control needs the package epson_rtmc: with ROS 2 from Python wheels '
            'run make, or pip install ./interfaces/epson_rtmc; otherwise colcon build '
            '--base-paths src/epson_driver src/epson_driver/interfaces, with rmw_fastrtps_cpp'
        )
    try:
        found = ctypes.CDLL(str(paths[0]))
    except OSError as error:
        raise TransportError(f'Real-time Motion Control: {error}: source your ROS 2') from error
    number, index, text = ctypes.c_uint32, ctypes.c_uint64, ctypes.c_char_p
    handle, values = ctypes.c_void_p, ctypes.c_void_p
    for name, result, *arguments in (
        ('open', handle, text, number, number, text, number, text, text),
        ('without_dds', handle, handle),
        ('receive', None, handle, text, number, ctypes.c_double, index),
        ('event', ctypes.c_int, handle),
        ('matched', ctypes.c_int, handle),
        ('write', ctypes.c_int, handle, text, number),
        ('request', ctypes.c_int, handle, text, number),
        ('start', ctypes.c_int, handle, values),
        ('replace', ctypes.c_int, handle, index, values, number, number),
        ('trace', None, handle, ctypes.c_int),
        ('end', None, handle),
        ('taken', index, handle),
        ('take', ctypes.c_int, handle, text, number, values, values),
        ('quiet', None, handle, ctypes.c_int),
        ('close', None, handle),
    ):
        try:
            function = getattr(found, f'epson_rtmc_{name}')
        except AttributeError as error:
            raise TransportError(f'{paths[0]} is too old: build epson_rtmc again') from error
        function.restype, function.argtypes = result, arguments
    return found


class Transport:
    """One side of a connection. It uses only the network interface that has `address`.

    With a `peer` it is the client's side. Otherwise it is the controller's side, which listens at
    `port`. All methods run in one thread.
    """

    def __init__(self, address: str, port: int = 0, peer: tuple[str, int] | None = None) -> None:
        """Open the transport. Raises TransportError if this is not possible."""
        opened = library()
        try:  # Fast DDS would select another port, or no network, without an error
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
                free.bind((address, port))
        except OSError as error:
            raise TransportError(f'no DDS participant at {address}:{port}: {error}') from error
        host, peer_port = (None, 0) if peer is None else (peer[0].encode(), peer[1])
        partitions = (REPLIES, COMMANDS) if peer is None else (COMMANDS, REPLIES)
        if peer is not None:
            self.addresses = (address, peer[1] + 1), peer
        handle = opened.epson_rtmc_open(address.encode(), port, 0, host, peer_port, *partitions)
        if not handle:
            raise TransportError(f'no DDS participant at {address}:{port}: see the log')
        self._use(handle)

    addresses: tuple[tuple[str, int], tuple[str, int]] | None = None
    """Addresses of the client and of the controller in a trace. The client's port is invented."""

    def _use(self, handle: int) -> None:
        self._library = library()
        self._handle: int | None = handle
        # A thread that outlives the interpreter would use a Fast DDS that is destroyed.
        self._at_exit = weakref.finalize(self, self._library.epson_rtmc_close, handle)
        self._buffer = ctypes.create_string_buffer(MAX_MESSAGE_BYTES)
        self._sender, self._time = ctypes.c_uint64(), ctypes.c_double()
        self._loop: asyncio.AbstractEventLoop | None = None

    def _call(self, name: str, *arguments: object) -> int:
        """Call a function of the library. Return 0 if the transport is closed."""
        if self._handle is None:
            return 0
        result: int | None = getattr(self._library, f'epson_rtmc_{name}')(self._handle, *arguments)
        if result == REFUSED and name != 'take':
            raise TransportError('Fast DDS refused a message')
        return result or 0

    @property
    def matched(self) -> bool:
        """Whether a peer is connected."""
        return bool(self._call('matched'))

    def write(self, data: bytes) -> bool:
        """Send a message. Return whether a peer is connected.

        Without a peer, nothing is sent. Raises TransportError if Fast DDS refuses the message.
        """
        return bool(self._call('write', data, len(data)))

    # The client's exchange with a controller.

    def request(self, data: bytes) -> bool:
        """Send a request after the replies to all earlier ones. Returns as `write` does."""
        return bool(self._call('request', data, len(data)))

    def start(self, target: Array) -> None:
        """Start to send targets, one after each reply: first this one, until others are given.

        target: joints in the units of a message, shape (JOINTS,). Requests precede targets.
        """
        self._call('start', target.ctypes.data)

    def replace(self, first: int, targets: Array, planned: int) -> bool:
        """Replace targets (see `Ring`). targets: shape (m, JOINTS), C-contiguous."""
        return bool(self._call('replace', first, targets.ctypes.data, len(targets), planned))

    def trace(self, on: bool) -> None:
        """Report the messages of this side as arrivals, too, or no longer."""
        self._call('trace', int(on))

    def end(self) -> None:
        """Stop sending targets."""
        self._call('end')

    @property
    def taken(self) -> int:
        """Number of targets that were sent, without repetitions."""
        return self._call('taken')

    # Arrivals.

    def listen(
        self, on_arrival: Callable[[Arrival], None], on_failure: Callable[[Exception], None]
    ) -> None:
        """Call `on_arrival` in the event loop for each message, and for the loss of a peer."""

        def arrived() -> None:
            try:
                for _ in range(MAX_ARRIVALS_PER_TURN):
                    if (arrival := self.take()) is None:
                        break
                    on_arrival(arrival)
            except Exception as error:  # noqa: BLE001 - the owner raises it
                on_failure(error)

        self._loop = asyncio.get_running_loop()
        self._loop.add_reader(self._call('event'), arrived)

    def poll(self, *, quiet: bool) -> Iterator[Arrival]:
        """Yield all messages that have arrived. If `quiet`, later ones wait for the next poll."""
        self._call('quiet', int(quiet))
        return iter(self.take, None)

    def take(self, timeout: float = 0.0) -> Arrival | None:
        """Return the next message, or the loss of a peer. Return None after `timeout` s.

        Raises TransportError after a failure of the library.
        """
        if timeout:
            select.select([self._call('event')], [], [], timeout)
        sender, time = ctypes.byref(self._sender), ctypes.byref(self._time)
        size = self._call('take', self._buffer, MAX_MESSAGE_BYTES, sender, time)
        if not size:
            return None
        if size == FAILED:
            raise TransportError('the thread of Real-time Motion Control has failed')
        data = ctypes.string_at(self._buffer, size) if size > 0 else None
        return Arrival(self._sender.value, data, self._time.value)

    def _released(self) -> int | None:
        if self._loop is not None:
            self._loop.remove_reader(self._call('event'))
        self._loop = None
        self._at_exit.detach()
        handle, self._handle = self._handle, None
        return handle

    def close(self) -> None:
        """Close the transport and notify the peer. Repeated calls are allowed."""
        if (handle := self._released()) is not None:
            self._library.epson_rtmc_close(handle)

    async def aclose(self) -> None:
        """Close the transport like `close`, but without blocking the event loop."""
        if (handle := self._released()) is not None:
            await asyncio.shield(asyncio.to_thread(self._library.epson_rtmc_close, handle))


Connect = Callable[[str, int], Awaitable[Transport]]
"""connect(host, port) may raise TransportError."""


async def connect(host: str, port: int) -> Transport:
    """Open the client's side of the transport to a controller. Raises TransportError."""
    opening = asyncio.create_task(asyncio.to_thread(_opened, host, port))
    try:
        return await asyncio.shield(opening)
    except asyncio.CancelledError:  # the controller serves one participant only
        with contextlib.suppress(TransportError):
            (await opening).close()
        raise


def _opened(host: str, port: int) -> Transport:
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as route:
            route.connect((host, port))
            own, peer = route.getsockname()[0], route.getpeername()[0]
    except OSError as error:
        raise TransportError(f'{host}: {error}') from error
    return Transport(own, peer=(peer, port))


async def is_there(host: str, port: int) -> bool:
    """Return whether a controller is discovered, without a message. Raises TransportError."""
    transport = await connect(host, port)
    try:
        async with asyncio.timeout(DISCOVERY_TIMEOUT_S):
            while not transport.matched:  # noqa: ASYNC110 - no event tells
                await asyncio.sleep(DISCOVERY_PERIOD_S)
        return True
    except TimeoutError:
        return False
    finally:
        await transport.aclose()
