# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Log lines to stderr that never wait for whoever reads them.

A pipe that nobody reads would otherwise stop the whole controller at its 64 KiB.
"""

import logging
import os
import queue
import threading
from contextlib import suppress

_STDERR = 2  # the file descriptor
_CAPACITY = 1000
_LAST_WORDS = 0.5  # s


class StderrLog(logging.Handler):
    """Writes records from a thread of its own; drops them while 1000 wait."""

    def __init__(self) -> None:
        super().__init__()
        self.setFormatter(logging.Formatter('%(asctime)s %(levelname)s %(message)s'))
        self._lines: queue.Queue[bytes | None] = queue.Queue(_CAPACITY)
        self._thread = threading.Thread(target=self._write, name='stderr log', daemon=True)
        self._thread.start()

    def emit(self, record: logging.LogRecord) -> None:
        """Hand the line to the thread, or drop it."""
        with suppress(queue.Full):
            self._lines.put_nowait(self.format(record).encode(errors='replace') + b'\n')

    def finish(self) -> None:
        """Write what waits, but not for longer than half a second."""
        with suppress(queue.Full):
            self._lines.put_nowait(None)
            self._thread.join(_LAST_WORDS)

    def _write(self) -> None:
        # Not sys.stderr: the interpreter must not find its lock taken when it ends.
        with suppress(OSError):
            while (line := self._lines.get()) is not None:
                while line:
                    line = line[os.write(_STDERR, line) :]
