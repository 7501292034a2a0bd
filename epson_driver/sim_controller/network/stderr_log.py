# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Logging to stderr that never waits for its reader.

A pipe that nobody reads would otherwise stop the whole controller at its 64 KiB, and a client that
is refused all the time would fill the disk.
"""

import logging
import os
import queue
import threading
import time
from collections.abc import Callable
from contextlib import suppress

from epson_driver.log_lines import LogThrottle, PrintableFormatter, counted

BURST_LINES = 20
"""Lines that each place in the code may write at once; then one a second."""

_STDERR_DESCRIPTOR = 2  # the file descriptor
_MAX_WAITING_LINES = 1000
_FLUSH_TIMEOUT_S = 0.5  # s


class StderrLog(logging.Handler):
    """Writes records from a thread of its own, and drops them while 1000 wait.

    What one line of code logs has a pace of its own, on `clock`, s, which never goes back.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__()
        self.setFormatter(PrintableFormatter('%(asctime)s %(levelname)s %(message)s'))
        self._clock = clock
        self._paces: dict[tuple[str, int], LogThrottle] = {}
        self._lines: queue.Queue[bytes | None] = queue.Queue(_MAX_WAITING_LINES)
        self._thread = threading.Thread(target=self._write, name='stderr log', daemon=True)
        self._thread.start()

    def emit(self, record: logging.LogRecord) -> None:
        """Hand the line to the thread, hold it back, or drop it."""
        where = (record.pathname, record.lineno)
        if where not in self._paces:
            self._paces[where] = LogThrottle(BURST_LINES)
        held = self._paces[where].passes(self._clock())
        if held is None:
            return
        line = counted(self.format(record), held)
        with suppress(queue.Full):
            self._lines.put_nowait(line.encode(errors='replace') + b'\n')

    def finish(self) -> None:
        """Write the waiting lines, for half a second at most."""
        with suppress(queue.Full):
            self._lines.put_nowait(None)
            self._thread.join(_FLUSH_TIMEOUT_S)

    def _write(self) -> None:
        # Not sys.stderr: the interpreter must not find its lock taken when it ends.
        with suppress(OSError):
            while (line := self._lines.get()) is not None:
                while line:
                    line = line[os.write(_STDERR_DESCRIPTOR, line) :]
