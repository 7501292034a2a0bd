# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A deterministic event loop without sockets, threads or real time.

Timers fire one by one, in the order (time, number), and time jumps to the next timer when no
callback is ready. All consequences of one timer happen before the next one. So the number of
callbacks through which a Python version passes an event on has no visible effect. All callbacks of
a process carry its name in their context, so that a process can hang or die between two callbacks.
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
"""Initial time of the loop, s. It is not 0, so that a time of 0 always means 'never'."""

SOON_S = 1e-6
"""Minimum delay of a timer, s. Without it, rounding could leave a timer due forever."""

MAX_CALLS = 1_000_000
"""Maximum number of callbacks at one time. More indicate a task that spins."""


class NothingLeftError(RuntimeError):
    """No event is left while a task is waiting, or one callback repeats forever."""


class Call:
    """A scheduled callback, with only the attributes that asyncio needs of handles."""

    __slots__ = ('_when', 'args', 'callback', 'context', 'gone')

    def __init__(
        self, callback: Callable[..., Any], args: tuple[Any, ...], context: Context | None
    ) -> None:
        self.callback, self.args = callback, args
        self.context = copy_context() if context is None else context
        self.gone = False
        self._when: float | None = None

    def at(self, when: float) -> 'Call':
        self._when = when
        return self

    def when(self) -> float | None:
        """Return the time of the callback, loop time, s. None: immediately."""
        return self._when

    def cancel(self) -> None:
        self.gone = True

    def cancelled(self) -> bool:
        return self.gone


@dataclass(frozen=True, slots=True)
class Drift:
    """The clock of a process: its rate, the start of this rate, and its value at that time, s."""

    process: str
    rate: float
    since: float
    shown: float

    def shows(self, now: float) -> float:
        """Return the value of the clock at a true time, s."""
        return self.shown + (now - self.since) * self.rate

    def true(self, shown: float) -> float:
        """Return the true time at which the clock shows a value, s."""
        return self.since + (shown - self.shown) / self.rate


class VirtualLoop(asyncio.BaseEventLoop):
    """Runs callbacks in virtual time, over a network in memory."""

    _ready: deque[Call]
    _scheduled: list[tuple[float, int, Call]]

    get_debug = bool  # False, and called at every turn of a task

    def __init__(self, network: Network, thread_s: float = 0.0) -> None:
        super().__init__()
        self.now = START_S
        self.thread_s = thread_s
        """Duration of work in a thread, s."""
        self.network = network
        self._drift: Drift | None = None
        self.hanging: set[str] = set()
        self.dead: set[str] = set()
        self._held: list[Call] = []
        self._buried: list[Call] = []
        """Callbacks of dead processes. The objects they refer to live until the end."""
        self._numbers = count()

    def time(self) -> float:
        """Return the virtual time, s, by the clock of the calling process."""
        drift = self._drift
        if drift is None or PROCESS.get() != drift.process:
            return self.now
        return drift.shows(self.now)

    def true_time(self) -> float:
        return self.now

    def drift(self, process: str, rate: float) -> None:
        """Run the clock of one process of a world at a rate (1: true time)."""
        shown = self.now if self._drift is None else self._drift.shows(self.now)
        self._drift = Drift(process, rate, self.now, shown)

    def _write_to_self(self) -> None:
        """Do nothing, because no other thread calls."""

    def _run_once(self) -> None:
        """Run one timer after the other, and its consequences, until the loop stops."""
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
                        raise NothingLeftError(f'{call.callback} repeats forever')
            if self._stopping:  # type: ignore[attr-defined]
                return
            if not scheduled:
                raise NothingLeftError('no event is left, but a task is waiting')
            when, _, call = heapq.heappop(scheduled)
            if not call.gone:
                self.now, calls = max(self.now, when), 0
                ready.append(call)

    # --- processes -----------------------------------------------------------------------------

    def hang(self, process: str) -> None:
        """Suspend all callbacks of a process from the next turn on."""
        self.hanging.add(process)
        self._take_away()

    def go_on(self, process: str) -> None:
        self.hanging.discard(process)
        held, self._held = self._held, []
        for call in held:
            self._add(call)

    def kill(self, process: str) -> None:
        """Never run a callback of a process again. The system closes its connections."""
        self.hanging.discard(process)
        self.dead.add(process)
        self._take_away()
        self.network.process_died(process)

    def bury(self) -> None:
        """End all remaining tasks, also of dead processes, and close the loop."""
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
        calls = [*self._ready, *(entry[2] for entry in sorted(self._scheduled))]
        self._ready.clear()
        self._scheduled.clear()
        held, self._held = self._held, []
        for call in (*held, *calls):
            self._add(call)

    def _add(self, call: Call) -> None:
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
        """Return the number of tasks and timers of each process that is not dead."""
        result = Counter(_process(task) for task in asyncio.all_tasks(self))
        result.update(
            call.context.get(PROCESS, '') for _, _, call in self._scheduled if not call.gone
        )
        return result

    # --- asyncio's interface of a loop ---------------------------------------------------------

    def create_task(self, coro: Any, *, name: object = None, **given: Any) -> Any:
        """Start a task, named after its process and number."""
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
        if sock is None:
            sock = await self.network.connect(host, port)
        protocol = protocol_factory()
        return sock.attach(protocol, self), protocol

    def add_reader(self, fd: Listener, callback: Callable[..., Any], *args: Any) -> None:  # type: ignore[override]
        fd.watch(self, callback, args)

    def remove_reader(self, fd: Listener) -> None:  # type: ignore[override]
        fd.forget()

    def run_in_executor(self, executor: Any, func: Callable[..., Any], *args: Any) -> Any:  # type: ignore[override]
        """Call a function immediately. Its result is available after `thread_s`."""
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
        call = Call(callback, args, context)
        self._add(call)
        return call

    call_soon_threadsafe = call_soon  # type: ignore[assignment]  # there is one thread

    def call_at(  # type: ignore[override]
        self, when: float, callback: Callable[..., Any], *args: Any, context: Context | None = None
    ) -> Call:
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
        return self.call_at(self.time() + delay, callback, *args, context=context)

    async def shutdown_default_executor(self, *_: Any) -> None: ...


def _number(task: asyncio.Task[Any]) -> int:
    """Return a task's number. The order of a set of tasks depends on the Python version."""
    return int(task.get_name().rpartition('#')[2])


def _process(task: asyncio.Task[Any]) -> str:
    return task.get_name().rpartition('#')[0]
