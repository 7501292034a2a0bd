# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Point to point: from rest to rest to every point at full limits, as fast as can be.

All joints move together. A generous stand-in for an arm that stops at each point: no dead time.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from epson_driver.motion import Array, JointLimits, go


@dataclass(frozen=True)
class StopAndGo:
    """Sum of the moves' durations, s, and how many points between the ends it stops at."""

    duration: float
    stops: int


def stop_and_go(positions: Array, limits: JointLimits) -> StopAndGo:
    """Return the time through the points (n, joints), rad; a repeated point takes none."""
    moves = [go(limits, start, target).duration for start, target in pairwise(positions)]
    return StopAndGo(float(np.sum(moves)), max(sum(move > 0.0 for move in moves) - 1, 0))
