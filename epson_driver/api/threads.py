# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Two threads for a synchronous Robot: one with the event loop, one for the user's callbacks."""

import asyncio
import contextlib
import queue
import threading
from collections.abc import Callable, Coroutine
from functools import partial
from typing import Any, TypeVar

from epson_driver.api.errors import RobotError

MAX_WAITING_CALLBACKS = 1000
"""Callbacks that wait for their turn; more than that is a callback that does not return."""

T = TypeVar('T')


class LoopThread:
    """An event loop in a thread of its own, for callers in other threads.

    It is a daemon: a program that forgets `close` can end all the same. The controller stops the
    arm then by itself, as its connection is gone.
    """

    def __init__(self, name: str) -> None:
        self._loop = asyncio.new_event_loop()
        self._lock = threading.Lock()
        self._closed = False
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        try:
            self._loop.run_forever()
        finally:  # who still waits for something has an answer
            tasks = asyncio.all_tasks(self._loop)
            for task in tasks:
                task.cancel()
            self._loop.run_until_complete(asyncio.gather(*tasks, return_exceptions=True))
            self._loop.run_until_complete(self._loop.shutdown_default_executor())
            self._loop.close()

    def run(self, work: Callable[[], Coroutine[Any, Any, T]], timeout: float | None = None) -> T:
        """Run a coroutine in the loop and wait for it, at most `timeout` s (TimeoutError).

        Ctrl-C and the time-out cancel the coroutine and wait for its end, until a second Ctrl-C.
        Raises RobotError if the thread was closed, what the coroutine raises otherwise.
        """
        if threading.current_thread() is self._thread:
            raise RobotError('the event loop of the robot cannot wait for itself')
        tasks: list[asyncio.Task[T]] = []
        ended = threading.Event()

        def begin() -> None:
            tasks.append(self._loop.create_task(work()))
            tasks[0].add_done_callback(lambda _: ended.set())

        with self._lock:
            if self._closed:
                raise RobotError('the robot was closed')
            self._loop.call_soon_threadsafe(begin)
        try:
            if not ended.wait(timeout):
                raise TimeoutError(f'it has not ended within {timeout:g} s')
        except BaseException:
            with contextlib.suppress(RuntimeError):  # the loop is closed, and the task has ended
                self._loop.call_soon_threadsafe(lambda: tasks[0].cancel())
            ended.wait()
            raise
        if tasks[0].cancelled():
            raise RobotError('the robot was closed meanwhile')
        return tasks[0].result()

    def call(self, function: Callable[[], T]) -> T:
        """Call a function in the loop; return what it returns."""

        async def work() -> T:
            return function()

        return self.run(work)

    def close(self) -> None:
        """End the loop and its thread."""
        with self._lock:
            self._closed = True
            self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()


class CallbackThread:
    """Calls the user's callbacks one after the other: they may take their time, and use the robot.

    `failed` is called, in this thread, with what one raised. The thread starts with the first.
    """

    def __init__(self, name: str, failed: Callable[[Exception], None]) -> None:
        self._name = name
        self._failed = failed
        self._waiting: queue.Queue[Callable[[], object] | None] = queue.Queue(
            MAX_WAITING_CALLBACKS
        )
        self._thread: threading.Thread | None = None

    def wrap(self, callback: Callable[..., object]) -> Callable[..., None]:
        """Return a function that has the callback called in this thread, and returns at once.

        It is for one thread, that of the event loop. Raises queue.Full if callbacks pile up.
        """
        if not callable(callback):
            raise TypeError(f'{callback!r} cannot be called')

        def put(*args: object) -> None:
            self._waiting.put_nowait(partial(callback, *args))
            if self._thread is None:
                self._thread = threading.Thread(target=self._run, name=self._name, daemon=True)
                self._thread.start()

        return put

    def _run(self) -> None:
        while (callback := self._waiting.get()) is not None:
            try:
                callback()
            except Exception as error:  # noqa: BLE001 - it is reported, and stops the arm
                self._failed(error)

    def close(self) -> None:
        """End the thread when the callbacks that wait have run; not from a callback itself."""
        thread, self._thread = self._thread, None
        if thread is None:
            return
        self._waiting.put(None)
        if thread is not threading.current_thread():
            thread.join()
