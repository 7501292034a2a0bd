# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Terminals for the output of SPEL+ programs that run without a user."""

import logging
from abc import ABC, abstractmethod
from typing import Final

from epson_driver.sim_controller.clock import Clock
from epson_driver.spel import Caller

CANCEL: Final = 2  # no user is present
MAX_LINE = 1000  # characters; a longer line is truncated
_terminal = logging.getLogger('epson_driver.spel.terminal')


class Unattended(ABC):
    """A terminal without a user. It has no input, and every MsgBox is answered with Cancel."""

    @abstractmethod
    def write(self, caller: Caller, text: str) -> None: ...

    def read_line(self) -> str | None:
        return None

    def message_box(self, caller: Caller, text: str, _buttons: int, title: str) -> int | None:
        self.write(caller, f'MsgBox {title}: {text} (answered with Cancel)\n')
        return CANCEL


class KeptText(Unattended):
    def __init__(self) -> None:
        self.printed: list[str] = []

    def write(self, _caller: Caller, text: str) -> None:
        self.printed.append(text)


class LogTerminal(Unattended):
    """A terminal that logs each printed line with the controller's time, task and function."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._lines: dict[int, str] = {}

    def write(self, caller: Caller, text: str) -> None:
        *lines, rest = (self._lines.pop(caller.task, '') + text).split('\n')
        for line in lines:
            self._show(caller, line)
        if len(rest) > MAX_LINE:
            self._show(caller, rest)
        elif rest:
            self._lines[caller.task] = rest

    def _show(self, caller: Caller, line: str) -> None:
        # The record has the file and line of the Print, so each Print has a separate rate limit.
        what = '%9.3f s task %d %s: %s'
        values = (self._clock.now, caller.task, caller.function, line[:MAX_LINE])
        record = _terminal.makeRecord(
            _terminal.name, logging.INFO, caller.file, caller.line, what, values, None
        )
        if _terminal.isEnabledFor(logging.INFO):
            _terminal.handle(record)
