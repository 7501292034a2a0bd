# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Joint limits, trajectories and joint motions, without clock, I/O or ROS."""

from epson_driver.motion.limits import Array, JointLimits
from epson_driver.motion.point_to_point import LineMotion, go
from epson_driver.motion.smooth import smooth
from epson_driver.motion.trajectory import Trajectory, problems

__all__ = ['Array', 'JointLimits', 'LineMotion', 'Trajectory', 'go', 'problems', 'smooth']
