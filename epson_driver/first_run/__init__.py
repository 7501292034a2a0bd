# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The first run of a real robot: guided steps, each confirmed, recorded in one file.

steps.py defines the steps. trial_move.py moves the arm and measures the times. record.py writes
and reads the file, from which a simulated controller can be set up like the robot.
"""
