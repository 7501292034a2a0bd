# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Write joint positions and velocities to a CSV file, 50 times a second, while the arm moves."""

import csv
import sys
import time
from pathlib import Path

from epson_driver import Robot

with Robot(sys.argv[1]) if len(sys.argv) > 1 else Robot.simulated() as robot:
    robot.enable()
    start = robot.joints
    motion = robot.move_joints([start[0] + 0.2, *start[1:]], speed=0.1, wait=False)
    rows = 0
    with Path('joints.csv').open('w', newline='') as file:
        writer = csv.writer(file)
        while not motion.done:
            sample = robot.sample()
            writer.writerow([sample.time, *sample.positions, *sample.velocities])
            rows += 1
            time.sleep(0.02)
    print(motion.wait(), '-', 'joints.csv has rows' if rows else 'no sample')
