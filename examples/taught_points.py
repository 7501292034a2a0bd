# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Teach two points, save them as RC+'s .pts file, and move to them by name."""

import sys

from epson_driver import Robot

BENT = [0.0, 0.2, 0.2, 0.0, -1.9, 0.0]

with Robot(sys.argv[1]) if len(sys.argv) > 1 else Robot.simulated(start=BENT) as robot:
    robot.enable()
    robot.points.teach('home')
    robot.move_line(robot.epson_point.moved(x=30.0), speed=0.1)
    robot.points.teach('pick')
    robot.points.save('robot1.pts')
    robot.points.load('robot1.pts')
    robot.move_joints(robot.points['home'])
    robot.move_line(robot.points['pick'].moved(z=20.0), speed=0.1)  # 20 mm above the point
    print(robot.points['home'], robot.points['pick'])
