# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Signals of a terminal for the processes of tests."""

import signal


def obey_interrupts() -> None:
    """Let a child obey the terminal: `&` and `nohup` pass them on ignored.

    For `preexec_fn`.
    """
    for number in (signal.SIGINT, signal.SIGQUIT, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)
