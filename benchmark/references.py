# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Reference times for the strategies, per trajectory and limits, stored in a file.

They depend on the points and the limits only, so they are stored under a digest of these.
README.md describes how they were computed.
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
    """Times in s: point to point, TOPP-RA and two optima, with their use of each limit and stops.

    opt: the fastest motion through the points on any path, found by `opt_by` (optimum.py). spline:
    the fastest one on the spline through them, found by a separate search. toppra: the same
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

        On a straight line the point-to-point move is optimal, and the search comes within half a
        percent of it.
        """
        within = (
            self.opt_velocity <= 1.002  # kept at the nodes of a grid, with bulges between them
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
