# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Log lines whose rate and text a peer can control.

`LogThrottle` limits their rate. `PrintableFormatter` escapes characters that would affect the
reader's terminal.
"""

import logging

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
