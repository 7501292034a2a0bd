# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The thread that runs rclpy's executor, whose end is always reported."""

import threading
from collections.abc import Callable

from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor

MAX_ERRORS = 100
"""So many errors end the thread: an executor that only raises serves nobody."""

LEAVE_TIMEOUT_S = 2.0
"""How long the thread may take to give its last answers, s."""

LAST_ROUNDS = 3
"""Of the executor's tasks before it ends: what a goal waits for comes in the first, that makes its
answer a task of the second; and one to spare."""


class RosThread:
    """Spins an executor until `leave`. `on_error` is called in the thread with what it raised.

    `context`: that of the nodes; None: rclpy's default.

    It goes on then, for as long as it can: what is asked while the arms stop is answered still.

    Not `spin_until_future_complete`: rclpy leaves a callback in the future at every turn.
    """

    def __init__(
        self, on_error: Callable[[str, BaseException], None], context: Context | None = None
    ) -> None:
        self.executor = SingleThreadedExecutor(context=context)
        self._on_error = on_error
        self._left = threading.Event()
        self._thread = threading.Thread(target=self._run, name='rclpy executor', daemon=True)

    def start(self) -> None:
        """Begin to serve."""
        self._thread.start()

    def leave(self) -> bool:
        """Give the answers that are there, and end. Returns whether it has ended in time."""
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
