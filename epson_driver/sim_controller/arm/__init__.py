# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The arm: motion to points, joints that follow, and the planner of smooth motion."""
