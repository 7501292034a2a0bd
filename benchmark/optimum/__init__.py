# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""OPT: the jerk-limited optimum, on a path and with a free one, which times are held against."""

from benchmark.optimum.free_path import FreeOptimum, free_path_optimum
from benchmark.optimum.jerk_limited import Optimum, jerk_limited_optimum

__all__ = ['FreeOptimum', 'Optimum', 'free_path_optimum', 'jerk_limited_optimum']
