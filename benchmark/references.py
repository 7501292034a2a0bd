# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The times that strategies are held against, per trajectory and limits; kept in a file.

They change with the points, the limits and the algorithms only, so they are stored under a digest
of these and computed once.
"""

import hashlib
import json
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from benchmark.stop_and_go import stop_and_go
from epson_driver.motion import Array, JointLimits

VERSION = 2
"""Of the algorithms behind the times; a new one makes the stored ones invalid."""
FILE = Path(__file__).with_name('results') / 'reference.json'


@dataclass(frozen=True)
class ReferenceTimes:
    """Times in s: point to point, TOPP-RA, optimum; what that attains of each limit; stops.

    opt: the fastest motion found through the points, on whatever path; spline: the fastest one on
    the spline through them, as toppra is without a limit on the jerk.
    """

    ptp: float
    ptp_stops: int
    toppra: float
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
            max(self.opt_velocity, self.spline_velocity) <= 1.001
            and max(self.opt_acceleration, self.spline_acceleration) <= 1.001
            and max(self.opt_jerk, self.spline_jerk) <= 1.02
        )
        return within and self.opt <= self.spline and self.toppra <= self.spline <= 1.01 * self.ptp


def digest(positions: Array, limits: JointLimits) -> str:
    """Return the key of a trajectory (n, joints) under limits."""
    numbers = [positions, limits.velocity, limits.acceleration, limits.jerk]
    parts = [f'version {VERSION}', *(repr(table.round(9).tolist()) for table in numbers)]
    return hashlib.sha256('\n'.join(parts).encode()).hexdigest()[:16]


def compute(positions: Array, limits: JointLimits) -> ReferenceTimes:
    """Return the reference times of one trajectory (n, joints); takes 0.5 to 40 s."""
    # here, so that who only reads stored times needs neither scipy nor toppra
    from benchmark.optimum import FreeOptimum, free_path_optimum, jerk_limited_optimum
    from benchmark.spline_path import spline_path
    from benchmark.topp_ra import jerk_free_time

    path = spline_path(positions, limits.velocity)
    found = jerk_limited_optimum(path, limits)
    spline = FreeOptimum(found.profile.duration, found.velocity, found.acceleration, found.jerk)
    free = free_path_optimum(positions, limits)
    optimum = spline if free is None or free.duration > spline.duration else free
    ptp = stop_and_go(positions, limits)
    return ReferenceTimes(
        ptp=round(ptp.duration, 6),
        ptp_stops=ptp.stops,
        toppra=round(jerk_free_time(path, limits), 6),
        opt=round(optimum.duration, 6),
        opt_velocity=round(optimum.velocity, 5),
        opt_acceleration=round(optimum.acceleration, 5),
        opt_jerk=round(optimum.jerk, 5),
        spline=round(spline.duration, 6),
        spline_velocity=round(spline.velocity, 5),
        spline_acceleration=round(spline.acceleration, 5),
        spline_jerk=round(spline.jerk, 5),
    )


class ReferenceFile:
    """The stored reference times, by digest; rewritten whenever one is added."""

    def __init__(self, path: Path = FILE, forget: bool = False) -> None:
        self._path = path
        self._entries: dict[str, dict[str, Any]] = {}
        if path.exists() and not forget:
            self._entries = json.loads(path.read_text(encoding='utf-8'))

    def __contains__(self, key: str) -> bool:
        return key in self._entries

    def __getitem__(self, key: str) -> ReferenceTimes:
        entry = self._entries[key]
        return ReferenceTimes(
            **{field.name: entry[field.name] for field in fields(ReferenceTimes)}
        )

    def put(self, key: str, name: str, limits: str, times: ReferenceTimes) -> None:
        """Store reference times with the names of trajectory and limits, for readers."""
        self._entries[key] = {'name': name, 'limits': limits, **asdict(times)}
        self._path.parent.mkdir(exist_ok=True)
        ordered = dict(sorted(self._entries.items(), key=lambda item: _order(item[1])))
        self._path.write_text(json.dumps(ordered, indent=1) + '\n', encoding='utf-8')


def _order(entry: dict[str, Any]) -> tuple[str, str]:
    return str(entry['limits']), str(entry['name'])
