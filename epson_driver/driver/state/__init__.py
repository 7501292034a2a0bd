# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What the controller reports, and what follows from it: pose, velocity, standstill, pauses."""
