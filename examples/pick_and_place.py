# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Move four parts from a pallet of two rows to one place, with a gripper on output 0."""

import sys
import time

from epson_driver import Pallet, Robot

BENT = [0.0, 0.2, 0.2, 0.0, -1.9, 0.0]

with Robot(sys.argv[1]) if len(sys.argv) > 1 else Robot.simulated(start=BENT) as robot:

    def grip(closed: bool) -> None:
        robot.io.write('DO', 0, int(closed))
        time.sleep(0.3)

    robot.enable()
    corner = robot.epson_point.moved(z=-40.0)  # on a real robot: robot.points['corner']
    pallet = Pallet(corner, corner.moved(x=60.0), corner.moved(y=40.0), columns=2, rows=2)
    place = corner.moved(y=-60.0)
    for part in pallet:
        robot.move_path([part.moved(z=30.0), part], blend=0.005, speed=0.2)
        grip(True)
        robot.move_path([part.moved(z=30.0), place.moved(z=30.0), place], blend=0.005, speed=0.2)
        grip(False)
        robot.move_line(place.moved(z=30.0), speed=0.2)
    print(f'{len(pallet)} parts moved')
