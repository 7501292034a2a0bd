# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Whether a demo run can be judged: not where the machine kept the simulated controller waiting.

The controller counts by its own clock how many motion cycles began late, and how many plans of its
smoother came too late to be used.
"""

import asyncio
from collections.abc import Sequence

from epson_driver.remote_ethernet.client import execute

TOO_BUSY = 3
"""The exit code of a run that cannot be judged."""

MAX_GAP_S = 0.1
"""A run whose joint states have a longer gap says too little about what the arm did, s."""

TIMEOUT_S = 5.0


def deadlines_missed(remote_port: int) -> int:
    """Return how many deadlines the simulated controller on this machine has missed so far.

    Raises OSError, TimeoutError, RemoteError or ValueError if it does not tell.
    """
    command = execute('127.0.0.1', remote_port, ['Sim,timing'], TIMEOUT_S)
    cycles, plans, *_ = asyncio.run(command)[0].split(',')
    return int(cycles) + int(plans)


def verdict(faults: Sequence[str], missed: int, longest_gap: float) -> tuple[int, str]:
    """Return the exit code of a run and the sentence about it.

    `faults`: what was not as planned, a clause each. `missed`: deadlines during the run.
    `longest_gap`: between two joint states, s. A run without faults is right, however busy it was.
    """
    if not faults:
        return 0, 'the arm did what was planned'
    if missed or longest_gap > MAX_GAP_S:
        return TOO_BUSY, (
            f'this machine was too busy to judge the motion: the simulated controller missed '
            f'{missed} of its deadlines, and joint states were up to {longest_gap * 1e3:.0f} ms '
            f'apart ({"; ".join(faults)}); try again when less is running'
        )
    return 1, f'the motion was not as planned: {"; ".join(faults)}'
