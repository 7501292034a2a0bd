# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""An event loop without sockets, threads or real time: all that happens is decided by its order.

Time jumps to the next timer when nothing is left to do. Everything that a process starts carries
its name in its context, so that a process can hang, or die, between two callbacks.
"""

import asyncio
import heapq
from collections import deque
from collections.abc import Callable
from contextvars import Context
from itertools import count
from typing import Any

from simulation.network import PROCESS, Listener, Network, Socket

START_S = 1000.0
"""The loop's time in the beginning, s: 0 must not happen to mean 'never'."""

TURN_S = 1e-6
"""What a turn of the loop takes, s: a timer that rounding left over is not due for ever."""


RESOLUTION_S = 1e-9
"""A timer that is due so soon is due."""


class NothingLeftError(RuntimeError):
    """Nothing can happen any more, but somebody waits."""


class VirtualLoop(asyncio.BaseEventLoop):
    """Runs callbacks in virtual time, over a network in memory."""

    _ready: 'deque[asyncio.Handle]'
    _scheduled: list[tuple[float, int, asyncio.TimerHandle]]

    def __init__(self, network: Network, thread_s: float = 0.0) -> None:
        super().__init__()
        self.now = START_S
        self.thread_s = thread_s
        """How long what is done in a thread takes, s."""
        self.network = network
        self.hanging: set[str] = set()
        self.dead: set[str] = set()
        self._held: list[asyncio.Handle] = []
        self._buried: list[asyncio.Handle] = []
        """What dead processes would have called: what it refers to lives until the end."""
        self._numbers = count()

    def time(self) -> float:
        """Return the virtual time, s."""
        return self.now

    def _write_to_self(self) -> None:
        """No other thread calls."""

    def _run_once(self) -> None:
        """Call what is ready; if nothing is, let the time pass until the next timer."""
        self.now += TURN_S
        ready, scheduled = self._ready, self._scheduled
        while scheduled and scheduled[0][2].cancelled():
            heapq.heappop(scheduled)
        if not ready and not self._stopping:  # type: ignore[attr-defined]
            if not scheduled:
                raise NothingLeftError('nothing is left to happen, but somebody waits')
            self.now = max(self.now, scheduled[0][0])
        while scheduled and scheduled[0][0] < self.now + RESOLUTION_S:
            ready.append(heapq.heappop(scheduled)[2])
        turn = list(ready)
        ready.clear()
        for handle in turn:
            if not handle.cancelled():
                handle._run()  # noqa: SLF001 - as asyncio's loops do

    # --- processes -----------------------------------------------------------------------------

    def hang(self, process: str) -> None:
        """Call nothing of a process from the next turn on until it goes on."""
        self.hanging.add(process)
        self._take_away()

    def go_on(self, process: str) -> None:
        """Call what is overdue of a process, in its order."""
        self.hanging.discard(process)
        held, self._held = self._held, []
        for handle in held:
            self._add(handle)

    def kill(self, process: str) -> None:
        """Never call anything of a process again; its connections are closed by the system."""
        self.hanging.discard(process)
        self.dead.add(process)
        self._take_away()
        self.network.process_died(process)

    def bury(self) -> None:
        """End all tasks that are left, those of dead processes too, and close the loop."""
        self.set_exception_handler(lambda *_: None)
        self.network.listeners.clear()
        self.dead.clear()
        self.hanging.clear()
        self._held += self._buried
        self.go_on('')
        while left := asyncio.all_tasks(self):
            for task in left:
                task.cancel()
            ending = asyncio.gather(*left, return_exceptions=True)
            self.run_until_complete(ending)
        self.close()

    def _take_away(self) -> None:
        """Take away what hanging and dead processes would call."""
        handles = [*self._ready, *(entry[2] for entry in sorted(self._scheduled))]
        self._ready.clear()
        self._scheduled.clear()
        held, self._held = self._held, []
        for handle in (*held, *handles):
            self._add(handle)

    def _add(self, handle: asyncio.Handle) -> None:
        """Take a callback, for its process."""
        if self.hanging or self.dead:
            process = process_of(handle)
            if process in self.hanging:
                self._held.append(handle)
                return
            if process in self.dead:
                self._buried.append(handle)
                return
        if isinstance(handle, asyncio.TimerHandle):
            heapq.heappush(self._scheduled, (handle.when(), next(self._numbers), handle))
        else:
            self._ready.append(handle)

    # --- what asyncio asks of a loop -----------------------------------------------------------

    async def create_connection(  # type: ignore[override]
        self,
        protocol_factory: Callable[[], Any],
        host: str = '',
        port: int = 0,
        *,
        sock: Socket | None = None,
        **_: Any,
    ) -> tuple[Any, Any]:
        """Connect to a listening port of the network, or serve an accepted connection."""
        if sock is None:
            sock = await self.network.connect(host, port)
        protocol = protocol_factory()
        return sock.attach(protocol, self), protocol

    def add_reader(self, fd: Listener, callback: Callable[..., Any], *args: Any) -> None:  # type: ignore[override]
        """Call when somebody wants to connect to a listening port."""
        fd.watch(self, callback, args)

    def remove_reader(self, fd: Listener) -> None:  # type: ignore[override]
        """Call no more."""
        fd.forget()

    def run_in_executor(self, executor: Any, func: Callable[..., Any], *args: Any) -> Any:  # type: ignore[override]
        """Call a function at once; its result is there after `thread_s`."""
        future = self.create_future()
        try:
            end, result = future.set_result, func(*args)
        except Exception as error:  # noqa: BLE001 - raised where it is awaited
            end, result = future.set_exception, error
        self.call_later(self.thread_s, lambda: future.done() or end(result))
        return future

    def call_soon(  # type: ignore[override]
        self, callback: Callable[..., Any], *args: Any, context: Context | None = None
    ) -> asyncio.Handle:
        """Call in the next turn."""
        handle = asyncio.Handle(callback, args, self, context)
        self._add(handle)
        return handle

    def call_at(  # type: ignore[override]
        self, when: float, callback: Callable[..., Any], *args: Any, context: Context | None = None
    ) -> asyncio.TimerHandle:
        """Call at a time, s; of several at the same time first what was asked for first."""
        handle = asyncio.TimerHandle(when, callback, args, self, context)
        self._add(handle)
        return handle

    def call_soon_threadsafe(  # type: ignore[override]
        self, callback: Callable[..., Any], *args: Any, context: Context | None = None
    ) -> asyncio.Handle:
        """There is one thread."""
        return self.call_soon(callback, *args, context=context)

    async def shutdown_default_executor(self, *_: Any) -> None:
        """There is none."""


def process_of(handle: asyncio.Handle) -> str:
    """Return the name of the process that a callback belongs to."""
    context: Context | None = handle._context  # type: ignore[attr-defined]  # noqa: SLF001
    return '' if context is None else context.get(PROCESS, '')
