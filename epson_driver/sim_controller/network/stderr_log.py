# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Logging to stderr that never blocks.

Without it, a pipe that is not read would stop the whole controller after 64 KiB, and a client that
is refused continuously would fill the disk.
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
"""Burst of lines per line of code. Its rate is then limited to one line per second."""

_STDERR_DESCRIPTOR = 2  # the file descriptor
_MAX_WAITING_LINES = 1000
_FLUSH_TIMEOUT_S = 0.5  # s


class StderrLog(logging.Handler):
    """Writes records from a separate thread, and drops them while 1000 wait.

    Each logging statement has a separate rate limit, on the monotonic `clock`, s.
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
        """Queue the line for the thread, delay it, or drop it."""
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
        """Write the waiting lines, within half a second."""
        with suppress(queue.Full):
            self._lines.put_nowait(None)
            self._thread.join(_FLUSH_TIMEOUT_S)

    def _write(self) -> None:
        # Not sys.stderr: its lock must not be held when the interpreter exits.
        with suppress(OSError):
            while (line := self._lines.get()) is not None:
                while line:
                    line = line[os.write(_STDERR_DESCRIPTOR, line) :]
