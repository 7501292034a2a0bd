# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A smooth motion that is fully planned in advance, with a stop within limits at any time."""

from bisect import bisect_left
from collections.abc import Callable
from itertools import pairwise

import numpy as np

from epson_driver.motion.joint_motion import JointMotion, State
from epson_driver.motion.limits import Array, JointLimits
from epson_driver.motion.smoothed import MAX_STEP_S, smoothed
from epson_driver.motion.smoother import Mode, Plan, Request, Smoother, plan
from epson_driver.motion.smoother.request import ActivePlan
from epson_driver.motion.trajectory import Trajectory, sample_times

MIN_APART_S = 1e-4
"""Minimum time between two instants, s. Later ones within this time are ignored."""

BISECTIONS = 50
"""Bisection steps for the passage of a knot, to rounding."""


class Executed:
    """Observer of a smoother: records the executed motions, from rest at a position.

    It converts them to points between which quintics reproduce them, including jerk. A quintic
    over an instant at which the jerk jumps needs up to 1.8 times that jerk. Therefore a point is
    placed at each such instant: at the breakpoints of a plan's timing or of a joint's motion, and
    wherever a path passes a knot.
    """

    def __init__(self, position: Array) -> None:
        self._begins = [0.0]
        self._pieces: list[ActivePlan | JointMotion | None] = [None]
        self._rests = [position]

    def __call__(self, now: float, what: ActivePlan | JointMotion | None) -> None:
        """Record the motion that is executed from `now` s."""
        before, rest = self._pieces[-1], self._rests[-1]
        if what is None and before is not None:
            rest = _end_of(before)
        self._begins.append(now)
        self._pieces.append(what)
        self._rests.append(rest)

    def points(
        self,
        names: tuple[str, ...],
        end: float,
        longest: float,
        begin: float = 0.0,
        look: Callable[[float], None] = lambda _: None,
    ) -> Trajectory:
        """Return the motion from `begin` until `end`, s, when it has come to rest.

        longest: the maximum time between two points, s. look: called with the time of each point,
        s. It may raise to end the work. Raises ValueError for more than MAX_POINTS.
        """
        sample_times(end - begin, longest)  # raises
        ends = [*self._begins[1:], end]
        instants = [np.array(self._begins)]
        for since, until, what in zip(self._begins, ends, self._pieces, strict=True):
            if until > begin:
                inside = _breakpoints(what, since)
                instants.append(inside[(inside > since) & (inside < until)])
        kept = [0.0]
        for instant in np.unique(np.concatenate(instants)).tolist():
            if instant - kept[-1] >= MIN_APART_S and end - instant >= MIN_APART_S:
                kept.append(instant)
        times = [0.0]
        for since, until in pairwise([*kept, end]):
            parts = int(np.ceil((until - since) / longest - 1e-9))
            times.extend(np.linspace(since, until, parts + 1)[1:].tolist())
        times = times[bisect_left(times, begin) :]
        states = []
        for time in times:
            look(time)
            states.append(self._state(time))
        return Trajectory(names, np.array(times), *map(np.array, zip(*states, strict=True)))

    def _state(self, time: float) -> State:
        index = int(np.searchsorted(self._begins, time, side='right')) - 1
        what, start = self._pieces[index], self._begins[index]
        if isinstance(what, JointMotion):
            return what.at(time - start)
        if what is not None:
            u, v, a = what.timing.at(time - what.begin)
            position, first, second = what.path.at(u)
            return position, first * v, first * a + second * (v * v)
        zeros = np.zeros_like(self._rests[index])
        return self._rests[index], zeros, zeros


def _end_of(what: ActivePlan | JointMotion) -> Array:
    """Return the final rest position, shape (n,)."""
    if isinstance(what, JointMotion):
        return what.end
    return what.path.at(what.timing.end)[0]


def _breakpoints(what: ActivePlan | JointMotion | None, begin: float) -> Array:
    """Return the times at which the jerk of a motion may jump, s."""
    if isinstance(what, JointMotion):
        return begin + np.asarray(what.times.ravel())
    if what is None:
        return np.zeros(0)
    timing, knots = what.timing, what.path.knots.u
    knots = knots[(knots > timing.positions[0]) & (knots < timing.end)]
    piece = np.clip(timing.positions.searchsorted(knots) - 1, 0, len(timing.jerks) - 1)
    low, high = timing.times[piece], timing.times[piece + 1]
    for _ in range(BISECTIONS):  # u rises
        middle = (low + high) / 2.0
        before = timing.sample(middle)[0] < knots
        low, high = np.where(before, middle, low), np.where(before, high, middle)
    return what.begin + np.concatenate([timing.times, high])


SAME = 1e-9
"""Tolerance of the motion when it is computed again, rad or m."""


MAX_DURATION_S = 600.0
"""Maximum duration of a smooth motion, s: it has 150,000 samples."""


class StoppableMotion:
    """The smooth motion through a trajectory, `motion`, one point every MAX_STEP_S, and its stops.

    Its path is the spline, as for goals of the driver. A stop is the smoother's stop, on the path
    if that is possible within the limits. For this, the smoother executes the motion a second
    time, with the plans of the first run, up to the time passed to `follow`. A stop from there is
    found immediately. `look` is called at each sample, and may raise to end the work. Raises like
    `smoothed`, and ValueError for a motion longer than MAX_DURATION_S.
    """

    def __init__(
        self,
        trajectory: Trajectory,
        limits: JointLimits,
        mode: Mode = Mode.TIME_PRESERVING,
        look: Callable[[], None] = lambda: None,
    ) -> None:
        plans: list[Plan | None] = []

        def planned(request: Request, limits: JointLimits) -> Plan | None:
            plans.append(plan(request, limits))
            return plans[-1]

        def check(time: float) -> None:
            look()
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
            trajectory, limits, mode, planner=planned, refine=False, observer=executed, look=check
        )
        again = iter(plans)
        self._left = Executed(trajectory.positions[0])
        self._smoother = Smoother(
            limits,
            trajectory.positions[0],
            mode,
            planner=lambda *_: next(again, None),
            observer=self._left,
        )
        durations = np.diff(trajectory.times, prepend=trajectory.times[0])
        for point, duration in zip(trajectory.positions, durations.tolist(), strict=True):
            self._smoother.append(point, duration)
        self._smoother.finish()
        self._steps = 0

    def points(self, longest: float) -> Trajectory:
        """Return the motion as points from 0 s, at most `longest` s apart, see `Executed`."""
        end = float(self.motion.times[-1] - self.motion.times[0])
        return self._executed.points(self.motion.joint_names, end, longest, look=self._check)

    def follow(self, time: float) -> None:
        """Prepare for stops that start `time` s after the start of the motion, or later."""
        steps = min(int(time / MAX_STEP_S + SAME), len(self.motion.times) - 1)
        while self._steps < steps:
            self._smoother.step(MAX_STEP_S)
            self._steps += 1

    def stopped(self, time: float, longest: float, begin: float = 0.0) -> Trajectory:
        """Return the motion until `time`, s, or up to MAX_STEP_S earlier, and its stop from there.

        It has points as in `points`, from `begin` s. Call it once, and not for a time before the
        last `follow`. Raises ValueError if the stop cannot be determined.
        """
        self.follow(time)
        smoother, motion, steps = self._smoother, self.motion, self._steps
        apart = float(np.abs(smoother.motion.position - motion.positions[steps]).max())
        if apart > SAME or time < motion.times[steps] - motion.times[0] - SAME:
            raise ValueError(
                f'no stop at {time:g} s: the motion is {apart:g} rad or m from itself'
            )
        smoother.stop()
        while smoother.moving:
            smoother.step(MAX_STEP_S)
        if smoother.violation is not None:
            raise ValueError(f'the stop breaks a limit: {smoother.violation}')
        return self._left.points(motion.joint_names, smoother.now, longest, begin)
