# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""SIGINT for the processes of tests."""

import signal


def obey_interrupts() -> None:
    """Let a child obey SIGINT as in a terminal: whoever runs these tests by `&` ignores it.

    For `preexec_fn`.
    """
    signal.signal(signal.SIGINT, signal.SIG_DFL)
