# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The ROS 2 node, which connects topics, services and actions with the driver."""
