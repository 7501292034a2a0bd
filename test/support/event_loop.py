# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""How asynchronous tests run: `async def test_…` as by `run`, with `until(condition)` inside.

Sockets are real, time is virtual: when every callback has run and nothing more can be read, the
loop's clock jumps to its next timer. What takes ten seconds takes as long as its work does, and a
machine that is busy makes a test slower, but never changes what it sees: no timer is late.

What works in another process does so in real time: such tests say `run(scenario(),
real_time=True)`, or `with real_time():` where they wait for it. While a thread works for the loop
(`run_in_executor`), time is real by itself.
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
"""How long a test may take before it fails, s of its loop's time."""

GRACE = 2e-4
"""How long the loop waits, s of real time, for bytes that are still on their way through the
system before it takes nothing to be left to do. The call that sends them delivers them; on a busy
machine the system may put that off."""

CONNECT_GRACE = 1.0
"""The same for a connection that is neither there nor refused yet, s of real time."""

TCP_SYN_SENT = 2
"""A connection that was asked for and not answered yet (Linux, tcp_states.h)."""

TURN = 1e-6
"""What a turn of the loop takes, s of virtual time. Without it a timer for the rest of a rounding
error would be due at once, again and again."""

LOOK = 0.01
"""How often a condition is looked at in real time when nothing happens in the loop, s: a thread or
another process may make it hold."""

START = 1000.0
"""The loop's time in the beginning, s: 0 must not happen to mean 'never'."""


_MAY_HANG: ContextVar[bool] = ContextVar('may_hang', default=False)
"""Set in what belongs to a process that a test lets hang; what it starts inherits it."""


class EventLoop(asyncio.SelectorEventLoop):
    """The loop of a test, in virtual or in real time."""

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
        """Call a function in a thread; until it is done, time is real."""
        future = super().run_in_executor(executor, func, *args)
        self.threads += 1
        future.add_done_callback(self._thread_done)
        return future

    async def shutdown_default_executor(self, *args: Any) -> None:
        """Wait in real time until all threads are gone."""
        self.threads += 1
        try:
            await super().shutdown_default_executor(*args)
        finally:
            self.threads -= 1

    def until(self, condition: Callable[[], object]) -> Awaitable[None]:
        """Return what is done when a condition holds, which is looked at after every turn."""
        future = self.create_future()
        self._waiting.append((condition, future))
        self.call_soon(lambda: None)  # it may hold already
        return future

    @property
    def waits(self) -> bool:
        """Whether somebody waits for a condition."""
        return bool(self._waiting)

    def _thread_done(self, _future: object) -> None:
        self.threads -= 1

    def go_on(self) -> None:
        """Let what hangs have its turn again: what is overdue, in the order in which it was."""
        self.hangs = False
        for handle in self._held:
            if isinstance(handle, asyncio.TimerHandle):
                heapq.heappush(self._scheduled, handle)
            else:
                self._ready.append(handle)
        self._held = []

    def _hold(self) -> None:
        """Take away the turns of what hangs."""
        ready: deque[asyncio.Handle] = self._ready  # type: ignore[has-type]
        scheduled: list[asyncio.TimerHandle] = self._scheduled  # type: ignore[has-type]
        self._held += [each for each in (*ready, *scheduled) if may_hang(each)]
        self._ready = deque(each for each in ready if not may_hang(each))
        self._scheduled = [each for each in scheduled if not may_hang(each)]
        heapq.heapify(self._scheduled)

    def _run_once(self) -> None:
        self.now += TURN
        if self.hangs:
            self._hold()
        super()._run_once()  # type: ignore[misc]
        self._waiting = [entry for entry in self._waiting if not _settled(*entry)]


def may_hang(handle: asyncio.Handle | None) -> bool:
    """Return whether a callback belongs to what a test may let hang."""
    context = getattr(handle, '_context', None)  # asyncio has no other way to it
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
    """Lets the time that would be spent waiting pass on the loop's clock instead."""

    def __init__(self, loop: EventLoop) -> None:
        super().__init__()
        self._loop = loop

    def select(self, timeout: float | None = None) -> list[Any]:
        """Return what is ready."""
        ready = self._readable()
        if ready or timeout == 0:
            return ready
        loop = self._loop
        if loop.threads or timeout is None or not loop.virtual:
            if loop.waits:
                timeout = LOOK if timeout is None else min(timeout, LOOK)
            began = time.monotonic()
            ready = super().select(timeout)
            loop.now += time.monotonic() - began
            return ready
        select.select([self.fileno()], [], [], CONNECT_GRACE if self._connects() else GRACE)
        ready = self._readable()
        if not ready:
            loop.now += timeout
        return ready

    def _readable(self) -> list[Any]:
        """Return what can be read and written now by somebody who does not hang."""
        ready = super().select(0)
        if self._loop.hangs:
            ready = [each for each in ready if not any(map(may_hang, each[0].data))]
        return ready

    def _connects(self) -> bool:
        """Return whether a connection is being made, which the system may take its time for."""
        return any(
            key.events & selectors.EVENT_WRITE and _tcp_state(key.fd) == TCP_SYN_SENT
            for key in self.get_map().values()
        )


def _tcp_state(fd: int) -> int | None:
    """Return the state of a TCP socket as Linux counts them; None where that cannot be asked."""
    if not hasattr(socket, 'TCP_INFO'):
        return None
    asked = socket.socket(fileno=fd)
    try:
        return asked.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, 1)[0]
    except OSError:  # no TCP socket
        return None
    finally:
        asked.detach()


def run(
    coroutine: Coroutine[Any, Any, Any], patience: float = PATIENCE, *, real_time: bool = False
) -> None:
    """Run a test's coroutine; no task of it may be left when it ends."""

    async def timed() -> None:
        async with asyncio.timeout(patience):
            await coroutine
        await asyncio.sleep(0)  # transports that were closed last go now
        left = asyncio.all_tasks() - {asyncio.current_task()}
        assert not left, f'tasks left behind: {left}'

    with asyncio.Runner(loop_factory=partial(EventLoop, real_time=real_time)) as runner:
        runner.run(timed())


async def until(condition: Callable[[], object]) -> None:
    """Wait until a condition holds; `run` limits how long that may take."""
    loop = asyncio.get_running_loop()
    assert isinstance(loop, EventLoop)
    await loop.until(condition)


async def accepted() -> None:
    """Let connections that a server has just accepted be served, before it is closed.

    asyncio would leave their sockets open.
    """
    for _ in range(5):
        await asyncio.sleep(0)


@contextlib.contextmanager
def real_time() -> Iterator[None]:
    """Let time be real meanwhile, as another process works for the loop."""
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
    """Return a context for what is to hang as one: a task in it, and all that it starts."""
    context = copy_context()
    context.run(_MAY_HANG.set, True)
    return context


@contextlib.contextmanager
def hanging() -> Iterator[None]:
    """Let what runs in an `own_process` hang, as a stopped process does; all else goes on.

    What comes for it waits in its sockets; afterwards it reads that, and its timers are late.
    """
    loop = asyncio.get_running_loop()
    assert isinstance(loop, EventLoop)
    loop.hangs = True
    try:
        yield
    finally:
        loop.go_on()


def stand_still(seconds: float) -> None:
    """Hold the loop for so long, s, as a busy machine does: nothing is called meanwhile."""
    loop = asyncio.get_running_loop()
    assert isinstance(loop, EventLoop)
    if loop.virtual:
        loop.now += seconds
    else:
        time.sleep(seconds)
