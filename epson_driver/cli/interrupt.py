# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Ctrl-C where nothing needs to be stopped: before an executable has begun and after its end."""

import os
import signal
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import NoReturn

INTERRUPTED = 130
"""The exit code after SIGINT, as shells have it: 128 and the number of the signal."""


def leave_at_interrupt() -> None:
    """Have SIGINT end the process at once, without a traceback, whatever is being imported.

    Only where nothing moves or has to be ended. A SIGINT that is ignored, as by a shell's `&`,
    stays so.
    """
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
        signal.signal(signal.SIGINT, _leave)


def raise_at_interrupt() -> None:
    """Have SIGINT raise KeyboardInterrupt again, as Python does."""
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def ignore_interrupts() -> None:
    """Ignore SIGINT from now on: the work is done, and what is left of the process ends by itself.

    Nothing else keeps a second Ctrl-C from killing an interpreter that shuts down.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)


@contextmanager
def interrupts_held(numbers: Sequence[int]) -> Iterator[None]:
    """Keep signals waiting during the block: what it starts is known to who must end it.

    To be used in the main thread.
    """
    waiting: list[int] = []

    def wait(number: int, _frame: object) -> None:
        waiting.append(number)

    before = {number: signal.signal(number, wait) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        if waiting:
            signal.raise_signal(waiting[0])


def end_of_signals() -> None:
    """Have signals do nothing while an event loop closes, which has stopped all that it ran.

    It closes the socket that wakes it up before it takes its handlers back: a signal between the
    two would be reported as an exception.
    """
    signal.set_wakeup_fd(-1)


def _leave(_number: int, _frame: object) -> NoReturn:
    os._exit(INTERRUPTED)
