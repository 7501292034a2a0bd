# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Signals of a terminal for the processes of tests."""

import signal


def obey_interrupts() -> None:
    """Let a child obey the terminal: whoever runs these tests by `&` ignores both signals.

    For `preexec_fn`.
    """
    for number in (signal.SIGINT, signal.SIGQUIT):
        signal.signal(number, signal.SIG_DFL)
