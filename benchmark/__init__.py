# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Benchmarks: how good the motion is, held against bounds that others can compute."""

from pathlib import Path

ROOT = Path(__file__).parents[1]
