# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The thread that runs rclpy's executor. Its end is always reported."""

import threading
from collections.abc import Callable

from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor

MAX_ERRORS = 100
"""Number of executor errors after which the thread ends."""

LEAVE_TIMEOUT_S = 2.0
"""Timeout for sending the last replies, s."""

LAST_ROUNDS = 3
"""Executor rounds before the end: one for the future of a goal, a second for the task that sends
its reply, and a spare one."""


class RosThread:
    """Spins an executor until `leave`. `on_error` is called in the thread with each exception.

    `context`: the nodes' context, or None for rclpy's default.

    After an error it continues if possible, to answer requests while the arms stop.

    It does not use `spin_until_future_complete`, because rclpy adds a callback to the future at
    every turn.
    """

    def __init__(
        self, on_error: Callable[[str, BaseException], None], context: Context | None = None
    ) -> None:
        self.executor = SingleThreadedExecutor(context=context)
        self._on_error = on_error
        self._left = threading.Event()
        self._thread = threading.Thread(target=self._run, name='rclpy executor', daemon=True)

    def start(self) -> None:
        """Start to serve."""
        self._thread.start()

    def leave(self) -> bool:
        """Send the pending replies, and end. Returns whether the thread has ended in time."""
        if not self._thread.is_alive():
            self._left.set()
            return True
        self.executor.create_task(self._leave, LAST_ROUNDS)
        self._thread.join(LEAVE_TIMEOUT_S)
        return not self._thread.is_alive()

    def _leave(self, rounds: int) -> None:
        if rounds:
            self.executor.create_task(self._leave, rounds - 1)
        else:
            self._left.set()

    def _run(self) -> None:
        errors = 0
        try:
            while not self._left.is_set():
                try:
                    self.executor.spin_once()
                except BaseException as error:  # noqa: BLE001 - SystemExit, too
                    self._on_error('serving ROS failed', error)
                    errors += 1
                    if errors >= MAX_ERRORS or not self.executor.context.ok():
                        return
        finally:
            if not self._left.is_set():
                end = RuntimeError('no request of ROS is answered any more')
                self._on_error('the thread that serves ROS ended', end)
