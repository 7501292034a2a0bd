# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Makes the folder benchmark/ importable, which is not part of the installed package."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
