# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Who owns a connection to an arm: one Robot of this process, which lets go however it ends.

* A Robot that connects to an arm to which another one of this process is connected takes it over:
  that one is closed first. A notebook's cell that is run twice works.
* What is still connected when the interpreter ends is closed, the arm stopped.
* A child process that was forked has no part in the connections of its parent.
"""

import asyncio
import atexit
import contextlib
import logging
import os
import threading
from collections.abc import Callable, Coroutine
from typing import Any, NoReturn, Protocol

from epson_driver.api.errors import RobotError

CLOSE_TIMEOUT_S = 10.0
"""How long closing may take when the interpreter ends, s."""

_log = logging.getLogger(__name__)


class Unique:
    """Something that is neither copied nor pickled."""

    def __reduce__(self) -> NoReturn:
        kind = type(self).__name__
        raise TypeError(f'a {kind} cannot be copied or pickled: there is one arm; make another')


class Process:
    """The process in which something was made."""

    def __init__(self) -> None:
        self._number = os.getpid()

    @property
    def forked(self) -> bool:
        """True in a child that was forked since."""
        return os.getpid() != self._number

    def check(self) -> None:
        """Raise RobotError in a child that was forked since."""
        if self.forked:
            raise RobotError(
                'this Robot belongs to the process from which this one was forked: make one here'
            )


class Owned(Protocol):
    """What is connected to an arm."""

    loop: asyncio.AbstractEventLoop

    @property
    def files(self) -> list[int]:
        """The descriptors of its sockets and pipes."""

    async def close(self) -> None:
        """Stop the arm and disconnect."""


Address = tuple[str, int]

_owners: dict[Address, Owned] = {}
_lock = threading.Lock()


async def take_over(address: Address, owner: Owned) -> None:
    """Own a connection to this address, after closing the one that owned it before."""
    with _lock:
        before, _owners[address] = _owners.get(address), owner
    if before is None or before is owner or before.loop.is_closed():
        return
    _log.warning('%s:%d: another Robot of this program was connected, and is closed', *address)
    if before.loop is asyncio.get_running_loop():
        await before.close()
    elif before.loop.is_running():
        closing = asyncio.run_coroutine_threadsafe(before.close(), before.loop)
        await asyncio.wrap_future(closing)


def let_go(owner: Owned) -> None:
    """Own no connection any more."""
    with _lock:
        for address in [each for each, found in _owners.items() if found is owner]:
            del _owners[address]


def close_soon(
    loop: asyncio.AbstractEventLoop,
    process: Process,
    close: Callable[[], Coroutine[Any, Any, None]],
) -> None:
    """Close in its event loop what the garbage collector found lost, in any thread."""
    if process.forked or loop.is_closed():
        return

    def begin() -> None:
        _closing.add(task := loop.create_task(close()))
        task.add_done_callback(_closing.discard)

    loop.call_soon_threadsafe(begin)


_closing: set['asyncio.Task[None]'] = set()


@atexit.register
def _close_all() -> None:
    for (host, port), owner in list(_owners.items()):
        if owner.loop.is_running():
            closing = asyncio.run_coroutine_threadsafe(owner.close(), owner.loop)
            try:
                closing.result(CLOSE_TIMEOUT_S)
            except Exception:  # noqa: BLE001 - the others are closed all the same
                _log.exception('%s:%d was not closed as it should be', host, port)


def _forget() -> None:
    """Leave the parent's sockets to the parent: with a copy of them here, none would close."""
    global _lock  # a thread of the parent may hold it
    _lock = threading.Lock()
    owners, nowhere = list(_owners.values()), os.open(os.devnull, os.O_RDWR)
    _owners.clear()
    for owner in owners:
        for number in owner.files:
            with contextlib.suppress(OSError):
                os.dup2(nowhere, number, inheritable=False)
    os.close(nowhere)


if hasattr(os, 'register_at_fork'):
    os.register_at_fork(after_in_child=_forget)
