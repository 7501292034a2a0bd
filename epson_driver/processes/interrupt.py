# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Ctrl-C and its like before an executable begins, while it runs, and after its end."""

import asyncio
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import NoReturn

INTERRUPTED = 130
"""The exit code after SIGINT, as shells have it: 128 and the number of the signal."""


ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGQUIT, signal.SIGHUP)
"""SIGHUP: the terminal was closed, or its connection lost."""


def ending_signals() -> list[signal.Signals]:
    """Return the signals that end an executable: without SIGHUP under nohup."""
    ignored = signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    return [number for number in ENDING if number is not signal.SIGHUP or not ignored]


def leave_at_interrupt() -> None:
    """Have SIGINT end the process at once, without a traceback, whatever is being imported.

    Only where nothing moves or has to be ended. A SIGINT that is ignored, as by a shell's `&`,
    stays so.
    """
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
        signal.signal(signal.SIGINT, _leave)


def raise_at_interrupt() -> None:
    """Raise KeyboardInterrupt at all signals that end a process, as Python does at SIGINT.

    A signal that is ignored stays so.
    """
    for number in ENDING:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, signal.default_int_handler)


def ignore_interrupts() -> None:
    """Ignore what the terminal sends: the work is done, and the process ends by itself.

    Nothing else keeps a second Ctrl-C from killing an interpreter that shuts down.
    """
    for number in (signal.SIGINT, signal.SIGQUIT, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)


def raise_at_first_signal() -> None:
    """Raise KeyboardInterrupt at the first signal that ends a process, and ignore the others.

    So what was started is always ended. SIGINT too: a shell's `&` passes it on ignored.
    """
    for number in ending_signals():
        signal.signal(number, _raise_once)


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


@contextmanager
def ended_by_signals(loop: asyncio.AbstractEventLoop, end: Callable[[], object]) -> Iterator[None]:
    """Call `end` in a loop at each signal that ends a process, until everything is stopped.

    All but SIGTERM call it to the loop's end, and do nothing from then on. (With a handler of the
    loop's own, which it takes back while it closes, another Ctrl-C in that moment would be a
    KeyboardInterrupt wherever the process just is.)

    To be used in the main thread, before the loop closes.
    """

    def interrupt(_number: int, _frame: object) -> None:
        if not loop.is_closed():
            loop.call_soon_threadsafe(end)

    loop.add_signal_handler(signal.SIGTERM, end)  # and each signal wakes the loop up
    for number in ending_signals():
        if number is not signal.SIGTERM:
            signal.signal(number, interrupt)
            signal.siginterrupt(number, False)
    try:
        yield
    finally:
        # the loop closes the socket that wakes it up before it takes its handler back: a signal
        # between the two would be reported as an exception
        signal.set_wakeup_fd(-1)


def _raise_once(_number: int, _frame: object) -> NoReturn:
    for number in ENDING:
        signal.signal(number, signal.SIG_IGN)
    raise KeyboardInterrupt


def _leave(_number: int, _frame: object) -> NoReturn:
    os._exit(INTERRUPTED)
