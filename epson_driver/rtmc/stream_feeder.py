# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The targets of an arm that follows a stream of setpoints.

Each command of the stream replaces the targets that have not been sent. The new targets end at
rest, so the arm stops by itself if no further command arrives.
"""

from collections.abc import Callable

import numpy as np

from epson_driver.motion import Array, JointLimits
from epson_driver.motion.joint_motion import State
from epson_driver.motion.setpoint_tracker import ServoTarget, SetpointTracker
from epson_driver.rtmc.feeder import STOP_TARGETS, Ring

HORIZON_S = 0.03
"""Duration of a step of the tracker, s. It is longer than the time between two commands, which may
be late."""

LEAD_S = 0.054
"""Time by which the arm is later than a command, with the controller's buffer and a step, s."""


class StreamFeeder(SetpointTracker):
    """A tracker whose motion is sent as targets through a ring, between `begin` and `end`.

    `wants_motion(feeder)` is called when a command would move the arm before `begin`. After
    `stop`, all commands are ignored.
    """

    failed = ''

    def __init__(
        self,
        limits: JointLimits,
        position: Array,
        wants_motion: Callable[['StreamFeeder'], None],
    ) -> None:
        self.stopped = False
        self._wants_motion = wants_motion
        self._ring: Ring | None = None
        self._cycle = 0.0
        self._first = self._now = self._end = 0
        super().__init__(limits, position)

    def begin(self, position: Array, cycle: float, ring: Ring) -> None:
        """Start at rest at `position`, with an empty `ring` and one target each `cycle` s."""
        self._cycle, self._ring = cycle, ring
        self._first = self._now = self._end = 0
        super().__init__(self.limits, self.limits.settled(position))

    def end(self) -> None:
        """Stop writing targets."""
        self._ring = None
        super().__init__(self.limits, self.motion.end)

    @property
    def time(self) -> float:
        """Time from the start of the motion to the next target that can be replaced, s."""
        return (self._now - self._first) * self._cycle

    @time.setter
    def time(self, _zero: float) -> None:
        self._first = self._now

    @property
    def at_rest(self) -> bool:
        return self._ring is None or self._ring.taken >= self._end

    @property
    def braking_time(self) -> float:
        return self.remaining

    def fill(self) -> None:
        """Do nothing, because each command writes its targets."""

    def step(self, dt: float) -> State:
        """Return the state at the next target that can be replaced. `dt` has no effect."""
        self._look(STOP_TARGETS)
        return self.state

    def follow(self, dt: float, aim: ServoTarget, speed: float | Array = 1.0) -> None:
        self._command(lambda: super(StreamFeeder, self).follow(HORIZON_S, aim, speed))

    def move(self, dt: float, velocities: Array) -> None:
        self._command(lambda: super(StreamFeeder, self).move(HORIZON_S, velocities))

    def brake(self, target: Array | None = None, speed: float | Array = 1.0) -> None:
        self._command(lambda: super(StreamFeeder, self).brake(target, speed))

    def stop(self, why: str = '') -> None:
        """Brake. `why`: reason for `failed`, unless the motion has been stopped before."""
        if not self.stopped:
            self._command(super().brake)
            self.stopped, self.failed = True, why

    def _look(self, lead: int) -> None:
        if self._ring is not None:
            self._now = max(min(self._ring.taken + lead, self._end), self._first)

    def _command(self, act: Callable[[], None]) -> None:
        """Call `act`, which changes the motion from the next replaceable target on."""
        if self.stopped:
            return
        before, lead = (self.motion, self._first, self._final), STOP_TARGETS
        while True:
            self._look(lead)
            act()
            if self.motion is before[0]:
                return
            if self._ring is None:
                super().__init__(self.limits, self.motion.at(0.0)[0])
                self._wants_motion(self)
                return
            if self._replace(self._ring):
                return
            self.motion, self._first, self._final = before
            lead *= 2

    def _replace(self, ring: Ring) -> bool:
        count = int(np.ceil(self.motion.duration / self._cycle))
        times: Array = self._cycle * np.arange(1.0, count + 1.0)
        targets = self.motion.positions(times)
        if count and not ring.replace(self._first, targets, count):
            return False
        self._end = self._first + count
        return True
