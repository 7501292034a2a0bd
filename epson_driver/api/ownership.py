# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Ownership of arms: at most one Robot of this process is connected to an arm.

* If a Robot connects to an arm, another connected Robot of this process is closed first. This
  allows a notebook cell to run twice.
* When the interpreter ends, open connections are closed and their arms stopped.
* A forked child process does not share the connections of its parent.
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
"""Timeout for closing when the interpreter ends, s."""

_log = logging.getLogger(__name__)


class Unique:
    """Base class of objects that cannot be copied or pickled."""

    def __reduce__(self) -> NoReturn:
        kind = type(self).__name__
        raise TypeError(
            f'a {kind} cannot be copied or pickled, because there is one arm: create another'
        )


class Process:
    def __init__(self) -> None:
        self._number = os.getpid()

    @property
    def forked(self) -> bool:
        return os.getpid() != self._number

    def check(self) -> None:
        if self.forked:
            raise RobotError(
                'this Robot belongs to the parent process: create another one after the fork'
            )


class Owner(Protocol):
    """Interface of a connection, which owns an arm."""

    loop: asyncio.AbstractEventLoop

    @property
    def files(self) -> list[int]:
        """File descriptors of the connection's sockets and pipes."""

    async def close(self) -> None:
        """Stop the arm and disconnect."""


class Page(Protocol):
    """A panel in the browser that shows the robot of a connection.

    `url`: address of the page. `ended`: set when the panel has ended. After that, `code` is its
    exit code.
    """

    url: str
    ended: asyncio.Event
    code: int

    async def close(self) -> None:
        """Cancel the motions that the panel has started, and close the panel."""


Address = tuple[str, int]

_owners: dict[Address, Owner] = {}
_lock = threading.Lock()


async def take_over(address: Address, owner: Owner) -> None:
    with _lock:
        before, _owners[address] = _owners.get(address), owner
    if before is None or before is owner or before.loop.is_closed():
        return
    _log.warning('%s:%d: closing the Robot object that this program connected earlier', *address)
    if before.loop is asyncio.get_running_loop():
        await before.close()
    elif before.loop.is_running():
        closing = asyncio.run_coroutine_threadsafe(before.close(), before.loop)
        await asyncio.wrap_future(closing)


def release(owner: Owner) -> None:
    with _lock:
        for address in [item for item, result in _owners.items() if result is owner]:
            del _owners[address]


def close_soon(
    loop: asyncio.AbstractEventLoop,
    process: Process,
    close: Callable[[], Coroutine[Any, Any, None]],
) -> None:
    """Schedule `close` in the event loop. Any thread and finalizers may call this."""
    if process.forked or loop.is_closed():
        return

    def start() -> None:
        _closing.add(task := loop.create_task(close()))
        task.add_done_callback(_closing.discard)

    loop.call_soon_threadsafe(start)


_closing: set['asyncio.Task[None]'] = set()


@atexit.register
def _close_all() -> None:
    for (host, port), owner in list(_owners.items()):
        if owner.loop.is_running():
            closing = asyncio.run_coroutine_threadsafe(owner.close(), owner.loop)
            try:
                closing.result(CLOSE_TIMEOUT_S)
            except Exception:  # noqa: BLE001 - the other connections must be closed, too
                _log.exception('%s:%d was not closed properly', host, port)


def _close_in_child() -> None:
    """Close the parent's sockets in a forked child. The child's copies would keep them open."""
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
    os.register_at_fork(after_in_child=_close_in_child)
