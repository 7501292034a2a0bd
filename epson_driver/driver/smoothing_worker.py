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
from epson_driver.processes.worker import answer_file, packed, unpacked

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
    if trajectory.times[0] > 0.0:
        trajectory = Trajectory(
            trajectory.joint_names,
            np.concatenate([[0.0], trajectory.times]),
            np.vstack([start, trajectory.positions]),
        )
    if smoothing.tolerance and not smoothing.time_optimal:
        trajectory = evened(trajectory, limits, smoothing.tolerance)
    if smoothing.resample_period is None:
        if smoothing.time_optimal:
            return retimed(trajectory, limits, smoothing.longest)
        return trajectory
    mode = Mode.TIME_OPTIMAL if smoothing.time_optimal else Mode.TIME_PRESERVING
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
    wrong = list(islice(problems(motion, limits), MAX_MENTIONED_PROBLEMS))
    if wrong:
        raise ValueError('; '.join(wrong))
    return motion


NICENESS = 5
"""Added to the niceness: processes that keep links alive go first."""


def main() -> None:
    """Prepare one trajectory, and end."""
    answers = answer_file()
    os.nice(NICENESS)
    data = sys.stdin.buffer.read()
    if not data:
        return  # it was not needed
    arguments = unpacked(data, (Trajectory, JointLimits, Smoothing))
    try:
        answer: Trajectory | str = smoothed_trajectory(*arguments)
    except ValueError as error:
        answer = str(error)
    answers.write(packed(answer))
    answers.close()


if __name__ == '__main__':
    main()
