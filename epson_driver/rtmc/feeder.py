# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The targets of one smooth motion, one for each control cycle of the controller.

The smoother's motion is sampled into a ring of targets, from which the transport's thread takes
one per cycle. After the targets of the motion, the ring contains targets that brake to rest. The
thread therefore brakes the arm if the ring is not filled again, for example because the event loop
hangs. A stop replaces the targets that are not taken yet. All targets are within the limits.
"""

import math
from collections import deque
from typing import Protocol

import numpy as np

from epson_driver.motion import Array, JointLimits
from epson_driver.motion.joint_motion import fastest_stop
from epson_driver.motion.smoother import Motion, Smoother

MIN_AHEAD_S, AHEAD_S = 0.15, 0.2
"""The ring is filled up to AHEAD_S when less than MIN_AHEAD_S is left, s. Longer delays of the
event loop, for example by planning, stop the arm."""

LOOK_AHEAD_S = 1.0
"""Points are accepted while the known motion is shorter than this, s."""

MAX_POINTS_AHEAD = 1000

STOP_TARGETS = 2
"""A stop begins after this number of targets, which the thread may take meanwhile. If it takes
more, the stop is planned again, with twice this number."""


class Ring(Protocol):
    @property
    def taken(self) -> int:
        """Number of targets that the thread has sent. Repetitions of the last one do not count."""

    def replace(self, first: int, targets: Array, planned: int) -> bool:
        """Replace the targets from index `first` on. `targets`: shape (m, n), rad or m.

        The first `planned` of the new targets continue the motion, and the others brake to rest.
        Return False, and change nothing, if the target with index `first`, or a braking target,
        has already been sent.
        """


class Feeder:
    """A motion from rest at `position`, shape (n,), with one target each `cycle` s.

    The ring must be empty. After a stop, no further points are executed.
    """

    def __init__(self, limits: JointLimits, position: Array, cycle: float, ring: Ring) -> None:
        self.stopped = False
        self._why = ''
        self._limits = limits
        self._smoother = Smoother(limits, limits.settled(position))
        self._cycle = cycle
        self._ring = ring
        self._planned = self._end = 0  # index after the last target of the motion, and of the stop
        self._motions = deque([self._smoother.motion])  # of the last targets up to `_planned`

    @property
    def has_room(self) -> bool:
        smoother = self._smoother
        room = smoother.look_ahead < LOOK_AHEAD_S and smoother.points_ahead < MAX_POINTS_AHEAD
        return room and not (self.stopped or self.failed)

    def append(self, position: Array, duration: float | None, *, starts: bool) -> None:
        """Append a point. `starts`: whether it is the first point of a trajectory.

        Raises ValueError if the point is invalid or outside the position limits.
        """
        if starts:
            self._smoother.finish()
        self._smoother.append(position, duration)

    def fill(self) -> None:
        """Sample the motion into the ring. If the driver is too late for this, stop the motion."""
        smoother, cycle, taken = self._smoother, self._cycle, self._ring.taken
        ahead = self._planned - taken
        if self.stopped or not smoother.moving or ahead * cycle >= MIN_AHEAD_S:
            return
        while len(self._motions) > max(ahead, 0) + 1:
            self._motions.popleft()
        motions = smoother.steps(cycle, math.ceil(AHEAD_S / cycle) - ahead)
        if self._replace(self._planned, [motion.position for motion in motions], motions[-1]):
            self._motions.extend(motions)
        else:
            self.stop(f'the driver was delayed by more than {MIN_AHEAD_S:g} s')

    @property
    def failed(self) -> str:
        """Why the motion was not executed as requested, or ''."""
        if self._why:
            return self._why
        if self._smoother.violation is not None:
            return f'the arm brakes: {self._smoother.violation}'
        return '' if self._smoother.planner_error is None else 'the planner failed'

    @property
    def at_rest(self) -> bool:
        """Whether the motion is over, and all of its targets have been sent."""
        planned = self._smoother.moving and not self.stopped
        return not planned and self._ring.taken >= self._end

    @property
    def braking_time(self) -> float:
        """Duration of the targets that have not been sent yet, s."""
        return max(self._end - self._ring.taken, 0) * self._cycle

    def stop(self, why: str = '') -> None:
        """Brake. `why`: reason for `failed`, unless the motion has been stopped before."""
        if self.stopped:
            return
        self.stopped, self._why = True, why
        lead = STOP_TARGETS
        while (first := self._ring.taken + lead) < self._planned:
            if self._replace(first, [], self._motions[first - self._planned - 1]):
                return
            lead *= 2

    def _replace(self, first: int, positions: list[Array], last: Motion) -> bool:
        stop = fastest_stop(self._limits, last)
        count = int(np.ceil(stop.duration / self._cycle))
        times: Array = self._cycle * np.arange(1.0, count + 1.0)
        targets = np.array([*positions, *stop.positions(times)])
        if not self._ring.replace(first, targets, len(positions)):
            return False
        self._planned, self._end = first + len(positions), first + len(targets)
        return True
