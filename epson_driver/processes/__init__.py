# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Start, watch and end processes of our own: ports, ROS domains, values, signals, figures."""
