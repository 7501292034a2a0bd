# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The driver without ROS: robot state, goals, setpoint streams, stopping, motors and I/O."""
