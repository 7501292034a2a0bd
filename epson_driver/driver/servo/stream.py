# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What the setpoints of a stream say together: where they go, how fast, and what the arm lags."""

from bisect import bisect_right
from collections import deque
from dataclasses import dataclass
from itertools import islice

import numpy as np

from epson_driver.driver.servo.setpoint import Setpoint, contradiction
from epson_driver.driver.state.robot_state import JointSample
from epson_driver.motion import Array, JointLimits

ESTIMATE_MEMORY_S = 0.1
"""Older positions do not count, s."""

MIN_SPAN_S = 0.02
"""Positions that came closer together say nothing of the velocity, s: they were held up."""


class VelocityEstimate:
    """Estimates velocities from positions and the times at which they came, s.

    Of the slope over ESTIMATE_MEMORY_S and that over the last step, the smaller one counts for
    each joint, and none if they differ in sign. So it is low at once when a stream comes to a
    hold, and the time that a message took hardly matters.
    """

    def __init__(self) -> None:
        self._seen: deque[tuple[float, Array]] = deque()

    def add(self, time: float, position: Array) -> Array:
        """Take a position, shape (n,), and return the velocities, shape (n,)."""
        seen = self._seen
        if seen and time - seen[-1][0] > ESTIMATE_MEMORY_S:
            seen.clear()
        seen.append((time, position))
        while time - seen[0][0] > ESTIMATE_MEMORY_S:
            seen.popleft()
        recent = next((each for each in reversed(seen) if time - each[0] >= MIN_SPAN_S), None)
        if recent is None:
            return np.zeros_like(position)
        long = (position - seen[0][1]) / (time - seen[0][0])
        short = (position - recent[1]) / (time - recent[0])
        least = np.minimum(np.abs(long), np.abs(short))
        velocities: Array = np.where(long * short > 0.0, np.sign(long) * least, 0.0)
        return velocities


CHECK_MEMORY_S = 0.4
"""Older setpoints do not count, s."""

BEHIND_S = 0.1
"""How far positions may be behind where their velocities lead, as time, s: they come late."""

TRUSTED_AFTER_S = 0.15
"""Velocities count in full once positions have agreed with them for so long, s."""


class VelocityCheck:
    """Compares positions with the integral of their velocities, over CHECK_MEMORY_S."""

    def __init__(self, limits: JointLimits) -> None:
        self._limits = limits
        self._seen: deque[tuple[float, Array, Array]] = deque()
        self.trusted = False
        """Whether the positions have agreed with the velocities for long enough."""

    def add(self, time: float, positions: Array, velocities: Array) -> str | None:
        """Take a setpoint of shapes (n,) that came at `time` s, and return what is contradictory.

        None: nothing is, so far.
        """
        seen = self._seen
        if seen and time - seen[-1][0] > CHECK_MEMORY_S:
            seen.clear()
        seen.append((time, positions, velocities))
        while time - seen[0][0] > CHECK_MEMORY_S:
            seen.popleft()
        self.trusted = False
        if len(seen) < 2:
            return None
        times = np.array([each[0] for each in seen])
        claimed = np.array([each[2] for each in seen])
        led = np.diff(times) @ (claimed[:-1] + claimed[1:]) / 2.0
        moved = positions - seen[0][1]
        said = contradiction(moved[None], led[None], claimed, self._limits, BEHIND_S)
        self.trusted = said is None and time - seen[0][0] >= TRUSTED_AFTER_S
        return said


MAX_EXTRAPOLATION_S = 0.04
"""So long after its last point a setpoint goes on with the velocity there, s: until the next one
comes, in streams of 30 Hz and more."""


class StreamReference:
    """Positions and velocities over time, from one setpoint of positions.

    They are made from all points of a window, within the range and the velocity limits. Times are
    since the setpoint came, s. `estimate`: velocities for a setpoint that has none, shape (n,).
    """

    def __init__(
        self, setpoint: Setpoint, limits: JointLimits, estimate: Array | None = None
    ) -> None:
        assert setpoint.positions is not None  # noqa: S101 - who asks knows the mode
        window = setpoint.window
        if window is None:
            times, positions = np.zeros(1), setpoint.positions[None]
            given = setpoint.velocities if setpoint.velocities is not None else estimate
            velocities = np.zeros_like(positions) if given is None else given[None]
        else:
            times, positions = window.times, window.positions
            velocities = (
                np.gradient(positions, times, axis=0)
                if window.velocities is None
                else window.velocities
            )
        self._times: list[float] = times.tolist()
        self._positions = np.clip(positions, limits.position_min, limits.position_max)
        self._velocities = np.clip(velocities, -limits.velocity, limits.velocity)
        self.fastest: Array = np.abs(self._velocities).max(axis=0)
        """The greatest speed that it has for each joint, shape (n,)."""

    @property
    def reach(self) -> float:
        """How far ahead of its arrival it is known, s, or 0 for a single setpoint."""
        return max(self._times[-1], 0.0)

    def at(self, time: float) -> tuple[Array, Array]:
        """Return position and velocity at a time, shapes (n,).

        Between points they are those of a cubic; before the first one nothing moves yet, after
        the last one its velocity goes on for MAX_EXTRAPOLATION_S.
        """
        times, positions, velocities = self._times, self._positions, self._velocities
        if time >= times[-1]:
            on = min(time - times[-1], MAX_EXTRAPOLATION_S)
            return positions[-1] + on * velocities[-1], velocities[-1]
        index = bisect_right(times, time) - 1
        if index < 0:
            return positions[0], velocities[0]
        span = times[index + 1] - times[index]
        s = (time - times[index]) / span
        before, after = positions[index], positions[index + 1]
        leaving, arriving = velocities[index] * span, velocities[index + 1] * span
        # Hermite's cubic, as before + s·leaving + s²·b + s³·a
        a = 2.0 * (before - after) + leaving + arriving
        b = 3.0 * (after - before) - 2.0 * leaving - arriving
        position = before + s * (leaving + s * (b + s * a))
        velocity = (leaving + s * (2.0 * b + s * 3.0 * a)) / span
        return position, velocity


PACE_SPAN_S = 0.1
"""A step counts as a motion in so much time at least, s: messages may come in bursts."""

PACE_MEMORY_S = 0.5
"""So long a speed counts at least, s."""


@dataclass(slots=True)
class _Passage:
    """Where a stream was at a time, s, and its speed, shapes (n,)."""

    time: float
    position: Array
    speed: Array


class StreamPace:
    """How fast a stream of positions goes itself, on the way that is still to be followed.

    It begins with a step from where the arm stands, `start`, shape (n,). Times are the loop's, s.
    """

    def __init__(self, start: Array, time: float) -> None:
        begin = _Passage(time - PACE_SPAN_S, start, np.zeros_like(start))
        self._way = deque([begin], maxlen=MAX_SENT)
        self._passed = 0

    def add(self, time: float, reference: StreamReference) -> None:
        """Take a setpoint of the stream, later than those before."""
        position, _ = reference.at(0.0)
        before = next(
            (each for each in reversed(self._way) if time - each.time >= PACE_SPAN_S), self._way[0]
        )
        span = max(time - before.time, PACE_SPAN_S)
        speed = np.maximum(np.abs(position - before.position) / span, reference.fastest)
        self._passed -= len(self._way) == self._way.maxlen
        self._way.append(_Passage(time, position, speed))

    def see(self, time: float, position: Array) -> float:
        """Return how far a place that the arm was sent to, shape (n,), is behind the stream, s."""
        way = self._way
        first = max(self._passed, 0)
        if float(np.abs(way[-1].position - position).max()) <= NEAR:
            first = len(way) - 1
        else:
            ahead = np.array([each.position for each in islice(way, first, first + NEXT)])
            first += int(np.argmin(np.abs(ahead - position).max(axis=1)))
        behind = 0.0 if first == len(way) - 1 else way[-1].time - way[first].time
        while first and time - way[0].time > PACE_MEMORY_S:
            way.popleft()
            first -= 1
        self._passed = first
        return behind

    def fastest(self) -> Array:
        """Return the greatest speed of each joint on that way, shape (n,)."""
        speeds: Array = np.array([each.speed for each in self._way]).max(axis=0)
        return speeds


NEAR = 1e-3
"""An arm so near to the last setpoint, rad or m, is there."""

MAX_SENT = 256
"""Setpoints that are remembered: five seconds of them."""

BEHIND_FILTER_S = 0.2
"""Time constant of how far the arm is taken to be behind, s."""

NEXT = 25
"""So many are compared with where the arm is, from the last that was nearest on."""


class StreamLag:
    """Compares where the arm is with where it was sent. Times are the loop's, s."""

    def __init__(self) -> None:
        self.now = 0.0
        """How long before the newest sample was measured the arm's place was sent, s; 0: it is
        where it was last sent."""
        self.behind = 0.0
        """The same, smoothed over the samples on the way. An arm that is where it was last sent
        tells nothing: one that goes from point to point is there whenever it gets the next."""
        self._seen = 0.0
        self._sent: deque[tuple[float, Array]] = deque(maxlen=MAX_SENT)

    def sent(self, time: float, position: Array) -> None:
        """Take note of what was sent, shape (n,)."""
        self._sent.append((time, position))

    def see(self, sample: JointSample) -> None:
        """Look where the arm is."""
        sent = self._sent
        if not sent:
            return
        if float(np.abs(sent[-1][1] - sample.positions).max()) <= NEAR:
            passed, self.now = len(sent) - 1, 0.0
        else:
            near = np.array([position for _, position in islice(sent, NEXT)])
            passed = int(np.argmin(np.abs(near - sample.positions).max(axis=1)))
            self.now = max(sample.measured - sent[passed][0], 0.0)
            share = min((sample.measured - self._seen) / BEHIND_FILTER_S, 1.0)
            self.behind += share * (self.now - self.behind)
        self._seen = sample.measured
        for _ in range(passed):
            sent.popleft()
