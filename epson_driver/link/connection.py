# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A TCP connection that converts received bytes to packets, and a receive timeout.

The connection is an asyncio protocol and not a stream, because a protocol handles received data
without waking a task first.
"""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Protocol

from epson_driver.simple_message import ByteOrder, FrameError, SimpleMessageError
from epson_driver.socket_errors import reason

SLICES = 8  # of a ReceiveTimeout: a stall of this process counts as at most one

READING_TURNS = 2
"""Number of event-loop iterations after which pending socket data has been read. The first
iteration polls the sockets. The second one runs their callbacks, after those already queued."""


class ReceiveTimeout:
    """Receive timeout that ignores stalls of this process.

    A process that was not scheduled for a second cannot conclude that its peer was silent, because
    messages may wait in the socket. Therefore the timeout is divided into slices. Each slice
    counts once, even if it took longer, and pending data is read before it counts.

    Call `restart` at the start and on each received message, and `end_slice` after each slice.
    `timeout` is in s. All methods take the event loop's time `now`, s.
    """

    def __init__(self, timeout: float) -> None:
        self.timeout = timeout
        self.slice = timeout / SLICES
        self._silent_slices = 0
        self._slice_start = 0.0

    def restart(self, now: float) -> None:
        self._silent_slices, self._slice_start = 0, now

    def time_left(self, now: float) -> float:
        return self._slice_start + self.slice - now

    def end_slice(self, now: float) -> bool:
        """Count an expired slice of the timeout. Return whether the whole timeout has expired."""
        self._silent_slices += 1
        self._slice_start = now
        return self._silent_slices >= SLICES


async def wait_for_silence(silence: ReceiveTimeout) -> None:
    """Restart the receive timeout `silence`, and wait until it expires."""
    now = asyncio.get_running_loop().time
    silence.restart(now())
    turns = READING_TURNS
    while True:
        if (time_left := silence.time_left(now())) > 0.0:
            turns = READING_TURNS
            await asyncio.sleep(time_left)
        elif turns:
            turns -= 1
            await asyncio.sleep(0)
        elif silence.end_slice(now()):
            return


Address = tuple[str, int]  # IP address (version 4 or 6) and port


class WireEvent(StrEnum):
    """An event of a connection that a trace records, from the client's side."""

    OPENED = 'opened'
    SENT = 'sent'
    RECEIVED = 'received'
    ENDED = 'ended'  # closed by the controller
    RESET = 'reset'  # reset by the controller
    CLOSED = 'closed'  # closed by the client


class Tap(Protocol):
    """Function called with each step of a connection."""

    def __call__(self, event: WireEvent, data: bytes, age: float = 0.0) -> None:
        """Record a step that was `age` s ago. `data`: the bytes of SENT and RECEIVED."""


CLOSED = 'closed by the controller'

READ_SIZE_BYTES = 65536
MAX_FRAMES_PER_TURN = 50
"""Maximum number of frames that are handled before other event-loop callbacks run. A controller
that sends continuously must not delay the other robots of this process."""


class AnyFramer(Protocol):
    byte_order: ByteOrder | None  # detected from the bytes

    @property
    def unread(self) -> bytes:
        """Bytes of an incomplete packet."""

    def receive_data(self, data: bytes) -> None:
        """Add received bytes."""

    def next_packet(self) -> Any | None:
        """Return the next packet or None. Raises FrameError if no further packet can be read."""


@dataclass(frozen=True)
class Receivers:
    """Callbacks of a connection. An exception of a callback ends the connection."""

    data: Callable[[bytes], None]  # called with the bytes of each read, before parsing
    packet: Callable[[Any], None]  # called with each valid packet
    bad_frame: Callable[[SimpleMessageError], None]  # after a FrameError the connection ends
    event: Callable[[WireEvent], None]  # called with ENDED or RESET


class Connection(asyncio.BufferedProtocol):
    """A TCP connection as an asyncio protocol. It reads nothing before `start`.

    It must be created in the event loop. It ends if no complete frame arrives for
    `receive_timeout` s (see ReceiveTimeout). With None, there is no timeout.
    """

    transport: asyncio.Transport

    def __init__(
        self, receivers: Receivers, framer: AnyFramer, receive_timeout: float | None
    ) -> None:
        self.framer = framer
        self.ended: asyncio.Future[str] = asyncio.get_running_loop().create_future()
        """Future with the reason for the end of the connection, as text."""
        self._loop = asyncio.get_running_loop()
        self._receivers = receivers
        self._buffer = memoryview(bytearray(READ_SIZE_BYTES))
        self._silence = None if receive_timeout is None else ReceiveTimeout(receive_timeout)
        self._timer: asyncio.Handle | None = None
        self._why: str | None = None
        self._reading_paused = False

    def start(self) -> None:
        self._received()
        self._check_silence(READING_TURNS)
        self.transport.resume_reading()

    def end(self, why: str) -> None:
        """End the connection. Handle no more received data, but send all unsent data."""
        self._finish(why)
        self.transport.close()

    def close(self, why: str) -> None:
        """End the connection like `end`, but set `ended` only when all data has been sent."""
        self._why = why
        self.transport.close()

    def abort(self, why: str) -> None:
        """End the connection immediately, and drop unsent data."""
        self._finish(why)
        self.transport.abort()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)  # noqa: S101 - for the type checker
        self.transport = transport
        transport.pause_reading()

    def get_buffer(self, sizehint: int) -> memoryview:
        return self._buffer

    def buffer_updated(self, nbytes: int) -> None:
        data = bytes(self._buffer[:nbytes])
        try:
            self._receivers.data(data)
        except Exception as error:  # noqa: BLE001 - `ended` raises it
            self._fail(error)
            return
        self.framer.receive_data(data)
        self._handle()

    def eof_received(self) -> None:
        self._close_of_controller()

    def connection_lost(self, exc: Exception | None) -> None:
        if self.ended.done():
            return
        if self._why is not None:
            self._finish(self._why)
        elif exc is None:
            self._close_of_controller()
        else:
            if isinstance(exc, ConnectionResetError):
                self._receivers.event(WireEvent.RESET)
            self._finish(reason(exc))

    def _handle(self) -> None:
        """Handle one batch of frames, and schedule the next batch if frames are left."""
        if self.transport.is_closing():
            return
        try:
            all_handled = self._handle_some()
        except Exception as error:  # noqa: BLE001 - `ended` raises it
            self._fail(error)
            return
        if not all_handled:
            self._reading_paused = True
            self.transport.pause_reading()
            self._loop.call_soon(self._handle)
        elif self._reading_paused:
            self._reading_paused = False
            self.transport.resume_reading()

    def _handle_some(self) -> bool:
        """Handle up to MAX_FRAMES_PER_TURN frames. Return False if more may be left."""
        next_packet, take = self.framer.next_packet, self._receivers.packet
        closing = self.transport.is_closing
        for _ in range(MAX_FRAMES_PER_TURN):
            try:
                packet = next_packet()
            except FrameError as error:
                self._receivers.bad_frame(error)
                self.end(str(error))
                return True
            except SimpleMessageError as error:
                self._received()
                self._receivers.bad_frame(error)
                continue
            if packet is None:
                return True
            self._received()
            take(packet)
            if closing():  # the callback has closed the connection
                return True
        return False

    def _close_of_controller(self) -> None:
        if self._why is None and not self.ended.done():
            self._receivers.event(WireEvent.ENDED)
            self._finish(CLOSED)

    def _received(self) -> None:
        if self._silence is not None:
            self._silence.restart(self._loop.time())

    def _check_silence(self, turns: int) -> None:
        """End the connection if the receive timeout has expired, else schedule the next check.

        At the end of a slice, the check first waits `turns` iterations of the loop, in which
        pending data is read.
        """
        silence = self._silence
        if silence is None or self.transport.is_closing():
            return
        now = self._loop.time()
        if (time_left := silence.time_left(now)) > 0.0:
            self._timer = self._loop.call_later(time_left, self._check_silence, READING_TURNS)
        elif turns:
            self._timer = self._loop.call_soon(self._check_silence, turns - 1)
        elif silence.end_slice(now):
            self.end(f'silent for {silence.timeout:g} s')
        else:
            self._check_silence(READING_TURNS)

    def _fail(self, error: Exception) -> None:
        if not self.ended.done():
            self.ended.set_exception(error)
        self._cancel_timer()
        self.transport.abort()

    def _finish(self, why: str) -> None:
        if not self.ended.done():
            self.ended.set_result(why)
        self._cancel_timer()

    def _cancel_timer(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
