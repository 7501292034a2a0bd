# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The ROS 2 node: topics, services and the action on one side, the driver on the other."""
