# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Process that smooths one trajectory.

It reads the arguments of `smoothed_trajectory` from stdin, and writes its result, or the reason of
a failure as text, to stdout.
"""

import os
import sys
from itertools import islice

import numpy as np

from epson_driver.driver.smoothing import ON_SPLINE, Smoothing
from epson_driver.motion import Array, JointLimits, Trajectory, problems
from epson_driver.motion.smoothed import denoised, retimed, smoothed, thinned, time_optimal
from epson_driver.processes.worker import answer_file, read_value, write_value

MAX_MENTIONED_PROBLEMS = 3  # maximum number of violations listed in an error text


def smoothed_trajectory(
    trajectory: Trajectory, start: Array, limits: JointLimits, smoothing: Smoothing
) -> tuple[Trajectory, str]:
    """Return the smooth motion for a checked trajectory of an arm at rest at `start`.

    The text is a remark for the result of the goal, or empty.
    The motion passes the points, or positions within the tolerance of the points. Between two
    points it deviates from the line about as far as a spline, because the planner has not checked
    other paths for collisions.
    """
    trajectory, remark = _to_smooth(trajectory, start, limits, smoothing), ''
    if smoothing.time_optimal:
        found = None
        if not smoothing.own_points:
            found = time_optimal(trajectory, limits, smoothing.longest, smoothing.tolerance)
            remark = ON_SPLINE if found is None else ''
        trajectory = found or retimed(trajectory, limits, smoothing.longest)
    if smoothing.resample_period is None:
        return trajectory, remark
    if smoothing.thin:
        motion = thinned(trajectory, limits, smoothing.resample_period, smoothing.deviation)
    else:
        motion = smoothed(trajectory, limits, period=smoothing.resample_period)
    if violations := list(islice(problems(motion, limits), MAX_MENTIONED_PROBLEMS)):
        raise ValueError('; '.join(violations))
    return motion, remark


def _to_smooth(
    trajectory: Trajectory, start: Array, limits: JointLimits, smoothing: Smoothing
) -> Trajectory:
    """Add `start` before a first point later than 0 s. Remove noise if a tolerance is set."""
    if trajectory.times[0] > 0.0:
        trajectory = Trajectory(
            trajectory.joint_names,
            np.concatenate([[0.0], trajectory.times]),
            np.vstack([start, trajectory.positions]),
        )
    if smoothing.tolerance and not smoothing.time_optimal:
        trajectory = denoised(trajectory, limits, smoothing.tolerance)
    return trajectory


NICENESS = 5  # added to this process's: processes that serve links have priority


def main() -> None:
    answers = answer_file()
    os.nice(NICENESS)
    requests = sys.stdin.buffer
    arguments = read_value(requests, (Trajectory, JointLimits, Smoothing))
    if arguments is None:
        return  # the driver has ended
    try:
        result: tuple[Trajectory, str] | str = smoothed_trajectory(*arguments)
    except ValueError as error:
        result = str(error)
    write_value(answers, result)


if __name__ == '__main__':
    try:
        main()
    except BrokenPipeError:  # the result is no longer needed
        os._exit(0)
