# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""An event loop without sockets, threads or real time: all that happens is decided by its order.

Timers go off one by one, in the order (time, number), and time jumps to the next when nothing is
left to do. All that follows at once from one of them happens before the next one: through how many
callbacks a Python passes on what has happened changes nothing that can be seen. Everything that a
process starts carries its name in its context, so that a process can hang, or die, between two
callbacks.
"""

import asyncio
import heapq
from collections import Counter, deque
from collections.abc import Callable
from contextvars import Context, copy_context
from dataclasses import dataclass
from itertools import count
from typing import Any

from simulation.network import PROCESS, Listener, Network, Socket

START_S = 1000.0
"""The loop's time in the beginning, s: 0 must not happen to mean 'never'."""

SOON_S = 1e-6
"""How far ahead a timer is at least, s: one that rounding left over is not due for ever."""

MAX_CALLS = 1_000_000
"""More callbacks than this at one time are a task that spins."""


class NothingLeftError(RuntimeError):
    """Nothing can happen any more, but somebody waits; or one thing happens for ever."""


class Call:
    """A callback that is to come. It has what asyncio asks of handles, and no more."""

    __slots__ = ('_when', 'args', 'callback', 'context', 'gone')

    def __init__(
        self, callback: Callable[..., Any], args: tuple[Any, ...], context: Context | None
    ) -> None:
        self.callback, self.args = callback, args
        self.context = copy_context() if context is None else context
        self.gone = False
        self._when: float | None = None

    def at(self, when: float) -> 'Call':
        """Have it come at a time, s."""
        self._when = when
        return self

    def when(self) -> float | None:
        """Return when it comes, loop time, s; None: at once."""
        return self._when

    def cancel(self) -> None:
        """Let it not come."""
        self.gone = True

    def cancelled(self) -> bool:
        """Return whether it will not come."""
        return self.gone


@dataclass(frozen=True, slots=True)
class Drift:
    """The clock of a process: since when it goes at a rate, and what it showed then, s."""

    process: str
    rate: float
    since: float
    shown: float

    def shows(self, now: float) -> float:
        """Return what it shows at a true time, s."""
        return self.shown + (now - self.since) * self.rate

    def true(self, shown: float) -> float:
        """Return at which true time it shows something, s."""
        return self.since + (shown - self.shown) / self.rate


class VirtualLoop(asyncio.BaseEventLoop):
    """Runs callbacks in virtual time, over a network in memory."""

    _ready: deque[Call]
    _scheduled: list[tuple[float, int, Call]]

    get_debug = bool  # False, and asked for at every turn of a task

    def __init__(self, network: Network, thread_s: float = 0.0) -> None:
        super().__init__()
        self.now = START_S
        self.thread_s = thread_s
        """How long what is done in a thread takes, s."""
        self.network = network
        self._drift: Drift | None = None
        self.hanging: set[str] = set()
        self.dead: set[str] = set()
        self._held: list[Call] = []
        self._buried: list[Call] = []
        """What dead processes would have called: what it refers to lives until the end."""
        self._numbers = count()

    def time(self) -> float:
        """Return the virtual time, s, by the clock of who asks."""
        drift = self._drift
        if drift is None or PROCESS.get() != drift.process:
            return self.now
        return drift.shows(self.now)

    def true_time(self) -> float:
        """Return the virtual time, s, whoever asks."""
        return self.now

    def drift(self, process: str, rate: float) -> None:
        """Let the clock of a process, one in a world, go on at a rate: 1 for the true one."""
        shown = self.now if self._drift is None else self._drift.shows(self.now)
        self._drift = Drift(process, rate, self.now, shown)

    def _write_to_self(self) -> None:
        """No other thread calls."""

    def _run_once(self) -> None:
        """Let one timer after the other go off, and what follows from it, until the loop stops."""
        ready, scheduled, calls = self._ready, self._scheduled, 0
        while True:
            while ready:
                call = ready.popleft()
                calls += 1
                if not call.gone:
                    try:
                        call.context.run(call.callback, *call.args)
                    except Exception as error:  # noqa: BLE001 - handled as asyncio does
                        name = f'Exception in callback {call.callback}'
                        self.call_exception_handler({'message': name, 'exception': error})
                    if calls > MAX_CALLS:
                        raise NothingLeftError(f'{call.callback} comes for ever')
            if self._stopping:  # type: ignore[attr-defined]
                return
            if not scheduled:
                raise NothingLeftError('nothing is left to happen, but somebody waits')
            when, _, call = heapq.heappop(scheduled)
            if not call.gone:
                self.now, calls = max(self.now, when), 0
                ready.append(call)

    # --- processes -----------------------------------------------------------------------------

    def hang(self, process: str) -> None:
        """Call nothing of a process from the next turn on until it goes on."""
        self.hanging.add(process)
        self._take_away()

    def go_on(self, process: str) -> None:
        """Call what is overdue of a process, in its order."""
        self.hanging.discard(process)
        held, self._held = self._held, []
        for call in held:
            self._add(call)

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
        while left := sorted(asyncio.all_tasks(self), key=_number):
            for task in left:
                task.cancel()
            ending = asyncio.gather(*left, return_exceptions=True)
            self.run_until_complete(ending)
        self.close()

    def _take_away(self) -> None:
        """Take away what hanging and dead processes would call."""
        calls = [*self._ready, *(entry[2] for entry in sorted(self._scheduled))]
        self._ready.clear()
        self._scheduled.clear()
        held, self._held = self._held, []
        for call in (*held, *calls):
            self._add(call)

    def _add(self, call: Call) -> None:
        """Take a callback, for its process."""
        if self.hanging or self.dead:
            process = call.context.get(PROCESS, '')
            if process in self.hanging:
                self._held.append(call)
                return
            if process in self.dead:
                self._buried.append(call)
                return
        when = call.when()
        if when is None:
            self._ready.append(call)
        else:
            heapq.heappush(self._scheduled, (when, next(self._numbers), call))

    def left(self) -> Counter[str]:
        """Return how many tasks and timers each process has that is not dead."""
        found = Counter(_process(task) for task in asyncio.all_tasks(self))
        found.update(
            call.context.get(PROCESS, '') for _, _, call in self._scheduled if not call.gone
        )
        return found

    # --- what asyncio asks of a loop -----------------------------------------------------------

    def create_task(self, coro: Any, *, name: object = None, **given: Any) -> Any:
        """Begin a task, with its process and its number as its name."""
        number = next(self._numbers)
        return super().create_task(coro, name=f'{PROCESS.get("")}#{number}', **given)

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
    ) -> Call:
        """Call now, after all that was asked for before."""
        call = Call(callback, args, context)
        self._add(call)
        return call

    call_soon_threadsafe = call_soon  # type: ignore[assignment]  # there is one thread

    def call_at(  # type: ignore[override]
        self, when: float, callback: Callable[..., Any], *args: Any, context: Context | None = None
    ) -> Call:
        """Call at a time, s; of several at the same time first what was asked for first."""
        drift = self._drift
        if drift is not None and PROCESS.get() == drift.process:
            when = drift.true(when)
        call = Call(callback, args, context).at(max(when, self.now + SOON_S))
        self._add(call)
        return call

    def call_later(  # type: ignore[override]
        self,
        delay: float,
        callback: Callable[..., Any],
        *args: Any,
        context: Context | None = None,
    ) -> Call:
        """Call after a time, s."""
        return self.call_at(self.time() + delay, callback, *args, context=context)

    async def shutdown_default_executor(self, *_: Any) -> None:
        """There is none."""


def _number(task: asyncio.Task[Any]) -> int:
    """Return the how-manieth a task is: a set of tasks has another order in another Python."""
    return int(task.get_name().rpartition('#')[2])


def _process(task: asyncio.Task[Any]) -> str:
    return task.get_name().rpartition('#')[0]
