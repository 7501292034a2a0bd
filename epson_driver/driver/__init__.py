# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The driver of a controller, without ROS: its state, its goals and how they reach it."""
