# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The planning process: reads requests from stdin and writes plans to stdout until stdin closes.

The first message contains the joint limits. The process sends None once it is ready. Each further
message contains a request and the joint limits, or None instead of unchanged limits.
"""

import gc
import os
import signal
import sys

from epson_driver.motion import JointLimits
from epson_driver.motion.smoother import PASSED_TYPES, Smoother, plan
from epson_driver.processes.worker import answer_file, read_value, write_value


def main() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the controller handles it
    answers = answer_file()
    requests = sys.stdin.buffer
    limits = read_value(requests, PASSED_TYPES)
    if limits is None:
        return
    _warm_up(limits)
    gc.collect()
    gc.freeze()
    write_value(answers, None)
    while (message := read_value(requests, PASSED_TYPES)) is not None:
        request, new_limits = message
        limits = new_limits or limits
        write_value(answers, plan(request, limits))


def _warm_up(limits: JointLimits) -> None:
    """Compute a small plan, so that the first real plan is not slower than later ones."""
    span = limits.position_max - limits.position_min
    smoother = Smoother(limits, limits.position_min + 0.5 * span)
    for index in range(1, 5):
        smoother.append(limits.position_min + (0.5 + 0.005 * index**2) * span, 0.1)
    while smoother.moving:
        smoother.step(0.05)


if __name__ == '__main__':
    try:
        main()
    except BrokenPipeError:  # the controller has ended
        os._exit(0)
