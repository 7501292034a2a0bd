# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Adds the folder benchmark/, which is not installed, to the import path."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
