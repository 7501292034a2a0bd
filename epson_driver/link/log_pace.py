# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Lines of a log that a controller could cause as often as it likes: one a second is written."""

PERIOD = 1.0
"""Between two lines, s."""


class LogPace:
    """Lets one line pass in each period and counts the others for the next one."""

    def __init__(self) -> None:
        self._next = float('-inf')
        self._held = 0

    def line(self, text: str, now: float) -> str | None:
        """Return what to log at this time, s; None: nothing."""
        if now < self._next:
            self._held += 1
            return None
        if self._held:
            text = f'{text} (and {self._held} like it before)'
        self._held = 0
        self._next = now + PERIOD
        return text
