# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Replaces closed standard streams, for example after `>&-`, by /dev/null."""

import os
import sys


def open_closed_streams() -> None:
    """Open closed standard streams, before any other file is opened.

    Otherwise the next socket would have number 1 or 2, and the log output of C++ libraries would
    be sent to a robot or to ROS.
    """
    for number, name in enumerate(('stdin', 'stdout', 'stderr')):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # it gets the lowest free number
            os.set_inheritable(number, True)
            setattr(sys, name, os.fdopen(number, 'w' if number else 'r', closefd=False))
            setattr(sys, f'__{name}__', getattr(sys, name))
