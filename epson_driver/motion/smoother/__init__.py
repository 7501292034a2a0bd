# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The streaming smoother, which moves through all points without a stop, within every limit."""

from epson_driver.motion.smoother.output_guard import Motion
from epson_driver.motion.smoother.planner import plan
from epson_driver.motion.smoother.request import PASSED_TYPES, Plan, Request
from epson_driver.motion.smoother.smoother import Smoother
from epson_driver.motion.smoother.waypoints import MERGE_TOLERANCE, Mode

__all__ = [
    'MERGE_TOLERANCE',
    'PASSED_TYPES',
    'Mode',
    'Motion',
    'Plan',
    'Request',
    'Smoother',
    'plan',
]
