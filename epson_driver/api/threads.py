# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The threads of a synchronous Robot: the event loop's, and a thread for the user's callbacks."""

import asyncio
import contextlib
import queue
import threading
import weakref
from collections.abc import Callable, Coroutine
from functools import partial
from typing import TYPE_CHECKING, Any, TypeVar

from epson_driver.api.errors import RobotError
from epson_driver.api.ownership import Process, close_soon
from epson_driver.processes.command import raise_priority

if TYPE_CHECKING:  # the driver is loaded with the first Robot
    from epson_driver.api.connection import Connection

MAX_WAITING_CALLBACKS = 1000
"""Maximum number of queued callbacks. A longer queue shows that a callback does not return."""

T = TypeVar('T')


class LoopThread:
    """An event loop in a daemon thread, so that a program can end without calling `close`."""

    def __init__(self, name: str) -> None:
        self._loop = asyncio.new_event_loop()
        self._lock = threading.Lock()
        self._closed = False
        self.process = Process()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        raise_priority()
        asyncio.set_event_loop(self._loop)
        try:
            self._loop.run_forever()
        finally:  # so that all pending requests are completed
            tasks = asyncio.all_tasks(self._loop)
            for task in tasks:
                task.cancel()
            self._loop.run_until_complete(asyncio.gather(*tasks, return_exceptions=True))
            with contextlib.suppress(RuntimeError):  # at interpreter exit: already ended
                self._loop.run_until_complete(self._loop.shutdown_default_executor())
            self._loop.close()

    def run(self, work: Callable[[], Coroutine[Any, Any, T]]) -> T:
        """Run a coroutine in the loop and wait for it.

        Ctrl-C cancels the coroutine and waits until it ends, or until a second Ctrl-C.
        """
        self.process.check()
        if threading.current_thread() is self._thread:
            raise RobotError('the event loop of the robot cannot wait for itself')
        tasks: list[asyncio.Task[T]] = []
        ended = threading.Event()

        async def worked() -> T:
            return await work()  # also raises the error of an invalid call, such as TypeError

        def start() -> None:
            tasks.append(self._loop.create_task(worked()))
            tasks[0].add_done_callback(lambda _: ended.set())

        with self._lock:
            if self._closed:
                raise RobotError('the robot was closed')
            self._loop.call_soon_threadsafe(start)
        try:
            ended.wait()
        except BaseException:
            with contextlib.suppress(RuntimeError):  # the loop is closed, and the task has ended
                self._loop.call_soon_threadsafe(lambda: tasks[0].cancel())
            ended.wait()
            raise
        task = tasks.pop()
        try:
            if task.cancelled():
                raise RobotError('the robot was closed')
            return task.result()
        finally:
            del task  # its error refers to this frame, and the frame keeps the robot alive

    def call(self, function: Callable[[], T]) -> T:

        async def work() -> T:
            return function()

        return self.run(work)

    def leave(self, close: Callable[[], Coroutine[Any, Any, None]]) -> None:
        """Schedule `close`, and then the end of the loop and its thread, without waiting."""

        async def leave() -> None:
            try:
                await close()
            finally:
                self._loop.stop()

        self._closed = True
        close_soon(self._loop, self.process, leave)

    def close(self) -> None:
        with self._lock:
            self._closed = True
            self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()


class CallbackThread:
    """A thread that calls the user's callbacks, which may block and may use the robot.

    `failed` is called in the callback thread with the exception of a callback.
    """

    def __init__(self, name: str, failed: Callable[[Exception], None]) -> None:
        self._name = name
        self._failed = failed
        self._waiting: queue.SimpleQueue[Callable[[], object] | None] = queue.SimpleQueue()
        """Queued callbacks, or None to end the thread.

        `put` of SimpleQueue is reentrant and never blocks, so finalizers may call it.
        """
        self._thread: threading.Thread | None = None

    def wrap(self, callback: Callable[..., object]) -> Callable[..., None]:
        """Return a function that queues the callback, which the callback thread then calls.

        Only the event loop's thread may call the returned function. It raises queue.Full if too
        many callbacks wait.
        """

        def put(*args: object) -> None:
            if self._waiting.qsize() >= MAX_WAITING_CALLBACKS:
                raise queue.Full
            self._waiting.put(partial(callback, *args))
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
        """Run the queued callbacks and end the thread.

        Wait for its end unless a callback calls this.
        """
        self.leave()
        thread, self._thread = self._thread, None
        if thread is not None and thread is not threading.current_thread():
            thread.join()

    def leave(self) -> None:
        if self._thread is not None:
            self._waiting.put(None)


class Session:
    """The event loop of a connected Robot, and its callback thread.

    The threads have no reference to the session. Therefore the arm stops and the threads end once
    the Robot and its objects are garbage-collected.
    """

    def __init__(self, awaited: object, connection: 'Connection') -> None:
        self._awaited = awaited  # garbage-collected together with the session
        self._connection = connection
        self._closing = threading.Lock()
        self._thread: LoopThread | None = None
        self._lost: weakref.finalize[..., Session] | None = None
        self.callbacks = CallbackThread('robot callbacks', connection.callback_failed_elsewhere)

    def open(self, connect: Callable[[], Coroutine[Any, Any, object]]) -> None:
        if self._thread is not None:
            self._thread.process.check()
            raise RobotError('the robot is already connected')
        self._thread = LoopThread('robot')
        self._lost = weakref.finalize(
            self, _leave, self._thread, self._awaited, self._connection, self.callbacks
        )
        self._lost.atexit = False  # api.ownership closes the connection at interpreter exit
        try:
            self.run(connect)
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Close the robot and end the threads. Do nothing if not connected."""
        if self._thread is None or self._thread.process.forked:
            return
        with self._closing:
            self._close_thread()
        self.callbacks.close()  # without the lock: a callback may also call close()

    def _close_thread(self) -> None:
        thread = self._thread
        if thread is None:
            return
        try:
            thread.run(self._connection.close)
        finally:
            self._thread = None
            if self._lost is not None:
                self._lost.detach()
            thread.close()

    def run(self, work: Callable[[], Coroutine[Any, Any, T]]) -> T:
        thread = self._thread
        if thread is None:
            raise RobotError('no connection: call connect(), or use a with block')
        return thread.run(work)

    def call(self, function: Callable[[], T]) -> T:
        thread = self._thread
        return function() if thread is None else thread.call(function)


def _leave(
    thread: LoopThread, _awaited: object, connection: 'Connection', callbacks: CallbackThread
) -> None:
    thread.leave(connection.close_lost)
    callbacks.leave()
