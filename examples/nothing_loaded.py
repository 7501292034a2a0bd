# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Move a controller that has no program loaded, through EPSON's Remote Ethernet commands."""

import sys

from epson_driver import Robot

BENT = [0.0, 0.2, 0.2, 0.0, -1.9, 0.0]

robot = (
    Robot(sys.argv[1]) if len(sys.argv) > 1 else Robot.simulated(controller='remote', start=BENT)
)
with robot:
    robot.set_payload(0.5, [0.0, 0.0, 0.05])  # 0.5 kg, 50 mm in front of the flange
    robot.enable()
    here = robot.epson_point
    robot.move_line(here.moved(z=20.0), speed=0.05)  # 20 mm up
    robot.move_line(here, speed=0.05)
    print('DI 0 is', robot.io.read('DI', 0))
