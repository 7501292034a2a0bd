# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A smooth motion that is planned completely in advance, and can be stopped at any time."""

from bisect import bisect_left
from collections.abc import Callable
from itertools import pairwise

import numpy as np

from epson_driver.motion.joint_motion import JointMotion, State
from epson_driver.motion.limits import Array, JointLimits
from epson_driver.motion.smoothed import MAX_STEP_S, smoothed
from epson_driver.motion.smoother import Plan, Request, Smoother, plan
from epson_driver.motion.smoother.request import ActivePlan
from epson_driver.motion.trajectory import Trajectory, sample_times

MIN_APART_S = 1e-4
"""Minimum time between two points, s. A breakpoint closer to the previous point is ignored."""

BISECTIONS = 50
"""Bisection steps for the time at which a path passes a knot, enough for full precision."""


class Executed:
    """Observer that records the motions that a smoother executes, from rest at a position.

    The recorded motions are converted to points between which quintics reproduce the motion. A
    quintic across a jump of the jerk would exceed this jerk by up to 80 %. Therefore a point is
    placed wherever the jerk may jump: at the breakpoints of a plan's timing and of a joint motion,
    and where the path passes a knot.
    """

    def __init__(self, position: Array) -> None:
        self._starts = [0.0]
        self._pieces: list[ActivePlan | JointMotion | None] = [None]
        self._rests = [position]

    def __call__(self, now: float, executed: ActivePlan | JointMotion | None) -> None:
        """Record the motion that starts at time `now`, s, or the start of a standstill (None)."""
        before, rest = self._pieces[-1], self._rests[-1]
        if executed is None and before is not None:
            rest = _rest_after(before)
        self._starts.append(now)
        self._pieces.append(executed)
        self._rests.append(rest)

    def points(
        self,
        names: tuple[str, ...],
        end: float,
        longest: float,
        start: float = 0.0,
        checkpoint: Callable[[float], None] = lambda _: None,
    ) -> Trajectory:
        """Return the motion from `start` to `end`, s, as points. The arm must be at rest at `end`.

        `longest`: maximum time between two points, s. `checkpoint` is called with each point's
        time, s, and may raise to cancel. Raises ValueError if there would be more than MAX_POINTS.
        """
        sample_times(end - start, longest)  # raises
        if self._pieces[-1] is None and start < self._starts[-1] < end:
            end = self._starts[-1]  # the arm has rested since
        ends = [*self._starts[1:], end]
        instants = [np.array(self._starts)]
        for since, until, executed in zip(self._starts, ends, self._pieces, strict=True):
            if until > start:
                inside = _breakpoints(executed, since)
                instants.append(inside[(inside > since) & (inside < until)])
        breakpoints = [0.0]
        for instant in np.unique(np.concatenate(instants)).tolist():
            if instant - breakpoints[-1] >= MIN_APART_S and end - instant >= MIN_APART_S:
                breakpoints.append(instant)
        times = [0.0]
        for since, until in pairwise([*breakpoints, end]):
            parts = int(np.ceil((until - since) / longest - 1e-9))
            times.extend(np.linspace(since, until, parts + 1)[1:].tolist())
        times = times[bisect_left(times, start) :]
        states = []
        for time in times:
            checkpoint(time)
            states.append(self._state(time))
        return Trajectory(names, np.array(times), *map(np.array, zip(*states, strict=True)))

    def _state(self, time: float) -> State:
        index = int(np.searchsorted(self._starts, time, side='right')) - 1
        executed, start = self._pieces[index], self._starts[index]
        if isinstance(executed, JointMotion):
            return executed.at(time - start)
        if executed is not None:
            u, v, a = executed.timing.at(time - executed.start)
            position, first, second = executed.path.at(u)
            return position, first * v, first * a + second * (v * v)
        zeros = np.zeros_like(self._rests[index])
        return self._rests[index], zeros, zeros


def _rest_after(executed: ActivePlan | JointMotion) -> Array:
    if isinstance(executed, JointMotion):
        return executed.end
    return executed.path.at(executed.timing.end)[0]


def _breakpoints(executed: ActivePlan | JointMotion | None, start: float) -> Array:
    if isinstance(executed, JointMotion):
        return start + np.asarray(executed.times.ravel())
    if executed is None:
        return np.zeros(0)
    timing, knots = executed.timing, executed.path.knots.u
    knots = knots[(knots > timing.positions[0]) & (knots < timing.end)]
    piece = np.clip(timing.positions.searchsorted(knots) - 1, 0, len(timing.jerks) - 1)
    low, high = timing.times[piece], timing.times[piece + 1]
    for _ in range(BISECTIONS):  # u rises
        middle = (low + high) / 2.0
        before = timing.sample(middle)[0] < knots
        low, high = np.where(before, middle, low), np.where(before, high, middle)
    return executed.start + np.concatenate([timing.times, high])


TOLERANCE = 1e-9
"""Tolerance for rounding errors: of positions, rad or m, of times, s, and of times in periods."""


MAX_DURATION_S = 600.0
"""Maximum duration of a smooth motion, s. It has 150,000 samples."""


class StoppableMotion:
    """The smooth motion through a trajectory, and its stop.

    The attribute `motion` has a point every MAX_STEP_S. Its path is the smoother's spline. A stop
    follows this path if the limits allow. To prepare for a stop, a second smoother repeats the
    plans of the first smoother, up to the time that was passed to `follow`.

    `checkpoint` is called at each sample, and may raise to cancel. Raises ValueError if the motion
    takes longer than MAX_DURATION_S, or the exceptions of `smoothed`.
    """

    def __init__(
        self,
        trajectory: Trajectory,
        limits: JointLimits,
        checkpoint: Callable[[], None] = lambda: None,
    ) -> None:
        plans: list[Plan | None] = []

        def planned(request: Request, limits: JointLimits) -> Plan | None:
            plans.append(plan(request, limits))
            return plans[-1]

        def check(time: float) -> None:
            checkpoint()
            if time > MAX_DURATION_S:
                raise ValueError(
                    f'point {len(trajectory.times) - 1}: time_from_start = {time:g} s or later: a '
                    f'smooth motion must take at most {MAX_DURATION_S:g} s'
                )

        check(trajectory.duration)
        self._check = check
        trajectory = trajectory.in_order(limits.names)
        self._executed = executed = Executed(trajectory.positions[0])
        self.motion = smoothed(
            trajectory,
            limits,
            planner=planned,
            observer=executed,
            checkpoint=check,
        )
        again = iter(plans)
        self._repeated = Executed(trajectory.positions[0])
        self._smoother = Smoother(
            limits,
            trajectory.positions[0],
            planner=lambda *_: next(again, None),
            observer=self._repeated,
        )
        durations = np.diff(trajectory.times, prepend=trajectory.times[0])
        for point, duration in zip(trajectory.positions, durations.tolist(), strict=True):
            self._smoother.append(point, duration)
        self._smoother.finish()
        self._steps = 0

    def points(self, longest: float) -> Trajectory:
        end = float(self.motion.times[-1] - self.motion.times[0])
        return self._executed.points(self.motion.joint_names, end, longest, checkpoint=self._check)

    def follow(self, time: float) -> None:
        """Prepare for a stop at the time `time` of the motion, s, or later."""
        steps = min(int(time / MAX_STEP_S + TOLERANCE), len(self.motion.times) - 1)
        while self._steps < steps:
            self._smoother.step(MAX_STEP_S)
            self._steps += 1

    def stopped(self, time: float, longest: float, start: float = 0.0) -> Trajectory:
        """Return the motion with a stop that starts at `time`, s, or up to MAX_STEP_S earlier.

        The points start at the time `start`, s, and are at most `longest` s apart. Call this only
        once, with a time not before the last `follow`. Raises ValueError if no stop is found.
        """
        self.follow(time)
        smoother, motion, steps = self._smoother, self.motion, self._steps
        apart = float(np.abs(smoother.motion.position - motion.positions[steps]).max())
        if apart > TOLERANCE or time < motion.times[steps] - motion.times[0] - TOLERANCE:
            raise ValueError(
                f'cannot compute a stop at {time:g} s: the motion could not be reproduced '
                f'(difference: {apart:g} rad or m)'
            )
        smoother.stop()
        while smoother.moving:
            smoother.step(MAX_STEP_S)
        if smoother.violation is not None:
            raise ValueError(f'the stop breaks a limit: {smoother.violation}')
        return self._repeated.points(motion.joint_names, smoother.now, longest, start)
