# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The demo: a planned trajectory through ROS 2 to a simulated controller, measured and judged."""
