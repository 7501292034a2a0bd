# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Signals of a terminal for the processes of tests."""

import signal


def obey_interrupts() -> None:
    """Restore the default signal handlers in a child (`preexec_fn`).

    A child of `&` or `nohup` inherits ignored signals.
    """
    for number in (signal.SIGINT, signal.SIGQUIT, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)
