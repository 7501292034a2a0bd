# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""An event loop whose time passes only when nothing is left to do.

Sockets are real, time is not: when every callback has run and nothing more can be read, the loop's
clock jumps to the next timer. What takes ten seconds takes as long as its work does, and a machine
that is busy makes a test slower, but never changes what it sees: no timer is late.

While threads or child processes work for the loop (`run_in_executor`), its time is the real one.
"""

import asyncio
import select
import selectors
import time
from collections.abc import Awaitable, Callable, Coroutine
from typing import Any

PATIENCE = 60.0
"""How long a test may take before it fails, s of the loop's time."""

GRACE = 2e-4
"""How long the loop waits, s of real time, for bytes that are still on their way through the
system before it takes nothing to be left to do: they pass it in the call that sends them, but on
a busy machine another thread of the system may have to finish that."""

TURN = 1e-6
"""What a turn of the loop takes, s of its time: who asks for the rest of a rounding error gets it."""


class VirtualTimeLoop(asyncio.SelectorEventLoop):
    """The loop. Its time begins at 1000 s: nothing may take 0 for 'never'."""

    def __init__(self) -> None:
        self.now = 1000.0
        self.outside = 0
        self._watched: list[tuple[Callable[[], object], asyncio.Future[None]]] = []
        super().__init__(_Selector(self))

    def time(self) -> float:
        """Return the loop's time, s."""
        return self.now

    def run_in_executor(self, executor: Any, func: Any, *args: Any) -> Any:
        """Call a function in a thread or process; until it is done, time is real."""
        future = super().run_in_executor(executor, func, *args)
        self.outside += 1
        future.add_done_callback(self._back)
        return future

    def _back(self, _future: object) -> None:
        self.outside -= 1

    def until(self, condition: Callable[[], object]) -> Awaitable[None]:
        """Wait until a condition holds: it is looked at after every turn of the loop."""
        future = self.create_future()
        self._watched.append((condition, future))
        self.call_soon(lambda: None)  # it may hold already
        return future

    def _run_once(self) -> None:
        self.now += TURN
        super()._run_once()  # type: ignore[misc]
        for entry in self._watched[:]:
            condition, future = entry
            if future.done():
                self._watched.remove(entry)
                continue
            try:
                if condition():
                    self._watched.remove(entry)
                    future.set_result(None)
            except Exception as error:  # noqa: BLE001 - it is the waiting test's
                self._watched.remove(entry)
                future.set_exception(error)


class _Selector(selectors.EpollSelector):
    """Asks the system without waiting; what would be waited for passes on the loop's clock."""

    def __init__(self, loop: VirtualTimeLoop) -> None:
        super().__init__()
        self._loop = loop

    def select(self, timeout: float | None = None) -> list[Any]:
        """Return what is ready."""
        ready = super().select(0)
        if ready or timeout == 0:
            return ready
        if self._loop.outside or timeout is None:
            began = time.monotonic()
            ready = super().select(timeout)
            self._loop.now += time.monotonic() - began
            return ready
        select.select([self.fileno()], [], [], GRACE)
        ready = super().select(0)
        if not ready:
            self._loop.now += timeout
        return ready


def run(coroutine: Coroutine[Any, Any, Any], patience: float = PATIENCE) -> None:
    """Run a test's coroutine in virtual time; no task may be left when it ends."""

    async def timed() -> None:
        async with asyncio.timeout(patience):
            await coroutine
        await asyncio.sleep(0)  # transports that were closed last go now
        left = asyncio.all_tasks() - {asyncio.current_task()}
        assert not left, f'tasks left behind: {left}'

    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        runner.run(timed())


async def until(condition: Callable[[], object]) -> None:
    """Wait until the condition holds; `run` limits how long that may take."""
    loop = asyncio.get_running_loop()
    assert isinstance(loop, VirtualTimeLoop)
    await loop.until(condition)
