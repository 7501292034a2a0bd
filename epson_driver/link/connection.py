# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""One TCP connection. It converts received bytes to packets until it ends, with a reason.

It is an asyncio protocol, not a stream. Received data is handled in the same turn of the event
loop, without waking a task first.
"""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Protocol

from epson_driver.simple_message import ByteOrder, FrameError, SimpleMessageError

SLICES = 8
"""Number of slices. A delay of this process adds at most one slice to the measured silence."""

READING_TURNS = 2
"""Turns of the event loop after a timer that read all pending socket data. The first turn polls
the selector, the second runs the callbacks of that poll after those already queued."""


class ReceiveTimeout:
    """Receive timeout that ignores time when this process was not scheduled.

    `patience`: the timeout, s; `now`: the loop's time, s. A process that was not scheduled for a
    second has not observed its peer silent for a second, because messages may wait in the socket.
    Therefore the timeout is divided into slices. A slice counts once, regardless of its duration,
    and pending data is read before the slice counts.

    Call `heard` at the start and on each received message, and `passed` at the end of each slice.
    """

    def __init__(self, patience: float) -> None:
        self.patience = patience
        self.slice = patience / SLICES
        self._quiet = 0
        self._began = 0.0

    def heard(self, now: float) -> None:
        """Restart the timeout after a message."""
        self._quiet, self._began = 0, now

    def left(self, now: float) -> float:
        """Return the time left in the current slice, s (≤ 0 when expired)."""
        return self._began + self.slice - now

    def passed(self, now: float) -> bool:
        """Count an expired slice. Returns whether the whole timeout has passed in silence."""
        self._quiet += 1
        self._began = now
        return self._quiet >= SLICES


async def silent(silence: ReceiveTimeout) -> None:
    """Wait until nothing has been received for the whole timeout, starting now."""
    now = asyncio.get_running_loop().time
    silence.heard(now())
    turns = READING_TURNS
    while True:
        if (left := silence.left(now())) > 0.0:
            turns = READING_TURNS
            await asyncio.sleep(left)
        elif turns:
            turns -= 1
            await asyncio.sleep(0)
        elif silence.passed(now()):
            return


Address = tuple[str, int]
"""IP address (either version) and port."""


class WireEvent(StrEnum):
    """One step of a connection, from the client's side."""

    OPENED = 'opened'
    SENT = 'sent'
    RECEIVED = 'received'
    ENDED = 'ended'
    """Closed by the controller."""
    RESET = 'reset'
    """Reset by the controller."""
    CLOSED = 'closed'
    """Closed by the client."""


Tap = Callable[[WireEvent, bytes], None]
"""Called with each step of a connection. The bytes on the wire: for SENT and RECEIVED only."""


READ_SIZE_BYTES = 65536
MAX_FRAMES_PER_TURN = 50
"""Frames handled before other event-loop callbacks run. A controller that sends continuously
must not delay another robot of this process."""


class AnyFramer(Protocol):
    """Converts bytes to packets. `byte_order`: detected from the bytes, or None."""

    byte_order: ByteOrder | None

    @property
    def unread(self) -> bytes:
        """Bytes of an incomplete packet."""

    def receive_data(self, data: bytes) -> None:
        """Add received bytes."""

    def next_packet(self) -> Any | None:
        """Return the next packet, or None if it is incomplete. Raises SimpleMessageError."""


@dataclass(frozen=True)
class Receivers:
    """Callbacks of a connection, in the event loop.

    data: the bytes of each read, before parsing. packet: each packet. bad_frame: each invalid
    frame; the connection continues unless the error is a FrameError. event: other events. An
    exception in a callback ends the connection, and `Connection.ended` raises it.
    """

    data: Callable[[bytes], None]
    packet: Callable[[Any], None]
    bad_frame: Callable[[SimpleMessageError], None]
    event: Callable[[WireEvent], None]


class Connection(asyncio.BufferedProtocol):
    """A connection. Must be created in the event loop. It does not read before `begin`.

    `receive_timeout`: s without a complete frame after which it ends (see ReceiveTimeout), None
    for no limit.
    """

    transport: asyncio.Transport

    def __init__(
        self, receivers: Receivers, framer: AnyFramer, receive_timeout: float | None
    ) -> None:
        self.framer = framer
        self.ended: asyncio.Future[str] = asyncio.get_running_loop().create_future()
        """Reason for the end, as a sentence."""
        self._loop = asyncio.get_running_loop()
        self._receivers = receivers
        self._buffer = memoryview(bytearray(READ_SIZE_BYTES))
        self._silence = None if receive_timeout is None else ReceiveTimeout(receive_timeout)
        self._timer: asyncio.Handle | None = None
        self._why: str | None = None
        self._behind = False
        """Whether reading is paused until the received data is handled."""

    def begin(self) -> None:
        """Start to receive."""
        self._received()
        self._look(READING_TURNS)
        self.transport.resume_reading()

    def end(self, why: str) -> None:
        """End the connection now, without handling remaining received data."""
        self._finish(why)
        self.transport.close()

    def close(self, why: str) -> None:
        """End the connection once all data is sent, without handling more received data."""
        self._why = why
        self.transport.close()

    def abort(self, why: str) -> None:
        """End the connection now, and drop unsent data."""
        self._finish(why)
        self.transport.abort()

    # --- as a protocol ----------------------------------------------------------------------

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Wait for `begin`."""
        assert isinstance(transport, asyncio.Transport)  # noqa: S101 - for the type checker
        self.transport = transport
        transport.pause_reading()

    def get_buffer(self, sizehint: int) -> memoryview:
        """Return the buffer to read into."""
        return self._buffer

    def buffer_updated(self, nbytes: int) -> None:
        """Handle the bytes that were read into the buffer."""
        data = bytes(self._buffer[:nbytes])
        try:
            self._receivers.data(data)
        except Exception as error:  # noqa: BLE001 - `ended` raises it
            self._fail(error)
            return
        self.framer.receive_data(data)
        self._handle()

    def eof_received(self) -> None:
        """Record that the controller has closed the connection."""
        self._close_of_controller()

    def connection_lost(self, exc: Exception | None) -> None:
        """Set the reason for the end, unless already set."""
        if self.ended.done():
            return
        if self._why is not None:
            self._finish(self._why)
        elif exc is None:
            self._close_of_controller()
        else:
            if isinstance(exc, ConnectionResetError):
                self._receivers.event(WireEvent.RESET)
            self._finish(str(exc))

    # ----------------------------------------------------------------------------------------

    def _handle(self) -> None:
        """Handle complete frames. Yields to other callbacks between batches."""
        if self.transport.is_closing():
            return
        try:
            all_handled = self._handle_some()
        except Exception as error:  # noqa: BLE001 - `ended` raises it
            self._fail(error)
            return
        if not all_handled:
            self._behind = True
            self.transport.pause_reading()
            self._loop.call_soon(self._handle)
        elif self._behind:
            self._behind = False
            self.transport.resume_reading()

    def _handle_some(self) -> bool:
        """Handle one batch of frames. Returns whether it was the last."""
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
            if closing():  # the packet's handler has closed it
                return True
        return False

    def _close_of_controller(self) -> None:
        if self._why is None and not self.ended.done():
            self._receivers.event(WireEvent.ENDED)
            self._finish('closed by the controller')

    def _received(self) -> None:
        if self._silence is not None:
            self._silence.heard(self._loop.time())

    def _look(self, turns: int) -> None:
        """Check for silence at the end of a slice, after pending input has been read."""
        silence = self._silence
        if silence is None or self.transport.is_closing():
            return
        now = self._loop.time()
        if (left := silence.left(now)) > 0.0:
            self._timer = self._loop.call_later(left, self._look, READING_TURNS)
        elif turns:
            self._timer = self._loop.call_soon(self._look, turns - 1)
        elif silence.passed(now):
            self.end(f'silent for {silence.patience:g} s')
        else:
            self._look(READING_TURNS)

    def _fail(self, error: Exception) -> None:
        if not self.ended.done():
            self.ended.set_exception(error)
        self._stop_looking()
        self.transport.abort()

    def _finish(self, why: str) -> None:
        if not self.ended.done():
            self.ended.set_result(why)
        self._stop_looking()

    def _stop_looking(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
