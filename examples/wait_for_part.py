# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Wait for a part at an input, move, and report the cycle on an output."""

import sys

from epson_driver import Robot

with Robot(sys.argv[1]) if len(sys.argv) > 1 else Robot.simulated() as robot:
    robot.enable()
    start = robot.joints
    if len(sys.argv) == 1:
        robot.simulation.input(3)  # the part arrives
    robot.wait_for_input(3, timeout=60.0)
    robot.move_joints([start[0] + 0.2, *start[1:]], speed=0.5)
    robot.move_joints(start, speed=0.5)
    robot.io.write('DO', 5, 1)
    print('cycle done, DO 5 is', robot.io.read('DO', 5))
