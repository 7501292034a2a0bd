# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A correct program: it moves once, and on failure it prints the reason and ends."""

import sys

from moving import Mover

try:
    why = Mover().move()
except RuntimeError as error:
    why = str(error)
print(f'gave up: {why}' if why else 'there')
sys.exit(1 if why else 0)
