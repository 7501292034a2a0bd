# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Standard streams that were closed, as by `>&-`: they become those of /dev/null."""

import os
import sys


def open_closed_streams() -> None:
    """Open what is closed of stdin, stdout and stderr, before anything else is opened.

    Otherwise the next socket would be number 1 or 2, be it a robot's or ROS's, and what C++
    libraries log would be sent there.
    """
    for number, name in enumerate(('stdin', 'stdout', 'stderr')):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # it takes the lowest number that is free
            os.set_inheritable(number, True)
            setattr(sys, name, os.fdopen(number, 'w' if number else 'r', closefd=False))
            setattr(sys, f'__{name}__', getattr(sys, name))
