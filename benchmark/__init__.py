# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Benchmarks of the motion quality against bounds that others can compute."""

from pathlib import Path

ROOT = Path(__file__).parents[1]
