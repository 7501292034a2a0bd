# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The points of the motion as they arrive, and the times at which they should be reached."""

from collections import deque
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from epson_driver.motion.limits import Array, JointLimits

MERGE_TOLERANCE = 5e-4
"""Distance below which two points are merged into one, rad or m in every joint."""

MIN_DWELL_S = 0.2
"""Minimum duration of a repeated point that counts as a commanded rest, s."""

MIN_MOVE = 5e-7
"""Minimum move of an arm at rest, rad or m. Less is ignored, because messages carry float32."""

POSITION_TOLERANCE = 1e-9
"""Tolerance for rounding at a position limit, rad or m."""


class Mode(StrEnum):
    """Meaning of the points' durations."""

    TIME_PRESERVING = 'time_preserving'
    """Durations are respected where the limits allow. A point without a duration is reached as
    fast as the limits allow."""

    TIME_OPTIMAL = 'time_optimal'
    """Durations are ignored. The motion is as fast as the limits allow."""


@dataclass(slots=True, eq=False)
class Waypoint:
    """A point of the motion, possibly merged from several received points."""

    index: int
    anchor: Array
    """Position of the first merged point, shape (n,)."""
    position: Array
    """Target, shape (n,). It is the last merged point, until another waypoint follows. After that
    it is the anchor."""
    clock: float = 0.0
    """Time at which the waypoint should be reached, s."""
    timed: bool = False
    """Whether `clock` comes from a duration."""
    rest: float | None = None
    """Duration of the rest at the waypoint, s, or None to pass through."""
    tiny: bool = False
    """Whether the move to the waypoint starts at rest and is shorter than the merge tolerance."""
    arrival: float = 0.0
    """Time at which the point was received, s."""


class Waypoints:
    """The points `ahead` of the arm, and the limits against which points are checked.

    `origin` is the waypoint at which the arm rested last. `last` is the last waypoint ahead, or
    else the origin.
    Raises ValueError if `start` is invalid or outside the limits.
    """

    def __init__(self, limits: JointLimits, start: Array, mode: Mode) -> None:
        self.limits = limits
        self.mode = mode
        start = self.checked(start, None, 'the start')
        self.origin = self.last = Waypoint(0, start, start)
        self.ahead: deque[Waypoint] = deque()
        self._before = start
        """Start of the segment to the last waypoint."""
        self._merged_since: float | None = None
        """Time of the first point that was merged into the arm's position in this rest, s."""
        self._rest_start = 0.0
        self.rest_until = 0.0
        """Commanded end of the rest at the origin, s."""
        self._number = 0
        """Number of the next point within its trajectory, for error texts."""
        self._last_index = 0

    def append(
        self, position: Array, duration: float | None, now: float, *, in_motion: bool
    ) -> None:
        """Add a point that is received at `now`, s. Raises ValueError if it is invalid."""
        name = f'point {self._number}'
        position = self.checked(position, duration, name)
        if self.mode is Mode.TIME_OPTIMAL:
            duration = None
        distances = np.abs(position - self.last.anchor)
        joint = int(np.argmax(distances))
        slow = duration is not None and duration >= MIN_DWELL_S
        near = distances[joint] < (MERGE_TOLERANCE / 2.0 if slow else MERGE_TOLERANCE)
        if near and self._turns_back(position):
            self._add(position, duration or None, now)
        elif near or np.abs(position - self.last.position).max() <= MIN_MOVE:
            self._merge(position, duration or 0.0, now, in_motion)
        elif duration == 0.0:
            raise ValueError(
                f'{name}: duration = 0 s must be positive: {self.limits.names[joint]} has '
                f'{distances[joint]:.6g} {self.limits.units[joint]} to go'
            )
        else:
            self._add(position, duration, now)
        self._number += 1

    def waiting_since(self) -> float:
        """Return the time since which the first point ahead waits for a start from rest, s.

        For a point that was merged into the origin before the rest, it is the start of the rest.
        """
        if self.ahead:
            return self.ahead[0].arrival
        return self._rest_start if self._merged_since is None else self._merged_since

    def return_to_origin(self, now: float) -> None:
        """Add the origin as a point ahead, because the arm rests near the origin, not at it."""
        self._add(self.origin.position, None, now, tiny=True)

    def finish(self) -> bool:
        """End the trajectory with a rest at the last point. Return False if it already does."""
        self._number = 0
        if self.last.rest is not None:
            return False
        self.last.rest = 0.0
        return True

    def forget(self) -> None:
        self.ahead.clear()
        self._number = 0

    def continue_from(self, position: Array) -> None:
        """Expect that the arm will rest at a position. The next points start there."""
        self.origin = self.last = Waypoint(self._next_index(), position, position)

    def arrived(self, now: float, point: Waypoint | None = None) -> None:
        """Record that the arm has come to rest at a waypoint at the time `now`, s.

        point: the waypoint. None: the origin.
        """
        if point is not None:
            self.origin = point
        self.passed(self.origin)
        self._merged_since = None
        self._rest_start = now
        self.rest_until = now + (self.origin.rest or 0.0)

    def passed(self, point: Waypoint) -> None:
        """Remove a waypoint, and the ones before it, from the waypoints ahead."""
        while self.ahead and self.ahead[0].index <= point.index:
            self.ahead.popleft()

    def near_last(self, position: Array) -> bool:
        if self.last is not self.origin:
            return False
        return bool(np.max(np.abs(self.origin.position - position)) > MIN_MOVE)

    def time_from_rest(self, now: float) -> float:
        """Return the duration of the motion to all points ahead, from rest at the origin, s."""
        rested = self.origin.clock + (self.origin.rest or 0.0)
        return max(self.last.clock - rested, 0.0) + max(self.rest_until - now, 0.0)

    def checked(self, position: Array, duration: float | None, name: str) -> Array:
        """Return a position, clipped to the limits if it exceeds them only by rounding.

        Raises ValueError if the position or the duration is invalid. name: for the error text.
        """
        limits = self.limits
        position = np.array(position, dtype=float)
        if np.shape(position) != (len(limits.names),):
            raise ValueError(
                f'{name}: shape {np.shape(position)} instead of one number for each of '
                f'{len(limits.names)} joints'
            )
        for joint, value, low, high, unit in zip(
            limits.names,
            position.tolist(),
            limits.position_min,
            limits.position_max,
            limits.units,
            strict=True,
        ):
            if not low - POSITION_TOLERANCE <= value <= high + POSITION_TOLERANCE:  # NaN too
                raise ValueError(
                    f'{name}, {joint}: position {value:.6g} is outside the limits '
                    f'{low:.6g} … {high:.6g} {unit}'
                )
        if duration is not None and not 0.0 <= duration < np.inf:  # NaN too
            raise ValueError(f'{name}: duration = {duration} s must be finite and not negative')
        inside: Array = np.clip(position, limits.position_min, limits.position_max)
        return inside

    def _turns_back(self, position: Array) -> bool:
        """Return whether a point turns back to the start of the last segment.

        The point does so if its distance from this start is less than half the segment's length.
        """
        if self.last is self.origin or self.last.tiny:
            return False
        last, new = np.abs(np.array([self.last.anchor, position]) - self._before).max(axis=1)
        return bool(new < last / 2.0)

    def _merge(self, position: Array, duration: float, now: float, in_motion: bool) -> None:
        """Merge a point into the last waypoint. Its duration may become a rest at the waypoint."""
        last = self.last
        last.position = position
        if last is self.origin and not in_motion:
            if self._merged_since is None:
                self._merged_since = now
            self.rest_until = max(self.rest_until, now) + duration
        elif duration >= MIN_DWELL_S or last.rest is not None:
            last.rest = (last.rest or 0.0) + duration
        else:
            last.clock += duration

    def _add(
        self, position: Array, duration: float | None, now: float, tiny: bool = False
    ) -> None:
        if self.last.tiny and self.ahead:
            self.ahead.pop()  # the return to the origin is no longer needed
            self.last = self.origin
        last = self.last
        if last.rest is None and last is not self.origin:
            last.position = last.anchor  # because another waypoint follows
        if duration is None:
            time = float(np.max(np.abs(position - last.position) / self.limits.velocity))
        else:
            time = duration
        self._before = last.position
        clock = last.clock + (last.rest or 0.0) + time
        anchor = last.anchor if tiny else position
        timed = duration is not None
        self.last = Waypoint(
            self._next_index(), anchor, position, clock, timed, tiny=tiny, arrival=now
        )
        self.ahead.append(self.last)

    def _next_index(self) -> int:
        self._last_index += 1
        return self._last_index
