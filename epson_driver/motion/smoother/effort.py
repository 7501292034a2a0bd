# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The computing effort of a plan: counted instead of timed, so that calls are reproducible.

The unit is 1 µs on one core of a PC of 2024, estimated from the counts that dominate the time.
"""

from dataclasses import dataclass

MAX_EFFORT_US = 46_000
"""Maximum effort of a plan, without the constant part for the path and its speed bounds."""

NEWTON_STEP_US, ROW_US = 90, 0.032
"""Cost of a Newton step of `interior_point`, and of each of its rows."""

VERIFICATION_US, PIECE_US = 600, 2.5
"""Cost of the verification of a timing, and of each of its pieces."""

OUTSET_US, ROUND_US = 2_500, 1_500
"""Cost of a path with its speed bounds, and overhead of a round of Newton steps."""


@dataclass(slots=True)
class Effort:
    """The remaining effort, µs."""

    left: float = MAX_EFFORT_US

    @property
    def used_up(self) -> bool:
        """Whether the effort is exhausted."""
        return self.left <= 0.0

    def spend(self, effort: float) -> None:
        """Consume some effort."""
        self.left -= effort
