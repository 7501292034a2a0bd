# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The targets of one smooth motion, one for each control cycle of the controller.

The smoother's motion is sampled into a ring of targets, from which the transport's thread takes
one per cycle. After the targets of the motion, the ring contains targets that brake to rest. The
thread therefore brakes the arm if the ring is not filled again, for example because the event loop
hangs. A stop, and a change of the rate along the motion, replace the targets that are not taken
yet. All targets are within the limits.
"""

import math
from collections.abc import Callable
from typing import Protocol

import numpy as np

from epson_driver.motion import Array, JointLimits
from epson_driver.motion.joint_motion import fastest_stop
from epson_driver.motion.smoother import Motion
from epson_driver.motion.smoother.output_guard import OutputGuard
from epson_driver.motion.time_parametrisation import TimeParametrisation
from epson_driver.rtmc.known_motion import KnownMotion, ramp

MIN_AHEAD_S, AHEAD_S = 0.15, 0.2
"""The ring is filled up to AHEAD_S when less than MIN_AHEAD_S is left, s. Longer delays of the
event loop, for example by planning, stop the arm."""

LOOK_AHEAD_S = 1.0
"""Points are accepted while the known motion is shorter than this, s."""

MAX_POINTS_AHEAD = 1000

KNOWN_S = 0.5
"""Time for which the motion after the ring is known, so that ramps of the rate can be checked."""

RAMP_SHARES = (1.0, 0.7, 0.5, 0.35, 0.25, 0.18, 0.12)
"""Shares of the fastest ramp of the rate that are tried until one is within the limits."""

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

    `rate()` returns the requested rate along the motion, above 0. An arm at rest starts with it.
    A moving arm changes its rate as soon and as fast as the limits allow. The ring must be empty.
    After a stop, no further points are executed.
    """

    def __init__(
        self,
        limits: JointLimits,
        position: Array,
        cycle: float,
        ring: Ring,
        rate: Callable[[], float] = lambda: 1.0,
    ) -> None:
        self.stopped = False
        self._why = ''
        self._limits = limits
        self._smoother = KnownMotion(limits, limits.settled(position))
        self._cycle = cycle
        self._ring = ring
        self._requested = rate
        self._planned = self._end = 0  # index after the last target of the motion, and of the stop
        self._time = 0.0  # of the smoother, at the last target of the motion
        self._first = 0  # first target with these times of the smoother, and their final rate
        self._timing, self._final = ramp((0.0, rate(), 0.0), rate()), rate()

    @property
    def has_room(self) -> bool:
        smoother = self._smoother
        room = smoother.look_ahead < LOOK_AHEAD_S and smoother.points_ahead < MAX_POINTS_AHEAD
        return room and not (self.stopped or self.failed)

    @property
    def rate(self) -> float:
        """Rate along the motion at the last target that was sent."""
        return self._timing.at(max(self._ring.taken - self._first, 0) * self._cycle)[1]

    def append(self, position: Array, duration: float | None, *, starts: bool) -> None:
        """Append a point. `starts`: whether it is the first point of a trajectory.

        Raises ValueError if the point is invalid or outside the position limits.
        """
        if starts:
            self._smoother.finish()
        self._smoother.append(position, duration)

    def fill(self) -> None:
        """Sample the motion into the ring. If the driver is too late for this, stop the motion."""
        smoother, cycle = self._smoother, self._cycle
        if self.stopped or not self._goes_on:
            return
        lacking = self._time + AHEAD_S - smoother.now  # and more, gradually
        lacking = max(lacking, min(lacking + KNOWN_S, AHEAD_S - MIN_AHEAD_S))
        smoother.steps(cycle, math.ceil(lacking / cycle))
        if self.failed:
            return
        self._change_rate(self._requested())
        ahead = self._planned - self._ring.taken
        if ahead * cycle >= MIN_AHEAD_S:
            return
        if not self._write(self._planned, self._timing, math.ceil(AHEAD_S / cycle) - ahead):
            self.stop(f'the driver was delayed by more than {MIN_AHEAD_S:g} s')

    def _change_rate(self, rate: float) -> None:
        """Change the rate from a target on that the thread has not taken, if the limits allow."""
        last, lead = self._before(self._planned), STOP_TARGETS
        if not (last.velocity.any() or last.acceleration.any()):
            self._first, self._final = self._planned, rate
            self._timing = ramp((self._time, rate, 0.0), rate)
        while rate != self._final:
            first = min(self._next(lead), self._planned)
            timing = self._ramp(first, rate)
            if timing is None:
                return
            if first == self._planned or self._write(first, timing, self._planned - first):
                self._first, self._timing, self._final = first, timing, rate
            lead *= 2

    def _ramp(self, first: int, rate: float) -> TimeParametrisation | None:
        """Return the fastest ramp from target `first` on that is within the limits, or None."""
        smoother, state = self._smoother, self._timing.at((first - self._first) * self._cycle)
        for share in RAMP_SHARES:
            timing = ramp(state, rate, share)
            count = math.ceil(timing.times[-2] / self._cycle) + 1
            u, motions = smoother.sample(timing, self._cycle * np.arange(1.0, count + 1.0))
            guard = OutputGuard(self._before(first))
            known = u[-1] < smoother.now or not smoother.moving
            if known and guard.allows(motions, self._cycle, self._limits):
                return timing
        return None

    @property
    def failed(self) -> str:
        """Why the motion was not executed as requested, or ''."""
        if self._why:
            return self._why
        if self._smoother.violation is not None:
            return f'the arm brakes: {self._smoother.violation}'
        return '' if self._smoother.planner_error is None else 'the planner failed'

    @property
    def _goes_on(self) -> bool:
        return self._smoother.moving or self._time < self._smoother.now

    @property
    def at_rest(self) -> bool:
        """Whether the motion is over, and all of its targets have been sent."""
        return (self.stopped or not self._goes_on) and self._ring.taken >= self._end

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
        while (first := self._next(lead)) < self._planned:
            last = self._before(first)
            if self._replace(first, np.empty((0, len(last.position))), last):
                return
            lead *= 2

    def _write(self, first: int, timing: TimeParametrisation, count: int) -> bool:
        """Write `count` targets of the motion from index `first` on, or fewer if it ends."""
        since = first - self._first if timing is self._timing else 0
        times = self._cycle * np.arange(since + 1.0, since + count + 1.0)
        u, motions = self._smoother.sample(timing, times)
        count = int(u.searchsorted(self._smoother.now)) + 1
        motions = Motion(*(part[:count] for part in motions))
        if not self._replace(first, motions.position, Motion(*(part[-1] for part in motions))):
            return False
        self._time = float(u[:count][-1])
        return True

    def _next(self, lead: int) -> int:
        """Return the first target that can be replaced. `lead`: targets that may be taken."""
        return max(self._ring.taken + lead, self._first)

    def _before(self, index: int) -> Motion:
        """Return the motion at the target before index `index`, which is not below `_first`."""
        time = np.array([(index - self._first) * self._cycle])
        return Motion(*(part[0] for part in self._smoother.sample(self._timing, time)[1]))

    def _replace(self, first: int, positions: Array, last: Motion) -> bool:
        stop = fastest_stop(self._limits, last)
        count = int(np.ceil(stop.duration / self._cycle))
        times: Array = self._cycle * np.arange(1.0, count + 1.0)
        targets = np.concatenate([positions, stop.positions(times)])
        if not self._ring.replace(first, targets, len(positions)):
            return False
        self._planned, self._end = first + len(positions), first + len(targets)
        return True
