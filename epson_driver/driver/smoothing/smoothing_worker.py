# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The process that prepares one trajectory: what `prepared` takes on stdin, its result on stdout.

The result is a Trajectory, or the text of what forbids it.
"""

import os
import sys

from epson_driver.driver.smoothing.smoothed_trajectory import smoothed_trajectory
from epson_driver.driver.smoothing.smoothing import Smoothing
from epson_driver.motion import JointLimits, Trajectory
from epson_driver.processes.values import packed, unpacked
from epson_driver.processes.worker import answer_file

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
