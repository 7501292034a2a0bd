# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""CPU time of Real-time Motion Control, over DDS on loopback.

`python -m benchmark.real_time`: a driver (the Python API) and a simulated RC800, in two processes.
Prints the figure of docs/controllers.md. Linux only.
"""

import asyncio
import os
import time
from pathlib import Path

from epson_driver.aio import Robot

MOVES = 4
FAR = 1.2
"""The first joint moves between plus and minus this angle, rad."""


def cpu_seconds(process: int) -> float:
    """Return the user and system time of a process, s."""
    fields = Path(f'/proc/{process}/stat').read_text('utf-8').rpartition(')')[2].split()
    return sum(map(int, fields[11:13])) / os.sysconf('SC_CLK_TCK')


def child() -> int:
    """Return the process of the simulated controller, the only child of this one."""
    own = os.getpid()
    (number,) = Path(f'/proc/{own}/task/{own}/children').read_text('utf-8').split()
    return int(number)


async def cpu(robot: Robot, controller: int) -> None:
    processes = {'controller': controller, 'driver': os.getpid()}
    start, before = time.monotonic(), [cpu_seconds(pid) for pid in processes.values()]
    for index in range(MOVES):
        await robot.move_joints([FAR * (-1) ** index, *[0.0] * 5], speed=0.1)
    seconds = time.monotonic() - start
    used = [cpu_seconds(pid) for pid in processes.values()]
    shares = [100.0 * (b - a) / seconds for a, b in zip(before, used, strict=True)]
    texts = [f'{name} {share:.1f} %' for name, share in zip(processes, shares, strict=True)]
    print(f'CPU in {seconds:.0f} s of motion: {", ".join(texts)}, together {sum(shares):.1f} %')


async def main() -> None:
    async with Robot.simulated(controller='rtmc', model='c8_c901s', enable=True) as robot:
        await cpu(robot, child())


if __name__ == '__main__':
    asyncio.run(main())
