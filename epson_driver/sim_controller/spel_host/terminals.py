# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The terminals of SPEL+ programs without a person, and of the command window."""

import logging
from typing import Final

from epson_driver.sim_controller.clock import Clock
from epson_driver.spel import Caller, Terminal
from epson_driver.spel.task import COMMAND_TASK

CANCEL: Final = 2
"""What a MsgBox is answered with: there is nobody to ask."""

MAX_LINE = 1000
"""Characters of a line of Print; a longer one is cut."""

_terminal = logging.getLogger('epson_driver.spel.terminal')


class LogTerminal:
    """Logs what is printed, line by line, with the controller's time, task and function."""

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
        # The place is that in the program, so each Print has a pace of its own in the log.
        what = '%9.3f s task %d %s: %s'
        values = (self._clock.now, caller.task, caller.function, line[:MAX_LINE])
        record = _terminal.makeRecord(
            _terminal.name, logging.INFO, caller.file, caller.line, what, values, None
        )
        if _terminal.isEnabledFor(logging.INFO):
            _terminal.handle(record)

    def read_line(self) -> str | None:
        """Return None, as there is no input."""
        return None

    def message_box(self, caller: Caller, text: str, _buttons: int, title: str) -> int | None:
        """Show the text and answer Cancel."""
        self.write(caller, f'MsgBox {title}: {text} (answered with Cancel)\n')
        return CANCEL


class CommandTerminal:
    """A terminal that keeps a command's output, and hands everything else on."""

    def __init__(self, terminal: Terminal) -> None:
        self._terminal = terminal
        self._printed: list[str] = []

    def taken(self) -> str:
        """Return the output since the last call, without the last line end."""
        text = ''.join(self._printed)
        self._printed.clear()
        return text.removesuffix('\n').replace('\n', '\r\n')

    def write(self, caller: Caller, text: str) -> None:
        """Keep a command's output, and show a program's."""
        if caller.task == COMMAND_TASK:
            self._printed.append(text)
        else:
            self._terminal.write(caller, text)

    def read_line(self) -> str | None:
        """Return a line that a person has typed, or None while there is none."""
        return self._terminal.read_line()

    def message_box(self, caller: Caller, text: str, buttons: int, title: str) -> int | None:
        """Return the button that was pressed, or None as long as there is none."""
        return self._terminal.message_box(caller, text, buttons, title)
