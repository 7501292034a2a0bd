# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Benchmarks of the motion quality against bounds that others can compute."""

import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT.resolve() / 'test'))  # for test/support
