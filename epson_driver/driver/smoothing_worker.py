# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The process that smooths one trajectory: arguments of `prepared` on stdin, its result on stdout.

The result is a Trajectory, or the text of what forbids it. If its speed may be changed, the
arguments of `SmoothMotion.after` follow, each answered with a Remainder.
"""

import os
import sys
from collections.abc import Callable, Iterable
from itertools import islice
from math import ceil
from typing import Any

import numpy as np

from epson_driver.driver.smoothing import BLOCK_S, Remainder, Smoothing
from epson_driver.motion import Array, JointLimits, Trajectory, problems
from epson_driver.motion.evened import evened
from epson_driver.motion.smoothed import SmootherSamples, retimed, smoothed, thinned
from epson_driver.motion.smoother import Mode
from epson_driver.processes.worker import answer_file, read_value, write_value

MAX_MENTIONED_PROBLEMS = 3
"""How many violations a text mentions."""


def smoothed_trajectory(
    trajectory: Trajectory, start: Array, limits: JointLimits, smoothing: Smoothing
) -> Trajectory:
    """Return the smooth motion for a checked trajectory of an arm at rest at `start`, (n,), rad.

    It begins at the first point, or at `start` if that point has a time. Between the points it is
    the spline through them, or within the tolerance of them: who planned them has checked no path
    that bends more. Raises ValueError that says why there is no such motion.
    """
    trajectory = _to_smooth(trajectory, start, limits, smoothing)
    if smoothing.resample_period is None:
        if smoothing.time_optimal:
            return retimed(trajectory, limits, smoothing.longest)
        return trajectory
    mode = _mode(smoothing)
    if smoothing.thin:
        motion = thinned(
            trajectory,
            limits,
            smoothing.resample_period,
            smoothing.deviation,
            mode,
            refine=False,
        )
    else:
        motion = smoothed(trajectory, limits, mode, period=smoothing.resample_period, refine=False)
    _check(motion, limits)
    return motion


def _to_smooth(
    trajectory: Trajectory, start: Array, limits: JointLimits, smoothing: Smoothing
) -> Trajectory:
    """Return the points that the smooth motion is made of."""
    if trajectory.times[0] > 0.0:
        trajectory = Trajectory(
            trajectory.joint_names,
            np.concatenate([[0.0], trajectory.times]),
            np.vstack([start, trajectory.positions]),
        )
    if smoothing.tolerance and not smoothing.time_optimal:
        trajectory = evened(trajectory, limits, smoothing.tolerance)
    return trajectory


def _mode(smoothing: Smoothing) -> Mode:
    return Mode.TIME_OPTIMAL if smoothing.time_optimal else Mode.TIME_PRESERVING


def _check(motion: Trajectory, limits: JointLimits) -> None:
    if wrong := list(islice(problems(motion, limits), MAX_MENTIONED_PROBLEMS)):
        raise ValueError('; '.join(wrong))


class ScaledMotion:
    """The same motion as `smoothed_trajectory` returns, at shares of its speed that change.

    The arguments are the same, and there must be a resample period. A smoother makes it, and its
    `scale` is the share.
    """

    def __init__(
        self, trajectory: Trajectory, start: Array, limits: JointLimits, smoothing: Smoothing
    ) -> None:
        assert smoothing.resample_period is not None  # noqa: S101 - for the type checker
        self._period = smoothing.resample_period
        self._block = max(ceil(BLOCK_S / self._period), 1)
        self._limits = limits
        points = _to_smooth(trajectory, start, limits, smoothing).in_order(limits.names)
        self._samples = SmootherSamples(points, limits, _mode(smoothing), np.inf, self._period)

    def after(self, index: int, share: float | None) -> Remainder:
        """Return the sample `index` and, unless `share` is None, a block of those that follow.

        `share`: of all speeds, from that sample on; None: the one so far. `index`: not lower than
        the last time. Raises as `smoothed` does.
        """
        samples = self._samples
        while samples.index < index:
            samples.step()
        states = [samples.state]
        if share is not None:
            samples.smoother.scale = share
            samples = samples.copy()
            while len(states) <= self._block and samples.moving:
                if share == 0.0 and samples.smoother.at_rest:
                    break
                states.append(samples.step())
        columns = (np.array(column) for column in zip(*states, strict=True))
        times = np.array([self._period * (index + each) for each in range(len(states))])
        motion = Trajectory(self._limits.names, times, *columns)
        _check(motion, self._limits)
        left = 0.0
        if samples.moving:
            left = max(samples.smoother.look_ahead / (share or 1.0), self._period)
        return Remainder(motion, left)


NICENESS = 5
"""Added to the niceness: processes that keep links alive go first."""


def main() -> None:
    """Prepare one trajectory, and end."""
    answers = answer_file()
    os.nice(NICENESS)
    requests = sys.stdin.buffer
    asked = read_value(requests, (Trajectory, JointLimits, Smoothing))
    if asked is None:
        return  # it was not needed
    *arguments, scales = asked
    write_value(answers, _result(smoothed_trajectory, arguments))
    motion = ScaledMotion(*arguments) if scales else None
    while motion is not None and (asked := read_value(requests, ())) is not None:
        write_value(answers, _result(motion.after, asked))


def _result(work: Callable[..., object], arguments: Iterable[Any]) -> object:
    """Return what `work` does, or the text of what forbids it."""
    try:
        return work(*arguments)
    except ValueError as error:
        return str(error)


if __name__ == '__main__':
    try:
        main()
    except BrokenPipeError:  # nobody waits for it any more
        os._exit(0)
