# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The points of the motion, as they arrive, and the time at which it should reach each one."""

from collections import deque
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from epson_driver.motion.limits import Array, JointLimits

MERGE_TOLERANCE = 5e-4
"""Points closer than this (rad or m, in every joint) are merged into one."""

MIN_DWELL_S = 0.2
"""A repeated point with a duration of at least this commands a rest."""

MIN_MOVE = 5e-7
"""An arm at rest ignores a shorter move (rad or m), because messages carry float32."""

POSITION_TOLERANCE = 1e-9
"""A point no farther than this outside the position limits (rad or m) counts as on them."""


class Mode(StrEnum):
    """Meaning of the points' durations."""

    TIME_PRESERVING = 'time_preserving'
    """Durations are commanded where the limits allow. Without one, the limits set the speed."""

    TIME_OPTIMAL = 'time_optimal'
    """Durations are ignored: as fast as the limits allow."""


@dataclass(slots=True, eq=False)
class Waypoint:
    """A point of the motion.

    index: sequence number. anchor: position of the first of the points merged into it. position:
    target, which is the anchor, or the last merged point if nothing follows. clock: time at which
    it should be reached, s. timed: whether its clock comes from a duration. rest: duration of the
    rest there, s, or None to pass through. tiny: the move to it from rest is shorter than the
    merge tolerance. came: arrival time of the point, s.
    """

    index: int
    anchor: Array
    position: Array
    clock: float = 0.0
    timed: bool = False
    rest: float | None = None
    tiny: bool = False
    came: float = 0.0


class Waypoints:
    """The points ahead of the arm, their clock, and the limits that they are checked against.

    `origin` is the point of the arm's rest, or the start of its current segment. `last` is the
    last known point, which is the origin if `ahead` is empty. Raises ValueError if the start is
    not n finite numbers within the limits.
    """

    def __init__(self, limits: JointLimits, start: Array, mode: Mode) -> None:
        self.limits = limits
        self.mode = mode
        start = self.checked(start, None, 'the start')
        self.origin = self.last = Waypoint(0, start, start)
        self.ahead: deque[Waypoint] = deque()
        self._before = start
        """Start of the segment to the last point, shape (n,)."""
        self._beside_since: float | None = None
        """Arrival time of the first point merged into the origin during this rest, s."""
        self._rests_since = 0.0
        """Time since which the arm rests at or near the origin, s."""
        self.rest_until = 0.0
        """Commanded end of the rest at the origin, s."""
        self._number = 0
        """Number of the next point in its trajectory, for messages."""
        self._made = 0

    def append(
        self, position: Array, duration: float | None, now: float, *, in_motion: bool
    ) -> None:
        """Add a point, shape (n,), at `now` s, as `Smoother.append` does."""
        what = f'point {self._number}'
        position = self.checked(position, duration, what)
        if self.mode is Mode.TIME_OPTIMAL:
            duration = None
        ways = np.abs(position - self.last.anchor)
        joint = int(np.argmax(ways))
        slow = duration is not None and duration >= MIN_DWELL_S
        near = ways[joint] < (MERGE_TOLERANCE / 2.0 if slow else MERGE_TOLERANCE)
        if near and self._turns_back(position):
            self._add(position, duration or None, now)
        elif near or np.abs(position - self.last.position).max() <= MIN_MOVE:
            self._merge(position, duration or 0.0, now, in_motion)
        elif duration == 0.0:
            raise ValueError(
                f'{what}: duration = 0 s must be positive: {self.limits.names[joint]} has '
                f'{ways[joint]:.6g} {self.limits.units[joint]} to go'
            )
        else:
            self._add(position, duration, now)
        self._number += 1

    def waiting_since(self) -> float:
        """Return since when a point has been waiting for an arm at rest, s.

        A point that was merged during the approach waits since the rest near it began.
        """
        if self.ahead:
            return self.ahead[0].came
        return self._rests_since if self._beside_since is None else self._beside_since

    def go_back(self, now: float) -> None:
        """Add the origin as a point, because the arm rests near it and not exactly at it."""
        self._add(self.origin.position, None, now, tiny=True)

    def finish(self) -> bool:
        """End the trajectory: rest at the last point. Return whether this is a change."""
        self._number = 0
        if self.last.rest is not None:
            return False
        self.last.rest = 0.0
        return True

    def forget(self) -> None:
        """Discard the points ahead."""
        self.ahead.clear()
        self._number = 0

    def go_on_from(self, position: Array) -> None:
        """Expect a rest at a position, from which the next points continue."""
        self.origin = self.last = Waypoint(self._next_index(), position, position)

    def arrived(self, now: float, point: Waypoint | None = None) -> None:
        """Record a stop at `now` s at a waypoint, or at the origin for None."""
        if point is not None:
            self.origin = point
        self.passed(self.origin)
        self._beside_since = None
        self._rests_since = now
        self.rest_until = now + (self.origin.rest or 0.0)

    def passed(self, point: Waypoint) -> None:
        """Remove a point and the points before it from those ahead."""
        while self.ahead and self.ahead[0].index <= point.index:
            self.ahead.popleft()

    def beside_last(self, position: Array) -> bool:
        """Return whether a rest is near the last point (within the merge tolerance), not at it."""
        if self.last is not self.origin:
            return False
        return bool(np.max(np.abs(self.origin.position - position)) > MIN_MOVE)

    def time_from_rest(self, now: float) -> float:
        """Return the known time from the rest at the origin, s."""
        rested = self.origin.clock + (self.origin.rest or 0.0)
        return max(self.last.clock - rested, 0.0) + max(self.rest_until - now, 0.0)

    def checked(self, position: Array, duration: float | None, what: str) -> Array:
        """Return a position clipped to the limits, so that no later step needs to clip it.

        Raises ValueError if the position or the duration is invalid.
        """
        limits = self.limits
        position = np.array(position, dtype=float)
        if np.shape(position) != (len(limits.names),):
            raise ValueError(
                f'{what}: shape {np.shape(position)} instead of one number for each of '
                f'{len(limits.names)} joints'
            )
        for name, value, low, high, unit in zip(
            limits.names,
            position.tolist(),
            limits.position_min,
            limits.position_max,
            limits.units,
            strict=True,
        ):
            if not low - POSITION_TOLERANCE <= value <= high + POSITION_TOLERANCE:  # NaN too
                raise ValueError(
                    f'{what}, {name}: position {value:.6g} is outside the limits '
                    f'{low:.6g} … {high:.6g} {unit}'
                )
        if duration is not None and not 0.0 <= duration < np.inf:  # NaN too
            raise ValueError(f'{what}: duration = {duration} s must be finite and not negative')
        inside: Array = np.clip(position, limits.position_min, limits.position_max)
        return inside

    def _turns_back(self, position: Array) -> bool:
        """Return whether the last point, merged with this one, would be near the one before."""
        if self.last is self.origin or self.last.tiny:
            return False
        spacing, left = np.abs(np.array([self.last.anchor, position]) - self._before).max(axis=1)
        return bool(left < spacing / 2.0)

    def _merge(self, position: Array, duration: float, now: float, in_motion: bool) -> None:
        """Merge a point at (nearly) the last point. It may command a rest."""
        last = self.last
        last.position = position
        if last is self.origin and not in_motion:
            if self._beside_since is None:
                self._beside_since = now
            self.rest_until = max(self.rest_until, now) + duration
        elif duration >= MIN_DWELL_S or last.rest is not None:
            last.rest = (last.rest or 0.0) + duration
        else:
            last.clock += duration

    def _add(
        self, position: Array, duration: float | None, now: float, tiny: bool = False
    ) -> None:
        if self.last.tiny and self.ahead:
            self.ahead.pop()  # an exact rest there is no longer needed
            self.last = self.origin
        last = self.last
        if last.rest is None and last is not self.origin:
            last.position = last.anchor  # no longer the end, so the first merged point counts
        if duration is None:
            time = float(np.max(np.abs(position - last.position) / self.limits.velocity))
        else:
            time = duration
        self._before = last.position
        clock = last.clock + (last.rest or 0.0) + time
        anchor = last.anchor if tiny else position
        timed = duration is not None
        self.last = Waypoint(
            self._next_index(), anchor, position, clock, timed, tiny=tiny, came=now
        )
        self.ahead.append(self.last)

    def _next_index(self) -> int:
        self._made += 1
        return self._made
