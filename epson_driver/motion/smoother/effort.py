# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What a plan may cost: counted, and not timed, so that the same calls give the same motion.

The unit is a µs of one core of a PC of 2024, by the counts that the time goes with.
"""

from dataclasses import dataclass

MAX_EFFORT_US = 46_000
"""The effort of a plan, but for what is done once and always: the path, and its speed bounds."""

NEWTON_STEP_US, ROW_US = 90, 0.032
"""A Newton step of `interior_point`, and each of its rows."""

VERIFICATION_US, PIECE_US = 600, 2.5
"""The verification of a timing, and of each of its pieces."""

OUTSET_US, ROUND_US = 2_500, 1_500
"""A path with its speed bounds; and what comes before and after the Newton steps."""


@dataclass(slots=True)
class Effort:
    """What may still be computed, µs."""

    left: float = MAX_EFFORT_US

    @property
    def used_up(self) -> bool:
        """Whether nothing is left."""
        return self.left <= 0.0

    def spend(self, effort: float) -> None:
        """Take some."""
        self.left -= effort
