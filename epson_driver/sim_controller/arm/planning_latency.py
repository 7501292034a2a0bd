# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""How long planning may take: a plan begins at a moment that must not be over when it comes."""

from collections import deque

INITIAL_LATENCY_S = 0.04
MIN_LATENCY_S = 0.01
MAX_LATENCY_S = 0.15
MARGIN_FACTOR = 1.3
"""Times the longest of the recent plans."""

LATE_FACTOR = 1.5
"""Times the latency so far, after a plan that came too late."""

MAX_RECENT_PLANS = 32
"""Plans: in motion there is one about every 30 ms."""


class PlanningLatency:
    """The latency to plan with, s, from how long the recent plans took."""

    def __init__(self) -> None:
        self.value = INITIAL_LATENCY_S
        self._recent = deque([INITIAL_LATENCY_S / MARGIN_FACTOR], MAX_RECENT_PLANS)

    def took(self, seconds: float, late: bool = False) -> None:
        """Take note of how long a plan took, and whether that was too long."""
        self._recent.append(seconds)
        wanted = MARGIN_FACTOR * max(self._recent)
        if late:
            wanted = max(wanted, LATE_FACTOR * self.value)
        self.value = min(max(wanted, MIN_LATENCY_S), MAX_LATENCY_S)
