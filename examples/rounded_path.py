# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Follow a rectangle with rounded corners in a frame of its own, such as that of a tray."""

import sys

from epson_driver import Robot

BENT = [0.0, 0.2, 0.2, 0.0, -1.9, 0.0]
SAME = [0.0, 0.0, 0.0, 1.0]  # a quaternion: no rotation

with Robot(sys.argv[1]) if len(sys.argv) > 1 else Robot.simulated(start=BENT) as robot:
    robot.enable()
    robot.set_frame('tray', robot.tool_pose)
    corners = [[0.0, 0.04, 0.0], [0.05, 0.04, 0.0], [0.05, 0.0, 0.0], [0.0, 0.0, 0.0]]  # m
    motion = robot.move_path(
        [[*xyz, *SAME] for xyz in corners], frame='tray', blend=0.01, speed=0.1
    )
    print(motion.text)
