# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Terminals of SPEL+ programs that run unattended."""

import logging
from abc import ABC, abstractmethod
from typing import Final

from epson_driver.sim_controller.clock import Clock
from epson_driver.spel import Caller

CANCEL: Final = 2
"""The answer to a MsgBox, because no user is present."""

MAX_LINE = 1000
"""Maximum characters of a printed line. A longer one is cut."""

_terminal = logging.getLogger('epson_driver.spel.terminal')


class Unattended(ABC):
    """A terminal without input, where every MsgBox is answered with Cancel."""

    @abstractmethod
    def write(self, caller: Caller, text: str) -> None:
        """Show a text."""

    def read_line(self) -> str | None:
        """Return None, because no input exists."""
        return None

    def message_box(self, caller: Caller, text: str, _buttons: int, title: str) -> int | None:
        """Show the text and answer Cancel."""
        self.write(caller, f'MsgBox {title}: {text} (answered with Cancel)\n')
        return CANCEL


class KeptText(Unattended):
    """Stores printed text."""

    def __init__(self) -> None:
        self.printed: list[str] = []

    def write(self, _caller: Caller, text: str) -> None:
        """Store a text."""
        self.printed.append(text)


class LogTerminal(Unattended):
    """Logs printed text, line by line, with the controller's time, task and function."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._lines: dict[int, str] = {}

    def write(self, caller: Caller, text: str) -> None:
        """Log printed text line by line, with time, task and function."""
        *lines, rest = (self._lines.pop(caller.task, '') + text).split('\n')
        for line in lines:
            self._show(caller, line)
        if len(rest) > MAX_LINE:
            self._show(caller, rest)
        elif rest:
            self._lines[caller.task] = rest

    def _show(self, caller: Caller, line: str) -> None:
        # The location is in the program, so each Print has a separate rate limit in the log.
        what = '%9.3f s task %d %s: %s'
        values = (self._clock.now, caller.task, caller.function, line[:MAX_LINE])
        record = _terminal.makeRecord(
            _terminal.name, logging.INFO, caller.file, caller.line, what, values, None
        )
        if _terminal.isEnabledFor(logging.INFO):
            _terminal.handle(record)
