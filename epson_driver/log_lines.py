# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Log lines that others could cause as often as they like, and whose text others choose.

Both are dealt with where lines are written: `LogThrottle` bounds how many there are, and
`PrintableFormatter` writes none that does something to the terminal it is read on.
"""

import logging

from epson_driver.inputs import printable

PERIOD_S = 1.0
"""After how long one more line is written, s."""


class LogThrottle:
    """Lets `burst` lines pass, then one in each period, and counts the others for the next one.

    Periods in which nothing was to be written are saved up for the next burst.
    """

    def __init__(self, burst: int = 1) -> None:
        self._saved = (burst - 1) * PERIOD_S
        self._next = float('-inf')
        self._held = 0

    def passes(self, now: float) -> int | None:
        """Return how many lines were held back before this one; None: so is this one.

        `now` is of any clock that never goes back, s.
        """
        due = max(self._next, now - self._saved)
        if now < due:
            self._held += 1
            return None
        held, self._held = self._held, 0
        self._next = due + PERIOD_S
        return held

    def line(self, text: str, now: float) -> str | None:
        """Return what to log at this time, s; None: nothing."""
        held = self.passes(now)
        return None if held is None else counted(text, held)


def counted(text: str, held: int) -> str:
    """Return the line, with the number of those that were held back before it."""
    return f'{text} (and {held} like it before)' if held else text


class PrintableFormatter(logging.Formatter):
    """Formats records so that every line is printable, and a message is one line.

    Only a traceback and a stack have more lines.
    """

    def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: N802 - logging's name
        """Return the line of the message."""
        return printable(super().formatMessage(record))

    def formatException(self, ei: object) -> str:  # noqa: N802 - logging's name
        """Return the lines of a traceback."""
        return _printable_lines(super().formatException(ei))  # type: ignore[arg-type]


def _printable_lines(text: str) -> str:
    return '\n'.join(map(printable, text.split('\n')))
