# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The controller's state, as reported and derived: pose, velocity, standstill, pauses."""
