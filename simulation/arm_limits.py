# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Oracle for the arm's limits at every instant, from the exact extrema of its polynomials.

It judges the executed motion of the simulated arm, not the planned or verified one.
"""

from collections.abc import Callable
from typing import Any, SupportsIndex

import numpy as np
from numpy.polynomial import chebyshev

from benchmark.exact_extrema import NODES, Extrema, Spans, State, both_ends, executed_spans
from epson_driver.motion import Array, JointLimits
from epson_driver.motion.joint_motion import JointMotion
from epson_driver.motion.smoother import Smoother
from epson_driver.motion.smoother.request import ActivePlan
from epson_driver.rtmc.known_motion import KnownMotion
from epson_driver.sim_controller.arm.executor import Motion
from epson_driver.sim_controller.arm.overlap import JointMoves
from epson_driver.sim_controller.arm.point_to_point import PointToPoint, Segment
from epson_driver.tool_motion.curve_motion import CurveMotion
from simulation.oracles import BrokenError

ROUNDING_FRACTION = 1e-5
"""Tolerance for rounding at a velocity, acceleration or jerk limit, as a fraction of it."""

JUMP_FRACTION = 1e-4
"""Tolerance for a jump of velocity or acceleration. It is needed because a start may be cancelled
within 1 us."""

OUTSIDE_RAD = 1e-8
"""Tolerance for positions outside a range, and for jumps of position."""

SHORT_S = 1e-7
"""Minimum duration of a piece of a motion, s. Shorter pieces are ignored."""

EVEN_S = 1e-3
"""Duration of a piece below which its jerk counts as constant, s. A fit would be distorted by the
end of another piece."""

SLOPES = chebyshev.chebvander(NODES, len(NODES) - 2) @ chebyshev.chebder(
    np.linalg.inv(chebyshev.chebvander(NODES, len(NODES) - 1))
)
"""Matrix from a polynomial's values at the nodes, in -1 … 1, to its slopes at the nodes."""

HALVINGS = 50

At = Callable[[float], State]
"""Function from a time, s, to position, velocity and acceleration, shapes (n,)."""


class ArmLimits:
    """Checks executed motions against an arm's limits. `break_` receives violations."""

    def __init__(self, limits: JointLimits, break_: Callable[[BrokenError], object]) -> None:
        self._limits = limits
        self._break = break_
        self._segments: dict[PointToPoint, Segments] = {}
        self._recovery: object = None

    def smoother(self, *args: Any, **named: Any) -> Smoother:
        return Smoother(*args, observer=Executed(self), **named)

    def known_motion(self, *args: Any) -> KnownMotion:
        known, executed = KnownMotion(*args), Executed(self)
        keep = known._execution._observer  # noqa: SLF001 - nobody else needs it

        def observe(start: float, motion: ActivePlan | JointMotion | None) -> None:
            if keep is not None:
                keep(start, motion)
            executed(start, motion)

        known._execution._observer = observe  # noqa: SLF001
        return known

    def look(self, arm: Any) -> None:
        """Check the motion of the current executor, and a recovery motion that has started."""
        executor = arm.executor
        if isinstance(executor, PointToPoint):
            if executor not in self._segments:
                self._segments[executor] = Segments(self, executor)
            self._segments[executor].look()
        motion = arm._recovery and arm._recovery._motion  # noqa: SLF001 - nobody else needs them
        if motion is not self._recovery:
            self._recovery = motion
            if motion is not None:
                self.judge_whole(motion, None)

    def judge_whole(self, motion: Motion | JointMotion, before: State | None) -> None:
        if motion.duration > SHORT_S:
            spans = spans_of(motion.at, cuts(motion, 0.0, 0.0, motion.duration))
            self.judge(spans, before)

    def judge(self, spans: Spans, before: State | None) -> State:
        """Check spans after the state `before` (None: unknown). Return the last state."""
        result = Extrema()
        after = result.extend(spans, self._limits, before or spans[2])
        if result.worst > 1.0 + ROUNDING_FRACTION or result.outside > OUTSIDE_RAD:
            self._break(BrokenError(f'2: beyond its limits at an instant: {result}'))
        jump = max(result.velocity_jump, result.acceleration_jump)
        if jump > JUMP_FRACTION or result.position_jump > OUTSIDE_RAD:
            self._break(BrokenError(f'2: its motion jumps: {result}'))
        return after


class Executed:
    """Observer of a smoother's executed motion."""

    def __init__(self, oracle: ArmLimits) -> None:
        self._oracle = oracle
        self._since = 0.0
        self._what: ActivePlan | JointMotion | None = None
        self._state: State | None = None

    def __call__(self, now: float, what: ActivePlan | JointMotion | None) -> None:
        spans = executed_spans(self._what, self._since, now)
        if spans is not None:
            self._state = self._oracle.judge(spans, self._state)
        if what is None and self._state is not None:
            rest = np.zeros_like(self._state[1])
            self._state = (self._state[0], rest, rest)
        self._since, self._what = now, what


class Segments(list[Segment]):
    """The moves of a point-to-point arm, which are judged as they end."""

    def __init__(self, oracle: ArmLimits, executor: PointToPoint) -> None:
        super().__init__(executor._segments)  # noqa: SLF001
        executor._segments = self  # noqa: SLF001
        self._oracle, self._executor = oracle, executor
        self._since = executor._now  # noqa: SLF001
        self._state: State | None = None
        self._brake: object = None

    def append(self, segment: Segment) -> None:
        self._judge()
        if not self:
            rest = np.zeros_like(segment.motion.end)
            self._since = self._executor._now  # noqa: SLF001
            self._state = (segment.motion.origin, rest, rest)
        super().append(segment)

    def pop(self, index: SupportsIndex = -1) -> Segment:
        self._judge()
        return super().pop(index)

    def clear(self) -> None:
        self._judge()
        super().clear()

    def look(self) -> None:
        """Check a new braking motion as a whole, because it always ends with the arm at rest."""
        brake = self._executor._brake  # noqa: SLF001
        if brake is self._brake:
            return
        self._brake = brake
        if brake is not None:
            self._oracle.judge_whole(brake.motion, self._state)

    def _judge(self) -> None:
        now = self._executor._now  # noqa: SLF001
        if not self or now - self._since <= SHORT_S:
            return
        first, *others = self

        def at(time: float) -> State:
            position, velocity, acceleration = first.motion.at(time - first.start)
            for segment in others:
                p, v, a = segment.motion.at(time - segment.start)
                position = position + p - segment.motion.origin
                velocity, acceleration = velocity + v, acceleration + a
            return position, velocity, acceleration

        instants = [cuts(item.motion, item.start, self._since, now) for item in self]
        spans = spans_of(at, np.concatenate(instants))
        self._since = now
        self._state = self._oracle.judge(spans, self._state)


def spans_of(at: At, instants: Array) -> Spans:
    """Return the spans between instants, s, at which the jerk may jump.

    The first and the last instant must be more than SHORT_S apart.
    """
    instants = np.unique(instants)
    kept = instants[np.append(True, np.diff(instants) > SHORT_S)]
    kept[-1] = instants[-1]
    begins, durations = kept[:-1], np.diff(kept)

    def derivatives(t: Array) -> tuple[Array, Array, Array, Array]:
        times = (begins[:, None] + t).ravel()
        states = np.array([at(time) for time in times.tolist()])
        q, v, a = states.reshape(*t.shape, 3, -1).transpose(2, 0, 1, 3)
        if t.shape[1] == 1:
            return q, v, a, np.zeros_like(a)
        j = SLOPES @ a * (2.0 / durations[:, None, None])
        mean = (a[:, -1:] - a[:, :1]) / (t[:, -1:] - t[:, :1])[..., None]
        return q, v, a, np.where(durations[:, None, None] < EVEN_S, mean, j)

    return durations, derivatives, *both_ends(durations, derivatives)


def cuts(motion: Motion | JointMotion, begin: float, since: float, until: float) -> Array:
    """Return `since`, `until`, and the instants between them at which the jerk may jump, s."""
    result = begin + np.array(_jumps(motion))
    return np.concatenate([[since], result[(result > since) & (result < until)], [until]])


def _jumps(motion: Any) -> list[float]:
    """Return the times at which the jerk of a motion may jump, s since its start."""
    if motion.duration == 0.0:
        return []
    if isinstance(motion, JointMoves):
        return [
            part.start + time
            for part in motion._parts  # noqa: SLF001
            for time in [*_jumps(part.move), 0.0, part.move.duration]
        ]
    if isinstance(motion, JointMotion):
        jumps: list[float] = motion.times.ravel().tolist()
        return jumps
    if isinstance(motion, CurveMotion):
        return _passages(motion)
    times: list[float] = motion.pieces.times.tolist()
    return times


def _passages(motion: CurveMotion) -> list[float]:
    """Return the passage times of a curve's knots, and the jerk jumps of its timing, s."""
    curve, pieces = motion._curve, motion._timing.pieces  # noqa: SLF001
    shares = np.linspace(0.0, 1.0, len(curve.samples))
    low, high = np.zeros_like(shares), np.full_like(shares, motion.duration)
    for _ in range(HALVINGS):
        middle = (low + high) / 2.0
        piece = np.clip(pieces.times.searchsorted(middle, side='right') - 1, 0, 6)
        t = middle - pieces.times[piece]
        v, a, j = pieces.velocities[piece], pieces.accelerations[piece], pieces.jerks[piece]
        before = pieces.distances[piece] + t * (v + t * (a / 2.0 + t * j / 6.0)) < shares
        low, high = np.where(before, middle, low), np.where(before, high, middle)
    return [*pieces.times.tolist(), *high.tolist()]
