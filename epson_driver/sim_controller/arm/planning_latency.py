# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""How long planning may take: a plan begins at a moment that must not be over when it comes."""

from collections import deque

INITIAL_LATENCY_S = 0.04
MIN_LATENCY_S = 0.01
MAX_LATENCY_S = 0.15
MARGIN_FACTOR = 1.3
"""The latency is the longest time of a recent plan times this."""

LATE_FACTOR = 1.5
"""After a plan that came too late, it is at least the latency before times this."""

MAX_RECENT_PLANS = 32
"""How many plans are remembered; in motion there is one about every 30 ms."""


class PlanningLatency:
    """The latency to plan with, s, from how long the recent plans took."""

    def __init__(self) -> None:
        self.value = INITIAL_LATENCY_S
        self._recent = deque([INITIAL_LATENCY_S / MARGIN_FACTOR], MAX_RECENT_PLANS)

    def took(self, seconds: float, late: bool = False) -> None:
        """Adapt to a plan that took so long, s; `late`: it came too late to be used."""
        self._recent.append(seconds)
        wanted = MARGIN_FACTOR * max(self._recent)
        if late:
            wanted = max(wanted, LATE_FACTOR * self.value)
        self.value = min(max(wanted, MIN_LATENCY_S), MAX_LATENCY_S)
