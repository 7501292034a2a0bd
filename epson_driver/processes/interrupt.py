# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Handling of Ctrl-C and similar signals before an executable starts, while it runs, and after."""

import asyncio
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, NoReturn

INTERRUPTED = 130  # exit code after SIGINT, as used by shells: 128 plus the signal number

AFTER_FINALIZER_S = 0.001

ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGQUIT, signal.SIGHUP)
"""Signals that end a process. SIGHUP: the terminal was closed, or its connection lost."""


def ending_signals() -> list[signal.Signals]:
    """Return the signals that end an executable: all but SIGHUP if nohup ignores that."""
    ignored = signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    return [number for number in ENDING if number is not signal.SIGHUP or not ignored]


def leave_at_interrupt() -> None:
    """Make SIGINT end the process immediately and without a traceback, even during imports.

    This may only be used while no arm moves and nothing needs cleanup.
    """
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
        signal.signal(signal.SIGINT, _leave)


def raise_at_interrupt() -> None:
    """Raise KeyboardInterrupt on all signals that end a process, except ignored signals."""
    for number in ENDING:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, signal.default_int_handler)


def ignore_interrupts() -> None:
    """Ignore the terminal's signals, which could kill the interpreter during shutdown."""
    for number in (signal.SIGINT, signal.SIGQUIT, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)


def raise_at_first_signal() -> None:
    """Raise KeyboardInterrupt on the first signal that ends a process, and ignore later ones.

    Later signals must not interrupt the ending of the started processes. Python ignores an
    exception in a finalizer, so the interrupt is raised again after the finalizer.
    """
    for number in (*ending_signals(), signal.SIGALRM):
        signal.signal(number, _raise_once)
    sys.unraisablehook = _raise_after_finalizer


@contextmanager
def interrupts_held() -> Iterator[None]:
    """Delay interrupts in the block. Other threads than the main thread receive none."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    waiting: list[int] = []

    def wait(number: int, _frame: object) -> None:
        waiting.append(number)

    numbers = (*ending_signals(), signal.SIGALRM)
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
    """Call `end` in `loop` on each signal that ends a process. Only for the main thread.

    The signals except SIGTERM call `end` until the loop is closed, and are ignored after that.
    (The loop removes its own handlers while it closes. With these, another Ctrl-C at that time
    would raise KeyboardInterrupt at an arbitrary place.)
    """

    def interrupt(_number: int, _frame: object) -> None:
        if not loop.is_closed():
            loop.call_soon_threadsafe(end)

    loop.add_signal_handler(signal.SIGTERM, end)  # this also makes every signal wake the loop
    for number in ending_signals():
        if number is not signal.SIGTERM:
            signal.signal(number, interrupt)
            signal.siginterrupt(number, False)
    try:
        yield
    finally:
        # The loop closes its wakeup socket before it removes the handler. A signal between the two
        # would be reported as an exception.
        signal.set_wakeup_fd(-1)


def _raise_once(_number: int, _frame: object) -> NoReturn:
    for number in ENDING:
        signal.signal(number, signal.SIG_IGN)
    raise KeyboardInterrupt


def _raise_after_finalizer(unraisable: Any) -> None:
    if unraisable.exc_type is KeyboardInterrupt:
        signal.setitimer(signal.ITIMER_REAL, AFTER_FINALIZER_S)
    else:
        sys.__unraisablehook__(unraisable)


def _leave(_number: int, _frame: object) -> NoReturn:
    os._exit(INTERRUPTED)
