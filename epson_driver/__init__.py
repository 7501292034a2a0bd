# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""ROS 2 driver for EPSON and other simple-message robot controllers, with a simulated one."""
