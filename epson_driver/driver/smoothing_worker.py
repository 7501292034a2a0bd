# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The process that smooths one trajectory: arguments of `prepared` on stdin, its result on stdout.

The result is a Trajectory, or the text of what forbids it.
"""

import os
import sys
from itertools import islice

import numpy as np

from epson_driver.driver.smoothing import Smoothing
from epson_driver.motion import Array, JointLimits, Trajectory, problems
from epson_driver.motion.evened import evened
from epson_driver.motion.smoothed import retimed, smoothed, thinned
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
    try:
        result: Trajectory | str = smoothed_trajectory(*asked)
    except ValueError as error:
        result = str(error)
    write_value(answers, result)


if __name__ == '__main__':
    try:
        main()
    except BrokenPipeError:  # nobody waits for it any more
        os._exit(0)
