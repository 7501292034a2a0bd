# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A thread in which a ROS executor serves its nodes until it is ended."""

import threading

from rclpy.executors import Executor

END_TIMEOUT_S = 120.0


class SpinThread:
    """Thread that spins an executor.

    `Executor.spin` does not end reliably when another thread calls `shutdown`. If `shutdown`
    destroys the guard condition between the check for a shutdown and the wait, the wait lasts
    forever. A pending task wakes up the executor in any case.
    """

    def __init__(self, executor: Executor) -> None:
        self._executor = executor
        self._ending = False
        self._thread = threading.Thread(target=self._spin, daemon=True)

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def end(self) -> None:
        """End the thread, and shut down the executor. Its nodes may be destroyed afterwards."""
        self._ending = True
        self._executor.create_task(lambda: None)
        self._thread.join(END_TIMEOUT_S)
        assert not self._thread.is_alive(), 'a callback does not end'
        self._executor.shutdown()

    def _spin(self) -> None:
        while not self._ending:
            self._executor.spin_once()
