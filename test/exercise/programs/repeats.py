# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A program with a dangerous defect: after any failure it enables the arm and tries again."""

from moving import Mover

mover = Mover()
while mover.move():
    mover.rest(0.5)
    mover.call('reset_error')
    mover.call('enable')
    mover.rest(0.5)
print('there')
