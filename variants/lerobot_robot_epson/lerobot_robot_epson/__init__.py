# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""EPSON arms for lerobot: `--robot.type=epson`, and `--teleop.type=epson_leader` to lead one.

lerobot imports packages of this name by itself, which registers both. See README.md.
"""

from lerobot_robot_epson.config_epson import EpsonLeaderConfig, EpsonRobotConfig
from lerobot_robot_epson.epson_leader import EpsonLeader
from lerobot_robot_epson.epson_robot import EpsonRobot

__all__ = ['EpsonLeader', 'EpsonLeaderConfig', 'EpsonRobot', 'EpsonRobotConfig']
