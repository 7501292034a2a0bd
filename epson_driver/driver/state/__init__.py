# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""State of the arm and its controller: positions, velocities, standstill and pauses."""
