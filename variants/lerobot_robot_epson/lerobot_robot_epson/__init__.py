# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""EPSON arms for lerobot, which imports packages with this name prefix automatically."""

from lerobot_robot_epson.config_epson import EpsonLeaderConfig, EpsonRobotConfig
from lerobot_robot_epson.epson_leader import EpsonLeader
from lerobot_robot_epson.epson_robot import EpsonRobot

__all__ = ['EpsonLeader', 'EpsonLeaderConfig', 'EpsonRobot', 'EpsonRobotConfig']
