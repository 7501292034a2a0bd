# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What a controller makes of the velocity and the duration of a JOINT_TRAJ_PT.

The simulated controller obeys it, and so do the points that the driver sends.
"""

from enum import StrEnum


class FieldsUsed(StrEnum):
    """Which of the two count: `program.uses` of a profile."""

    BOTH = 'both'
    VELOCITY = 'velocity'
    DURATION = 'duration'
    NOTHING = 'nothing'

    @property
    def velocity(self) -> bool:
        """Whether the velocity counts."""
        return self in (FieldsUsed.BOTH, FieldsUsed.VELOCITY)

    @property
    def duration(self) -> bool:
        """Whether the duration counts."""
        return self in (FieldsUsed.BOTH, FieldsUsed.DURATION)
