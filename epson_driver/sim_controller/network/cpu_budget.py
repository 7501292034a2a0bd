# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""How much processor time one client may use, so that the clock and other clients go on."""

MAX_SAVED_S = 0.1
"""The most processor time that a quiet client saves up, s."""

INITIAL_S = 0.002
"""What a new client may use at once, s: little, so that to reconnect does not pay."""


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
