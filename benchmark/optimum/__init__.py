# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""OPT: the jerk-limited optimum on a path, which the smoother's times are held against."""

from benchmark.optimum.jerk_limited import Optimum, jerk_limited_optimum

__all__ = ['Optimum', 'jerk_limited_optimum']
