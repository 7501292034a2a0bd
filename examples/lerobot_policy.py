# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Run a policy on a lerobot robot of type epson. Needs variants/lerobot_robot_epson."""

import math
import sys
import time

from lerobot_robot_epson import EpsonRobot, EpsonRobotConfig

config = EpsonRobotConfig(host=sys.argv[1]) if len(sys.argv) > 1 else EpsonRobotConfig()
with EpsonRobot(config) as robot:
    start = robot.get_observation()['joint_1.pos']
    for step in range(60):
        action = robot.get_observation()  # a policy computes the action from this
        action['joint_1.pos'] = start + 0.1 - 0.1 * math.cos(step / 20)
        robot.send_action(action)
        time.sleep(1 / 30)
    print('done')
