# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Enable the arm, turn joint 1 by 0.1 rad at a tenth of its speed, and turn it back."""

import sys

from epson_driver import Robot

with Robot(sys.argv[1]) if len(sys.argv) > 1 else Robot.simulated() as robot:
    print(robot.enable())
    start = robot.joints
    print(robot.move_joints([start[0] + 0.1, *start[1:]], speed=0.1).text)
    print(robot.move_joints(start, speed=0.1).text)
