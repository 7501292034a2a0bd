# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Move two arms at the same time, and meet after each step."""

import asyncio
import sys

from epson_driver.aio import Robot


async def main(first: Robot, second: Robot) -> None:
    async with first, second:
        await asyncio.gather(first.enable(), second.enable())
        for angle in (0.2, 0.0):
            await asyncio.gather(*(turn(robot, angle) for robot in (first, second)))
            print(f'both at {angle} rad')


async def turn(robot: Robot, angle: float) -> None:
    await robot.move_joints([angle, *robot.joints[1:]], speed=0.3)


robots = [Robot(name) for name in sys.argv[1:3]]
asyncio.run(main(*(robots or [Robot.simulated(), Robot.simulated(model='gx4_c251s')])))
