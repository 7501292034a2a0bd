# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Exact extrema of a smoother's executed motion, at every instant instead of at samples.

Samples could miss a peak between two of them. The extrema are independent of the package's own
verification. The executed pieces are split at the passages of the knots (by bisection), each
derivative is interpolated at Chebyshev nodes, which is exact for a polynomial, and evaluated at
the zeros of its own derivative.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.polynomial import chebyshev

from epson_driver.motion import Array, JointLimits
from epson_driver.motion.joint_motion import JointMotion
from epson_driver.motion.smoother import Smoother
from epson_driver.motion.smoother.request import ActivePlan

NODES = chebyshev.chebpts1(17)
_TO_SERIES = np.linalg.inv(chebyshev.chebvander(NODES, 16))
_S = (NODES + 1.0) / 2.0

Derivatives = Callable[[Array], tuple[Array, Array, Array, Array]]
"""Function from times since the starts of m spans, shape (m, k), to position … jerk, shapes (m, k,
n)."""

State = tuple[Array, Array, Array]
Spans = tuple[Array, Derivatives, State, State]
"""Durations of m spans, shape (m,), the function of their derivatives, and the states at both
ends."""


class Recorded(Smoother):
    """A smoother that records its execution: start times, and the plan, joint motion or rest."""

    def __init__(self, *args: Any, **named: Any) -> None:
        self.executed: list[tuple[float, ActivePlan | JointMotion | None]] = [(0.0, None)]
        super().__init__(*args, observer=self._record, **named)

    def _record(self, now: float, what: ActivePlan | JointMotion | None) -> None:
        self.executed.append((now, what))


@dataclass
class Extrema:
    """Largest multiples of the limits. outside, position_jump: rad.

    velocity_jump, acceleration_jump: multiples of the limits.
    """

    velocity: float = 0.0
    acceleration: float = 0.0
    jerk: float = 0.0
    outside: float = 0.0
    position_jump: float = 0.0
    velocity_jump: float = 0.0
    acceleration_jump: float = 0.0

    def add(self, **values: float) -> None:
        """Update with larger values."""
        for name, value in values.items():
            setattr(self, name, max(getattr(self, name), value))

    def extend(self, spans: Spans, limits: JointLimits, state: State) -> State:
        """Include the spans that follow a state, and return the state at their end."""
        durations, derivatives, first, last = spans
        self.add(
            position_jump=float(np.max(np.abs(first[0] - state[0]))),
            velocity_jump=float(np.max(np.abs(first[1] - state[1]) / limits.velocity)),
            acceleration_jump=float(np.max(np.abs(first[2] - state[2]) / limits.acceleration)),
        )
        q, v, a, j = derivatives(durations[:, None] * _S)
        outside = np.maximum(_largest(q - limits.position_max), _largest(limits.position_min - q))
        self.add(
            outside=outside,
            velocity=max(_largest(v / limits.velocity), _largest(-v / limits.velocity)),
            acceleration=max(
                _largest(a / limits.acceleration), _largest(-a / limits.acceleration)
            ),
            jerk=max(_largest(j / limits.jerk), _largest(-j / limits.jerk)),
        )
        return last

    @property
    def worst(self) -> float:
        """The largest multiple of a limit."""
        return max(self.velocity, self.acceleration, self.jerk)


def exact_extrema(smoother: Recorded, start: Array) -> Extrema:
    """Return the extrema of all motion executed since the arm rested at `start`, shape (n,)."""
    result = Extrema()
    zeros = np.zeros(len(smoother.limits.names))
    state: State = (start, zeros, zeros)
    ends = [first for first, _ in smoother.executed[1:]] + [smoother.now]
    for (first, what), end in zip(smoother.executed, ends, strict=True):
        if what is None and end > first:
            state = (state[0], zeros, zeros)
        spans = executed_spans(what, first, end)
        if spans is not None:
            state = result.extend(spans, smoother.limits, state)
    return result


def executed_spans(
    what: ActivePlan | JointMotion | None, begin: float, end: float
) -> Spans | None:
    """Return the executed spans from `begin` to `end`, s, or None."""
    if what is None:
        return None
    if isinstance(what, ActivePlan):
        return _plan_spans(what, begin - what.start, end - what.start)
    return _joint_spans(what, end - begin)


def _largest(values: Array) -> float:
    """Return the maximum of polynomials given at the nodes, shape (m, 17, n)."""
    series = np.moveaxis(_TO_SERIES @ values, 1, 2).reshape(-1, 17)
    signs = (-1.0) ** np.arange(17)
    best = float(max(series.sum(axis=1).max(), (series @ signs).max(), values.max()))
    bounds = series[:, 0] + np.abs(series[:, 1:]).sum(axis=1)
    for index in np.argsort(-bounds):
        if bounds[index] <= best + 1e-10 * abs(best):
            break
        roots = chebyshev.chebroots(chebyshev.chebder(series[index]))
        inside = roots[np.abs(roots.real) <= 1.0].real
        if len(inside):
            best = max(best, float(chebyshev.chebval(inside, series[index]).max()))
    return best


def _quintics(active: ActivePlan) -> Array:
    """Return the coefficients of each segment by u from its first knot, (k - 1, 6, n)."""
    knots = active.path.knots
    h = np.diff(knots.u)
    result = []
    for i, length in enumerate(h):
        powers = length ** np.arange(6)
        matrix = np.zeros((6, 6))
        matrix[0, 0] = matrix[1, 1] = 1.0
        matrix[2, 2] = 2.0
        matrix[3] = 1.0
        matrix[4] = np.arange(6)
        matrix[5] = np.arange(6) * np.arange(-1, 5)
        right = [
            knots.position[i] * 0.0, knots.first[i] * length, knots.second[i] * length**2,
            knots.position[i + 1] - knots.position[i], knots.first[i + 1] * length,
            knots.second[i + 1] * length**2,
        ]  # fmt: skip
        segment = np.linalg.solve(matrix, np.array(right)) / powers[:, None]
        segment[0] = knots.position[i]
        result.append(segment)
    return np.array(result)


def _plan_spans(active: ActivePlan, begin: float, end: float) -> Spans | None:
    """Return the durations of a plan's parts, the function of their derivatives, and both ends."""
    timing, knots = active.timing, active.path.knots.u
    end = min(end, timing.duration)
    if end <= begin:
        return None
    pieces = []
    for piece, (since, until) in enumerate(zip(timing.times[:-1], timing.times[1:], strict=True)):
        low, high = max(since, begin), min(until, end)
        if high <= low:
            continue
        u, v, a = timing.positions[piece], timing.velocities[piece], timing.accelerations[piece]
        j = timing.jerks[piece]
        cuts = [low - since, high - since]
        reach = [u + t * (v + t * (a / 2 + t * j / 6)) for t in cuts]
        for knot in knots[(knots > reach[0] + 1e-12) & (knots < reach[1] - 1e-12)]:
            below, above = cuts[0], cuts[-1]
            for _ in range(80):  # u rises, so bisection finds the passage to rounding
                guess = (below + above) / 2.0
                if u + guess * (v + guess * (a / 2 + guess * j / 6)) < knot:
                    below = guess
                else:
                    above = guess
            cuts.insert(-1, guess)
        for t, t_end in pairwise(cuts):
            middle = (t + t_end) / 2.0
            where = u + middle * (v + middle * (a / 2 + middle * j / 6))
            segment = int(np.clip(np.sum(knots <= where) - 1, 0, len(knots) - 2))
            pieces.append(
                (
                    t_end - t, segment,
                    u - knots[segment] + t * (v + t * (a / 2 + t * j / 6)),
                    v + t * (a + t * j / 2), a + t * j, j,
                )
            )  # fmt: skip
    columns = [np.array(column) for column in zip(*pieces, strict=True)]
    durations, segments, (o, v, a, j) = columns[0], columns[1].astype(int), columns[2:]
    c = _quintics(active)[segments]  # (m, 6, n)

    def derivatives(t: Array) -> tuple[Array, Array, Array, Array]:
        w = (o[:, None] + t * (v[:, None] + t * (a[:, None] / 2 + t * j[:, None] / 6)))[..., None]
        x = (v[:, None] + t * (a[:, None] + t * j[:, None] / 2))[..., None]
        y = (a[:, None] + t * j[:, None])[..., None]
        z = j[:, None, None]
        of_u = []
        for order in range(4):
            total = np.zeros((*t.shape, c.shape[2]))
            for n in range(5, order - 1, -1):
                total = total * w + c[:, None, n] * float(np.prod(np.arange(n, n - order, -1)))
            of_u.append(total)
        q, q1, q2, q3 = of_u
        return q, q1 * x, q1 * y + q2 * x**2, q1 * z + 3 * q2 * x * y + q3 * x**3

    return durations, derivatives, *both_ends(durations, derivatives)


def _joint_spans(motion: JointMotion, end: float) -> Spans | None:
    """Return the same for a joint motion."""
    times, jerks, states = motion.times, motion.jerks, motion.states
    cuts = np.unique(np.clip(np.append(times.ravel(), end), 0.0, end))
    if len(cuts) < 2:
        return None
    middles = (cuts[:-1] + cuts[1:]) / 2.0
    parts = []
    for joint in range(len(times)):
        piece = times[joint, 1:].searchsorted(middles, side='right')
        rests = piece == jerks.shape[1]
        t = np.where(rests, 0.0, cuts[:-1] - np.append(times[joint], 0.0)[piece])
        p, v, a = states[:, joint, piece]
        j = np.append(jerks[joint], 0.0)[piece]
        v, a = np.where(rests, 0.0, v), np.where(rests, 0.0, a)
        parts.append(
            (p + t * (v + t * (a / 2 + t * j / 6)), v + t * (a + t * j / 2), a + t * j, j)
        )
    p, v, a, j = (np.array(column).T[:, None, :] for column in zip(*parts, strict=True))

    def derivatives(t: Array) -> tuple[Array, Array, Array, Array]:
        t = t[..., None]
        return (
            p + t * (v + t * (a / 2 + t * j / 6)), v + t * (a + t * j / 2), a + t * j,
            np.broadcast_to(j, (*t.shape[:2], j.shape[2])),
        )  # fmt: skip

    durations = np.diff(cuts)
    return durations, derivatives, *both_ends(durations, derivatives)


def both_ends(durations: Array, derivatives: Derivatives) -> tuple[State, State]:
    """Return the states at the start of the first span and at the end of the last one."""
    at_start = derivatives(np.zeros((len(durations), 1)))
    at_end = derivatives(durations[:, None])
    return (
        (at_start[0][0, 0], at_start[1][0, 0], at_start[2][0, 0]),
        (at_end[0][-1, 0], at_end[1][-1, 0], at_end[2][-1, 0]),
    )
