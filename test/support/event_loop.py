# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Asynchronous tests: `async def test_…` runs like with `run`, and waits by `until(condition)`.

Sockets are real and time is virtual. When all callbacks have run and no bytes can be read, the
loop's clock jumps to the next timer. A busy machine makes a test slower but does not change its
result, because no timer is late.

Another process works in real time. Tests with one use `run(scenario(), real_time=True)`, or
`with real_time():` while they wait for it. Time is real automatically while a thread works for the
loop (`run_in_executor`).
"""

import asyncio
import contextlib
import heapq
import select
import selectors
import socket
import time
from collections import deque
from collections.abc import Awaitable, Callable, Coroutine, Iterator
from contextvars import Context, ContextVar, copy_context
from functools import partial
from typing import Any

PATIENCE = 60.0
"""Timeout of a test, s of its loop's time."""

GRACE = 2e-4
"""Real time for which an idle loop waits for bytes in the system, s. The sending call delivers
them, but a busy system may delay that."""

CONNECT_GRACE = 1.0
"""The same for a connection that is neither established nor refused, s of real time."""

TCP_SYN_SENT = 2
"""State of a pending connection (Linux, tcp_states.h)."""

TURN = 1e-6
"""Virtual time of one loop iteration, s. Without it, a timer for a rounding error would be due
repeatedly."""

LOOK = 0.01
"""Polling interval for conditions in real time, s, because a thread or another process may change
them."""

START = 1000.0
"""The loop's initial time, s, which is not 0 because 0 may mean 'never'."""


_MAY_HANG: ContextVar[bool] = ContextVar('may_hang', default=False)
"""Set in a process that a test may suspend, and inherited by its tasks."""


class EventLoop(asyncio.SelectorEventLoop):
    """The event loop of a test, in virtual or real time."""

    def __init__(self, *, real_time: bool = False) -> None:
        self.virtual = not real_time
        self.now = START
        self.threads = 0
        self.hangs = False
        self._held: list[asyncio.Handle] = []
        self._waiting: list[tuple[Callable[[], object], asyncio.Future[None]]] = []
        super().__init__(_Selector(self))

    def time(self) -> float:
        """Return the loop's time, s."""
        return self.now if self.virtual else time.monotonic()

    def run_in_executor(  # type: ignore[override]
        self, executor: Any, func: Any, *args: Any
    ) -> Any:
        """Call a function in a thread, with real time until it returns."""
        future = super().run_in_executor(executor, func, *args)
        self.threads += 1
        future.add_done_callback(self._thread_done)
        return future

    async def shutdown_default_executor(self, *args: Any) -> None:
        """Wait in real time until all threads have ended."""
        self.threads += 1
        try:
            await super().shutdown_default_executor(*args)
        finally:
            self.threads -= 1

    def until(self, condition: Callable[[], object]) -> Awaitable[None]:
        """Return a future that is done when a condition holds, tested after every iteration."""
        future = self.create_future()
        self._waiting.append((condition, future))
        self.call_soon(lambda: None)  # it may already hold
        return future

    @property
    def waits(self) -> bool:
        """Whether a test waits for a condition."""
        return bool(self._waiting)

    def _thread_done(self, _future: object) -> None:
        self.threads -= 1

    def go_on(self) -> None:
        """Resume suspended processes with their overdue callbacks in order."""
        self.hangs = False
        for handle in self._held:
            if isinstance(handle, asyncio.TimerHandle):
                heapq.heappush(self._scheduled, handle)
            else:
                self._ready.append(handle)
        self._held = []

    def _hold(self) -> None:
        """Remove the callbacks of suspended processes."""
        ready: deque[asyncio.Handle] = self._ready  # type: ignore[has-type]
        scheduled: list[asyncio.TimerHandle] = self._scheduled  # type: ignore[has-type]
        self._held += [handle for handle in (*ready, *scheduled) if may_hang(handle)]
        self._ready = deque(handle for handle in ready if not may_hang(handle))
        self._scheduled = [handle for handle in scheduled if not may_hang(handle)]
        heapq.heapify(self._scheduled)

    def _run_once(self) -> None:
        self.now += TURN
        if self.hangs:
            self._hold()
        super()._run_once()  # type: ignore[misc]
        self._waiting = [entry for entry in self._waiting if not _settled(*entry)]


def may_hang(handle: asyncio.Handle | None) -> bool:
    """Return whether a callback belongs to a process that a test may suspend."""
    context = getattr(handle, '_context', None)  # asyncio has no public access
    return context is not None and bool(context.get(_MAY_HANG))


def _settled(condition: Callable[[], object], future: asyncio.Future[None]) -> bool:
    if not future.done():
        try:
            if condition():
                future.set_result(None)
        except Exception as error:  # noqa: BLE001 - raised where the test waits
            future.set_exception(error)
    return future.done()


class _Selector(selectors.DefaultSelector):
    """A selector that lets the loop's clock advance instead of waiting."""

    def __init__(self, loop: EventLoop) -> None:
        super().__init__()
        self._loop = loop

    def select(self, timeout: float | None = None) -> list[Any]:
        """Return the ready files."""
        ready = self._readable()
        if ready or timeout == 0:
            return ready
        loop = self._loop
        if loop.threads or timeout is None or not loop.virtual:
            if loop.waits:
                timeout = LOOK if timeout is None else min(timeout, LOOK)
            start = time.monotonic()
            ready = super().select(timeout)
            loop.now += time.monotonic() - start
            return ready
        select.select([self.fileno()], [], [], CONNECT_GRACE if self._connects() else GRACE)
        ready = self._readable()
        if not ready:
            loop.now += timeout
        return ready

    def _readable(self) -> list[Any]:
        """Return the files that running processes can read or write."""
        ready = super().select(0)
        if self._loop.hangs:
            ready = [entry for entry in ready if not any(map(may_hang, entry[0].data))]
        return ready

    def _connects(self) -> bool:
        """Return whether a connection is pending in the system."""
        return any(
            key.events & selectors.EVENT_WRITE and _tcp_state(key.fd) == TCP_SYN_SENT
            for key in self.get_map().values()
        )


def _tcp_state(fd: int) -> int | None:
    """Return the state of a TCP socket as Linux counts, or None if it is unknown."""
    if not hasattr(socket, 'TCP_INFO'):
        return None
    copy = socket.socket(fileno=fd)
    try:
        return copy.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, 1)[0]
    except OSError:  # no TCP socket
        return None
    finally:
        copy.detach()


def run(
    coroutine: Coroutine[Any, Any, Any], patience: float = PATIENCE, *, real_time: bool = False
) -> None:
    """Run a test's coroutine, which must leave no task behind."""

    async def timed() -> None:
        async with asyncio.timeout(patience):
            await coroutine
        await asyncio.sleep(0)  # the last transports close
        remaining = asyncio.all_tasks() - {asyncio.current_task()}
        assert not remaining, f'tasks remain: {remaining}'

    with asyncio.Runner(loop_factory=partial(EventLoop, real_time=real_time)) as runner:
        runner.run(timed())


async def until(condition: Callable[[], object]) -> None:
    """Wait until a condition holds, limited by the timeout of `run`."""
    loop = asyncio.get_running_loop()
    assert isinstance(loop, EventLoop)
    await loop.until(condition)


async def accepted() -> None:
    """Let accepted connections be served before a server is closed.

    asyncio would not close their sockets.
    """
    for _ in range(5):
        await asyncio.sleep(0)


@contextlib.contextmanager
def real_time() -> Iterator[None]:
    """Let time be real while another process works for the loop."""
    loop = asyncio.get_running_loop()
    assert isinstance(loop, EventLoop)
    loop.threads += 1
    try:
        yield
    finally:
        loop.threads -= 1


def now() -> float:
    """Return the running loop's time, s."""
    return asyncio.get_running_loop().time()


def own_process() -> Context:
    """Return a context for a process that a test may suspend: a task in it and all its tasks."""
    context = copy_context()
    context.run(_MAY_HANG.set, True)
    return context


@contextlib.contextmanager
def hanging() -> Iterator[None]:
    """Suspend all `own_process` contexts like a stopped process, while the others run.

    Messages wait in their sockets until the block ends, and their timers are late.
    """
    loop = asyncio.get_running_loop()
    assert isinstance(loop, EventLoop)
    loop.hangs = True
    try:
        yield
    finally:
        loop.go_on()


def stand_still(seconds: float) -> None:
    """Stall the loop for `seconds`, like a busy machine."""
    loop = asyncio.get_running_loop()
    assert isinstance(loop, EventLoop)
    if loop.virtual:
        loop.now += seconds
    else:
        time.sleep(seconds)
