# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A program with a defect: after a failed motion it waits forever."""

from moving import Mover

mover = Mover()
why = mover.move()
while why:
    mover.rest(1.0)
print('there')
