# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The times that strategies are held against, per trajectory and limits; kept in a file.

They change with the points and the limits only, so they are stored under a digest of these. How
they were found is in README.md.
"""

import hashlib
import json
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from epson_driver.motion import Array, JointLimits

FILE = Path(__file__).with_name('references.json')


@dataclass(frozen=True)
class ReferenceTimes:
    """Times in s: point to point, TOPP-RA, optimum; what that attains of each limit; stops.

    opt: the fastest motion through the points on whatever path, found by `opt_by` (optimum.py);
    spline: the fastest one on the spline through them, by a search of our own; toppra: that
    without a limit on the jerk.
    """

    ptp: float
    ptp_stops: int
    toppra: float
    opt_by: str
    opt: float
    opt_velocity: float
    opt_acceleration: float
    opt_jerk: float
    spline: float
    spline_velocity: float
    spline_acceleration: float
    spline_jerk: float

    def sound(self) -> bool:
        """Return whether both optima keep the limits, and the times are in the right order.

        On a straight line the point-to-point move is optimal; the search comes within half a
        percent of that.
        """
        within = (
            self.opt_velocity <= 1.002  # kept at the nodes of a grid, and bulging between them
            and self.spline_velocity <= 1.001
            and max(self.opt_acceleration, self.spline_acceleration) <= 1.001
            and max(self.opt_jerk, self.spline_jerk) <= 1.02
        )
        return within and self.opt <= self.spline and self.toppra <= self.spline <= 1.01 * self.ptp


def digest(positions: Array, limits: JointLimits) -> str:
    """Return the key of a trajectory (n, joints) under limits."""
    numbers = [positions, limits.velocity, limits.acceleration, limits.jerk]
    parts = ['version 2', *(repr(table.round(9).tolist()) for table in numbers)]
    return hashlib.sha256('\n'.join(parts).encode()).hexdigest()[:16]


class References:
    """The stored times, by digest."""

    def __init__(self) -> None:
        self._entries: dict[str, dict[str, Any]] = json.loads(FILE.read_text(encoding='utf-8'))

    def __contains__(self, key: str) -> bool:
        return key in self._entries

    def __getitem__(self, key: str) -> ReferenceTimes:
        entry = self._entries[key]
        return ReferenceTimes(
            **{field.name: entry[field.name] for field in fields(ReferenceTimes)}
        )
