# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Move over parts that a camera on the flange has found, by its hand-eye calibration."""

import sys

import numpy as np

from epson_driver import Robot

BENT = [0.0, 0.2, 0.2, 0.0, -1.9, 0.0]
# The pose of the camera in tool0, from a hand-eye calibration (cv2.calibrateHandEye), in m.
CAMERA = np.array(
    [[0.0, -1.0, 0.0, 0.05], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.03], [0, 0, 0, 1]]
)
FOUND = [[0.02, 0.01, 0.20], [-0.03, 0.02, 0.20]]  # parts in the frame of the camera, m

with Robot(sys.argv[1]) if len(sys.argv) > 1 else Robot.simulated(start=BENT) as robot:
    robot.enable()
    photo = robot.pose  # where the picture was taken
    for part in FOUND:
        target = photo.copy()
        target[:3, 3] = (photo @ CAMERA @ [*part, 1.0])[:3] - 0.15 * photo[
            :3, 2
        ]  # 150 mm before it
        robot.move_line(target, speed=0.1)
        print('over the part at', (photo @ CAMERA @ [*part, 1.0])[:3].round(3), 'm')
    robot.move_line(photo, speed=0.1)
