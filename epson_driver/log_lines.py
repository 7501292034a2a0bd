# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Logging that is safe even if a network peer controls the rate and text of log lines.

`LogThrottle` limits the rate. `PrintableFormatter` escapes characters that would affect the
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
"""Minimum time between two lines that a throttle passes after its burst, s."""


class LogThrottle:
    """Token bucket for log lines. It passes `burst` lines, then one line per PERIOD_S.

    The bucket refills by one line per PERIOD_S, up to `burst` lines.
    """

    def __init__(self, burst: int = 1) -> None:
        self._saved = (burst - 1) * PERIOD_S
        self._next = float('-inf')
        self._suppressed = 0

    def passes(self, now: float) -> int | None:
        """Return whether this line passes, as a count, or None to suppress it.

        The count is the number of lines suppressed since the last line that passed. `now`: the
        time on any monotonic clock, s.
        """
        due = max(self._next, now - self._saved)
        if now < due:
            self._suppressed += 1
            return None
        suppressed, self._suppressed = self._suppressed, 0
        self._next = due + PERIOD_S
        return suppressed

    def line(self, text: str, now: float) -> str | None:
        suppressed = self.passes(now)
        return None if suppressed is None else with_count(text, suppressed)


def with_count(text: str, suppressed: int) -> str:
    return f'{text} (and {suppressed} like it before)' if suppressed else text


class PrintableFormatter(logging.Formatter):
    """Formats each record as one line of printable text, except tracebacks and stacks."""

    def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: N802 - logging's name
        return printable(super().formatMessage(record))

    def formatException(self, ei: object) -> str:  # noqa: N802 - logging's name
        lines = super().formatException(ei).split('\n')  # type: ignore[arg-type]
        return '\n'.join(map(printable, lines))


BURST_LINES = 20
"""Number of lines that a logging statement may write in a burst. Then one line per second
passes."""

_STDERR_DESCRIPTOR = 2
_MAX_WAITING_LINES = 1000
_FLUSH_TIMEOUT_S = 0.5


class StderrLog(logging.Handler):
    """Writes log records to stderr from a separate thread, and drops them while 1000 are waiting.

    Without the thread, a full pipe would block the process. Each logging statement has a separate
    rate limit, measured with the monotonic `clock`, s.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__()
        self.setFormatter(PrintableFormatter('%(asctime)s %(levelname)s %(message)s'))
        self._clock = clock
        self._throttles: dict[tuple[str, int], LogThrottle] = {}
        self._lines: queue.Queue[bytes | None] = queue.Queue(_MAX_WAITING_LINES)
        self._thread = threading.Thread(target=self._write, name='stderr log', daemon=True)
        self._thread.start()

    def emit(self, record: logging.LogRecord) -> None:
        """Queue the line for the thread.

        The line is dropped if its statement exceeds the rate limit, or if the queue is full.
        """
        where = (record.pathname, record.lineno)
        if where not in self._throttles:
            self._throttles[where] = LogThrottle(BURST_LINES)
        suppressed = self._throttles[where].passes(self._clock())
        if suppressed is None:
            return
        line = with_count(self.format(record), suppressed)
        with suppress(queue.Full):
            self._lines.put_nowait(line.encode(errors='replace') + b'\n')

    def finish(self) -> None:
        """Write the waiting lines and end the thread. This takes at most half a second."""
        with suppress(queue.Full):
            self._lines.put_nowait(None)
            self._thread.join(_FLUSH_TIMEOUT_S)

    def _write(self) -> None:
        # Not sys.stderr: its lock must not be held when the interpreter exits.
        with suppress(OSError):
            while (line := self._lines.get()) is not None:
                while line:
                    line = line[os.write(_STDERR_DESCRIPTOR, line) :]
