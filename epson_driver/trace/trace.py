# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Records everything that network connections (`Link`) send and receive into a pcap file.

The event loop creates the packets and a thread writes them, so a slow disk never delays a message.
The trace ends if the file reaches its maximum size, the disk fails, or the disk is too slow. The
links are not affected.
"""

import contextlib
import io
import logging
import os
import threading
import time
from collections.abc import Callable, Iterable
from contextvars import copy_context
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import BinaryIO

from epson_driver.link.connection import WireEvent
from epson_driver.link.link import Link
from epson_driver.trace.pcap import Conversation, PcapWriter

WRITE_PERIOD_S = 0.2  # period of the thread, s: a killed process loses at most this time
MAX_UNWRITTEN_BYTES = 16 * 1024 * 1024  # size of the buffer. The trace ends if it is full
END_TIMEOUT_S = 1.0  # maximum time to wait for the disk when the driver ends, s
MEGABYTE = 1_000_000
NANOSECONDS = 1_000_000_000
DEFAULT_MAX_BYTES = 100 * MEGABYTE

_log = logging.getLogger(__name__)


class TraceError(OSError):
    """Failure to start or continue a trace. The text is the reason."""


def open_trace(folder: str, name: str) -> BinaryIO:
    """Open a new trace file in a folder, which may start with `~` and is created if missing.

    strftime codes in the name are expanded. The function may block on the disk, so it must not be
    called in the event loop. An existing file is never overwritten, because it may be the trace of
    a failure before a restart. A symbolic link is never followed. Raises TraceError if the file
    cannot be opened.
    """
    if not folder:
        raise TraceError('no trace: the parameter trace_folder is empty')
    try:
        filled_in = datetime.now().astimezone().strftime(name)
    except ValueError as error:
        raise TraceError(f'trace_file = {name!r} is no file name: {error}') from error
    for text in (name, filled_in):
        if not text.isprintable() or {'/', os.sep} & set(text) or text[:1] in ('', '.', '~'):
            raise TraceError(
                f'trace_file must be the name of a file in {folder}, without a folder and without '
                f'. or ~ in front, not {text!r}'
            )
    path = Path(folder, filled_in)
    try:
        path = path.expanduser()
        path.parent.mkdir(parents=True, exist_ok=True)
        return path.open('xb', buffering=0)  # x: O_EXCL, which follows no symbolic link
    except (OSError, ValueError, RuntimeError) as error:  # RuntimeError: no such user
        why = os.strerror(error.errno) if isinstance(error, OSError) and error.errno else error
        raise TraceError(f'cannot create the trace {path}: {why}') from error


class Trace:
    """Records the network traffic of `links` to a pcap file, in the event loop.

    A recording ends when its file reaches `largest` bytes. This limit may be set at any time.
    `clock` returns the time in ns since 1970.
    """

    def __init__(self, links: Iterable[Link], clock: Callable[[], int] = time.time_ns) -> None:
        self._links = tuple(links)
        self._clock = clock
        self._file: _BackgroundFile | None = None
        self._name = ''
        self._writer = PcapWriter(io.BytesIO())  # until the first trace
        self.largest: float = DEFAULT_MAX_BYTES
        self._conversations: dict[Link, Conversation] = {}

    def begin(self, file: BinaryIO) -> None:
        """Start to record into an open file, which is closed at the end of the trace.

        An existing connection is recorded as if it started now, with the bytes of an incomplete
        frame that have already been received.
        """
        self.end('replaced by another trace')
        self._name = str(file.name)
        self._file = _BackgroundFile(file)
        self._writer = PcapWriter(self._file)
        _log.info('trace %s started', self._name)
        for link in self._links:
            link.trace = partial(self._take, link)
            if link.addresses is not None:
                self._take(link, WireEvent.OPENED, b'')
                if link.unread:
                    self._take(link, WireEvent.RECEIVED, link.unread)

    def end(self, why: str, timeout: float = 0.0) -> None:
        """End the trace, if one is active, and close its file. `why`: reason for the log.

        Waits up to `timeout` s for the disk, then continues in the background.
        """
        file = self._file
        if file is None:
            return
        self._file = None
        for link in self._links:
            link.trace = None
        self._conversations.clear()
        file.close(f'after {self._writer.size} bytes: {why}', timeout)

    def _take(self, link: Link, event: WireEvent, data: bytes, age: float = 0.0) -> None:
        """Record one event of a link. End the trace on any error, or if the file is full."""
        try:
            self._record(link, event, data, self._clock() - round(age * NANOSECONDS))
        except TraceError:
            self.end('')  # the reason is already logged
            return
        except Exception as error:  # noqa: BLE001 - any error ends the trace only
            _log.exception('trace %s failed', self._name)
            self.end(f'{type(error).__name__}: {error}')
            return
        if self._writer.size >= self.largest:
            self.end(f'it reached its maximum size, {self.largest / MEGABYTE:g} MB')

    def _record(self, link: Link, event: WireEvent, data: bytes, now: int) -> None:
        if event is WireEvent.OPENED:
            ends = link.addresses
            if ends is not None:
                self._conversations[link] = Conversation(self._writer, *ends, now)
            return
        conversation = self._conversations.get(link)
        if conversation is None:
            return
        if event in (WireEvent.SENT, WireEvent.RECEIVED):
            conversation.data(now, data, from_client=event is WireEvent.SENT)
        elif event is WireEvent.ENDED:
            conversation.finish(now, from_client=False)
        elif event is WireEvent.RESET:
            conversation.reset(now, from_client=False)
        else:
            conversation.finish(now, from_client=True)
            del self._conversations[link]


class _BackgroundFile:
    """A file that a separate thread writes, so `write` never waits.

    The end of the thread is logged.
    """

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self._lock = threading.Lock()
        self._unwritten = bytearray()
        self._closing = threading.Event()
        self._why = ''
        self._error = ''
        in_context = copy_context().run  # the context of log messages
        self._thread = threading.Thread(
            target=in_context, args=(self._run,), name='trace', daemon=True
        )
        self._thread.start()

    def write(self, data: bytes, /) -> None:
        """Buffer bytes. Raises TraceError if the disk has failed or is too slow."""
        with self._lock:
            if len(self._unwritten) > MAX_UNWRITTEN_BYTES:
                self._fail(f'the disk is too slow, {len(self._unwritten)} bytes are pending')
            if self._error:
                raise TraceError(self._error)
            self._unwritten += data

    def close(self, why: str, timeout: float) -> None:
        self._why = why
        self._closing.set()
        self._thread.join(timeout)

    def _run(self) -> None:
        try:
            closing = False
            while not closing:
                closing = self._closing.wait(WRITE_PERIOD_S)
                with self._lock:
                    data, self._unwritten = self._unwritten, bytearray()
                self._write_all(memoryview(data))
        except Exception as error:  # noqa: BLE001 - any error ends the trace
            number = error.errno if isinstance(error, OSError) else None
            with self._lock:
                self._fail(os.strerror(number) if number else f'{type(error).__name__}: {error}')
        finally:
            with contextlib.suppress(OSError):
                self._file.close()
        if not self._error:
            _log.info('trace %s stopped %s', self._file.name, self._why)

    def _fail(self, why: str) -> None:
        if not self._error:
            self._error = why
            self._unwritten.clear()
            _log.error('trace %s stopped: %s', self._file.name, why)

    def _write_all(self, data: memoryview) -> None:
        while data:
            data = data[self._file.write(data) or 0 :]
