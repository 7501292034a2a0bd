# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""From one share of the planned speeds to another, on the same path, inside all limits.

The plan's clock, τ(t), gets another pace: τ′ goes from 1 to a ratio r by two parabolas, and stays.
A joint then has
    velocity      q̇ τ′
    acceleration  q̈ τ′² + q̇ τ″
    jerk          q⃛ τ′³ + 3 q̈ τ′τ″ + q̇ τ‴
for q(τ) as planned. So it goes where the plan went, and for r < 1 nowhere sooner. What is executed
is verified as any plan is.
"""

from dataclasses import dataclass

import numpy as np

from epson_driver.motion.limits import Array, JointLimits
from epson_driver.motion.smoother.limit_usage import limit_usage
from epson_driver.motion.smoother.path import Path
from epson_driver.motion.smoother.time_parametrisation import (
    TimeParametrisation,
    through_states,
)

MIN_RAMP_S, MAX_RAMP_S, RAMP_RATIO = 0.02, 2.5, 1.2
"""The shortest ramp that is tried, the longest, and from one to the next, relative."""

MIN_STEP_S, MAX_STEP_S = 1e-4, 4e-3
"""Time between two states that a ramp passes exactly: where the plan has breakpoints, its jerk
jumps with that of the path. What is nearer is left to rounding."""

STEEPEST_SHARE = 0.75
"""After so much of a ramp to a lower pace it is steepest (after the rest, to a higher one): a plan
that uses its limits has room only once it is a little slower."""

NEWTON_STEPS = 8
"""From the mean pace: the pace is monotonous, so each step is towards the time."""

_BESIDE_S = 1e-8

LIKELY_EXCESS_RATIO = 1.002
"""What exceeds a limit by more than this at the states is not verified."""


def shortest(
    path: Path, timing: TimeParametrisation, ratio: float, limits: JointLimits, spare: float
) -> tuple[TimeParametrisation, float] | None:
    """Return a verified timing that reaches `ratio` times the speeds of one, and when, or None.

    It goes from the start of that to its end, of which at least `spare` s are left then, at the
    pace of before.
    """
    steps = _Steps(path, timing, limits)
    left = timing.duration - steps.begin - spare
    end, duration = 0, MIN_RAMP_S
    while duration <= MAX_RAMP_S:
        # a ramp of this duration passes the mean of both paces of the plan's time
        index = int(steps.times.searchsorted(duration * mean_pace(ratio)))
        duration *= RAMP_RATIO
        if index >= len(steps.times) or steps.times[index] > left:
            break
        if index == end:
            continue
        end = index
        if steps.excess(ratio, end) > LIKELY_EXCESS_RATIO:
            continue
        ramped, settled = steps.ramped(timing, ratio, end)
        if limit_usage(path, ramped, limits).allowed:
            return ramped, settled
    return None


class _Steps:
    """The plan at times from its first breakpoint on, and what its joints do there.

    times: since that breakpoint, which comes after `begin` s, shape (m,); u, v, a: the timing's
    then. What joints do is known just before and just after each of the times, shape (2, m, n).
    """

    def __init__(self, path: Path, timing: TimeParametrisation, limits: JointLimits) -> None:
        breaks = timing.times[1:]
        until = breaks[0] + 2.0 * MAX_RAMP_S
        breaks = breaks[breaks <= until]
        kept = [float(breaks[0])]
        for time in breaks[1:].tolist():
            if time - kept[-1] >= MIN_STEP_S:
                kept.append(time)
        self.begin = kept[0]
        gaps = np.diff(kept)
        parts = np.maximum(np.ceil(gaps / MAX_STEP_S).astype(int), 1)
        whole = np.append(0, np.cumsum(parts))
        self.times = np.interp(np.arange(whole[-1] + 1), whole, kept) - self.begin
        at = self.times + self.begin
        self.u, self.v, self.a, _ = timing.sample(at)
        # jerk jumps there: just before, and just after
        both = np.maximum(np.stack([at - _BESIDE_S, at + _BESIDE_S]), 0.0)
        u, v, a, j = (column[:, :, None] for column in timing.sample(both))
        _, first, second, third = (
            values.reshape(2, len(at), -1) for values in path.sample(u.ravel())
        )
        self._velocity = first * v
        self._acceleration = first * a + second * v**2
        self._jerk = first * j + 3.0 * second * v * a + third * v**3
        self._limits = limits

    def excess(self, ratio: float, end: int) -> float:
        """Return what a ramp to a later one of the times would use of the limits at them."""
        clock = _Clock(ratio, float(self.times[end]))
        part = slice(0, end + 1)
        pace, slope, bend = (column[:, None] for column in clock.at(clock.when(self.times[part])))
        v, a = self._velocity[:, part], self._acceleration[:, part]
        acceleration = a * pace**2 + v * slope
        jerk = self._jerk[:, part] * pace**3 + 3.0 * a * pace * slope + v * bend
        return float(
            max(
                np.max(np.abs(acceleration) / self._limits.acceleration),
                np.max(np.abs(jerk) / self._limits.jerk),
            )
        )

    def ramped(
        self, timing: TimeParametrisation, ratio: float, end: int
    ) -> tuple[TimeParametrisation, float]:
        """Return the timing with a ramp to one of the times, and when that is over, s."""
        part = slice(0, end + 1)
        clock = _Clock(ratio, float(self.times[end]))
        times = clock.when(self.times[part])
        pace, slope, _ = clock.at(times)
        u, v, a = self.u[part], self.v[part], self.a[part]
        ramp = through_states(times, u, v * pace, a * pace**2 + v * slope)
        head, tail = timing.part(0.0, self.begin), timing.part(self.begin + self.times[end])
        if head is not None:
            ramp = head.then(ramp)
        settled = ramp.duration
        return ramp if tail is None else ramp.then(tail.at_share(ratio)), settled


@dataclass(frozen=True, slots=True)
class _Clock:
    """A plan's clock while its pace goes from 1 to `ratio`, which takes `passed` s of its time."""

    ratio: float
    passed: float

    @property
    def steepest(self) -> float:
        """Where in the ramp the pace changes most: where there is most room to."""
        return STEEPEST_SHARE if self.ratio < 1.0 else 1.0 - STEEPEST_SHARE

    @property
    def duration(self) -> float:
        """How long it takes, s."""
        return self.passed / mean_pace(self.ratio)

    def at(self, times: Array) -> tuple[Array, Array, Array]:
        """Return the pace and its first two derivatives, shapes (m,)."""
        x, m, change = times / self.duration, self.steepest, self.ratio - 1.0
        early = x < m
        rise = np.where(early, x**2 / m, 1.0 - (1.0 - x) ** 2 / (1.0 - m))
        slope = np.where(early, x / m, (1.0 - x) / (1.0 - m)) * (2.0 / self.duration)
        bend = np.where(early, 1.0 / m, 1.0 / (m - 1.0)) * (2.0 / self.duration**2)
        return 1.0 + change * rise, change * slope, change * bend

    def when(self, passed: Array) -> Array:
        """Return when so much of the plan's time has passed, shape (m,), by Newton's method."""
        m, duration, change = self.steepest, self.duration, self.ratio - 1.0
        times = passed * (duration / self.passed)
        for _ in range(NEWTON_STEPS):
            x = times / duration
            late = (1.0 - x) ** 3 / (3.0 * (1.0 - m)) + x - (1.0 + m) / 3.0
            total = np.where(x < m, x**3 / (3.0 * m), late)
            over = times + change * duration * total - passed
            times = np.clip(times - over / self.at(times)[0], 0.0, duration)
        times[-1] = duration if passed[-1] == self.passed else times[-1]
        return times


def mean_pace(ratio: float) -> float:
    """Return the mean pace of a ramp from 1 to a ratio."""
    share = STEEPEST_SHARE if ratio < 1.0 else 1.0 - STEEPEST_SHARE
    return 1.0 + (ratio - 1.0) * (2.0 - share) / 3.0
