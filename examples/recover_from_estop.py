# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Continue a job after an E-stop, once a person has released it and confirms."""

import sys

from epson_driver import MotionError, Robot

simulated = len(sys.argv) == 1
with Robot.simulated() if simulated else Robot(sys.argv[1]) as robot:
    robot.enable()
    start = robot.joints
    target = [start[0] + 0.4, *start[1:]]
    try:
        motion = robot.move_joints(target, speed=0.05, wait=False)
        if simulated:
            robot.simulation.estop()
        motion.wait()
    except MotionError as error:
        print('interrupted:', error)
        print(robot.status.remedy)
        if simulated:
            robot.simulation.estop(pressed=False)
        else:
            input('Release the E-stop, look at the arm, then press Enter: ')
        robot.reset(enable=True)
        robot.move_joints(target, speed=0.05)
    print('arrived')
