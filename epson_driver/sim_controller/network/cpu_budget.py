# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""How much of the processor one client may use: the clock and the others go on beside it."""

MAX_SAVED_S = 0.1
"""Time that a client may use at once after it was quiet, s."""

INITIAL_S = 0.002
"""What it may use at once when it has just come, s: to come again and again does not pay."""


class CpuBudget:
    """What a client has used of the processor lately. With more than its share, it must wait."""

    def __init__(self, now: float) -> None:
        self._saved = INITIAL_S
        self._at = now

    def used(self, seconds: float, share: float, now: float) -> float:
        """Take note of time used, of which `share` (0, 1] is its own; return the wait, s.

        The wait begins `now`. All times are s, `now` of a clock that never goes back.
        """
        self._saved = min(self._saved + (now - self._at) * share, MAX_SAVED_S) - seconds
        self._at = now
        return max(-self._saved / share, 0.0)
