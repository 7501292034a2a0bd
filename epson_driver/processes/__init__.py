# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Start, monitor and end this package's processes: ports, ROS domains, values, signals, plots."""
