# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Log lines whose rate and text a peer can control.

`LogThrottle` limits their rate. `PrintableFormatter` escapes characters that would affect the
reader's terminal. `StderrLog` writes to stderr without blocking.
"""

import logging
import os
import queue
import threading
import time
from collections.abc import Callable
from contextlib import suppress

from epson_driver.inputs import printable

PERIOD_S = 1.0
"""Minimum time between two lines of a kind, after the burst, s."""


class LogThrottle:
    """Passes `burst` lines, then one per period, with the number of suppressed lines before it.

    Unused periods are saved for the next burst.
    """

    def __init__(self, burst: int = 1) -> None:
        self._saved = (burst - 1) * PERIOD_S
        self._next = float('-inf')
        self._held = 0

    def passes(self, now: float) -> int | None:
        """Return the number of lines suppressed before this one, or None to suppress it, too.

        `now`: the time on any monotonic clock, s.
        """
        due = max(self._next, now - self._saved)
        if now < due:
            self._held += 1
            return None
        held, self._held = self._held, 0
        self._next = due + PERIOD_S
        return held

    def line(self, text: str, now: float) -> str | None:
        """Return the line to log at time `now`, s, or None to suppress it."""
        held = self.passes(now)
        return None if held is None else counted(text, held)


def counted(text: str, held: int) -> str:
    """Return the line with the number of suppressed lines before it."""
    return f'{text} (and {held} like it before)' if held else text


class PrintableFormatter(logging.Formatter):
    """Formats each record as one line of printable text, except tracebacks and stacks."""

    def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: N802 - logging's name
        """Return the line of the message."""
        return printable(super().formatMessage(record))

    def formatException(self, ei: object) -> str:  # noqa: N802 - logging's name
        """Return the lines of a traceback."""
        return _printable_lines(super().formatException(ei))  # type: ignore[arg-type]


def _printable_lines(text: str) -> str:
    return '\n'.join(map(printable, text.split('\n')))


BURST_LINES = 20
"""Burst of lines per line of code. Its rate is then limited to one line per second."""

_STDERR_DESCRIPTOR = 2  # the file descriptor
_MAX_WAITING_LINES = 1000
_FLUSH_TIMEOUT_S = 0.5  # s


class StderrLog(logging.Handler):
    """Writes records from a separate thread, and drops them while 1000 wait.

    Otherwise a pipe that is not read would stop the whole process after 64 KiB. Each logging
    statement has a separate rate limit, on the monotonic `clock`, s.
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
