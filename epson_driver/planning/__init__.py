# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A pick-and-place planner: obstacles around the arm, a path between them, and the check.

Needs the libraries of `pip install 'epson_driver[planning]'`: OMPL, and pinocchio with coal.
Nothing else of the package imports this one but the demo.
"""
