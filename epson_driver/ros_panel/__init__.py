# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The robots of the panel in ROS: drivers, accessed by topics, services and the action."""
