# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The process that prepares one trajectory: what `prepared` takes on stdin, its result on stdout.

Both are pickles. The result is a Trajectory, or the text of what forbids it.
"""

import os
import pickle
import sys

from epson_driver.driver.smoothing.smoothing import smoothed_trajectory

NICENESS = 5
"""Added to the niceness: processes that keep links alive go first."""


def main() -> None:
    """Prepare one trajectory, and end."""
    answers = os.fdopen(os.dup(1), 'wb')
    os.dup2(2, 1)  # whatever prints does not disturb the answer
    os.nice(NICENESS)
    arguments = sys.stdin.buffer.read()
    if not arguments:
        return  # it was not needed
    try:
        answer = smoothed_trajectory(*pickle.loads(arguments))  # noqa: S301 - our own parent's
    except ValueError as error:
        pickle.dump(str(error), answers)
    else:
        pickle.dump(answer, answers, pickle.HIGHEST_PROTOCOL)
    answers.close()


if __name__ == '__main__':
    main()
