# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The settings of a driver as one table, and the creation of a driver, for ROS and for Python."""
