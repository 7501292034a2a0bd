# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""How long planning takes: a plan is made for a moment that must not have passed when it comes."""

from collections import deque

FIRST = 0.04
LOWEST = 0.01
HIGHEST = 0.15
MARGIN = 1.3
"""Times the longest of the recent plans."""

RAISE = 1.5
"""Times the latency so far, after a plan that came too late."""

REMEMBERED = 32
"""Plans: in motion there is one about every 30 ms."""


class PlanningLatency:
    """The latency to plan with, s, from how long the recent plans took."""

    def __init__(self) -> None:
        self.value = FIRST
        self._recent = deque([FIRST / MARGIN], REMEMBERED)

    def took(self, seconds: float, late: bool = False) -> None:
        """Take note of how long a plan took, and whether that was too long."""
        self._recent.append(seconds)
        wanted = MARGIN * max(self._recent)
        if late:
            wanted = max(wanted, RAISE * self.value)
        self.value = min(max(wanted, LOWEST), HIGHEST)
