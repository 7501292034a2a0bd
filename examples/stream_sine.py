# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Follow a sine of joint 1 at 50 Hz for two seconds, as a learned policy or a leader arm would."""

import math
import sys
import time

from epson_driver import Robot

with Robot(sys.argv[1]) if len(sys.argv) > 1 else Robot.simulated() as robot:
    robot.enable()
    start, begin = robot.joints, time.monotonic()
    while (passed := time.monotonic() - begin) < 2.0:
        robot.servo([start[0] + 0.05 * (1.0 - math.cos(math.pi * passed)), *start[1:]])
        time.sleep(0.02)
    print(robot.servo_end())
