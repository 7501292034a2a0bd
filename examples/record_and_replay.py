# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Record a motion, save it, and repeat it at half the speed."""

import sys

from epson_driver import Robot
from epson_driver.robot import Recording

with Robot(sys.argv[1]) if len(sys.argv) > 1 else Robot.simulated() as robot:
    robot.enable()
    start = robot.joints
    recording = robot.record(rate=20.0)
    robot.move_waypoints(
        [[start[0] + 0.2, *start[1:]], [start[0], start[1] + 0.1, *start[2:]], start]
    )
    recording.stop()
    recording.save('motion.yaml')
    loaded = Recording.load('motion.yaml')
    print(f'{len(loaded.times)} samples, {loaded.duration:.1f} s')
    print(robot.replay(loaded, speed=0.5).text)
