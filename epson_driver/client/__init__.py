# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The ROS 2 node that drives a controller."""
