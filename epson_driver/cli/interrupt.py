# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Ctrl-C before an executable has begun, while its event loop runs, and after its end."""

import asyncio
import os
import signal
import socket
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import NoReturn

INTERRUPTED = 130
"""The exit code after SIGINT, as shells have it: 128 and the number of the signal."""

END_SIGNALS = (signal.SIGINT, signal.SIGTERM)


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


@contextmanager
def ended_by_signals(loop: asyncio.AbstractEventLoop, end: Callable[[], object]) -> Iterator[None]:
    """Have SIGINT and SIGTERM call `end` in an event loop during the block.

    After the block, when all has been stopped, SIGINT does nothing any more. (What
    `loop.add_signal_handler` sets is taken back while the loop closes: another Ctrl-C in that
    moment is a KeyboardInterrupt wherever the process just is.)

    To be used in the main thread, before the loop closes.
    """
    signaled, tell = socket.socketpair()
    with signaled, tell:
        for each in (signaled, tell):
            each.setblocking(False)

        def read() -> None:
            signaled.recv(4096)
            end()

        loop.add_reader(signaled, read)
        signal.set_wakeup_fd(tell.fileno(), warn_on_full_buffer=False)
        for number in END_SIGNALS:
            signal.signal(number, _nothing)
            signal.siginterrupt(number, False)
        try:
            yield
        finally:
            signal.signal(signal.SIGTERM, signal.SIG_DFL)
            signal.set_wakeup_fd(-1)
            loop.remove_reader(signaled)


def _nothing(_number: int, _frame: object) -> None:
    """Leave a signal to who is woken up by it."""


def _leave(_number: int, _frame: object) -> NoReturn:
    os._exit(INTERRUPTED)
