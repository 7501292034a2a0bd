# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A witness at the controller's state port: where the arm was, and whether it was stopped.

It is a client of its own beside the driver, so that what it says depends on neither driver nor
program. A fault of the state port is one for it, too: then it connects again.
"""

import contextlib
import socket
import threading
import time

import numpy as np

from epson_driver.motion import Array
from epson_driver.simple_message import (
    Framer,
    JointFeedback,
    JointPosition,
    SimpleMessageError,
    Status,
    TriState,
    decode,
)

RETRY_S = 0.2
READ_TIMEOUT_S = 0.2
MOVED = 0.002
"""A joint that is so far from where it stood has moved, rad or m."""

STANDS_S = 0.2
"""An arm that stays for so long stands."""


class Witness:
    """Listens in a thread until `close`. Times are s on the monotonic clock."""

    def __init__(self, port: int, joints: int) -> None:
        self._port = port
        self._joints = joints
        self._lock = threading.Lock()
        self._times: list[float] = []
        self._positions: list[tuple[float, ...]] = []
        self._stopped: list[tuple[float, bool]] = []
        self._news = threading.Condition(self._lock)
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._listen, name='witness', daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop listening."""
        self._closing.set()
        self._thread.join()

    @property
    def seen(self) -> tuple[Array, Array]:
        """Times, shape (k,), and positions, shape (k, n), rad or m."""
        with self._lock:
            return np.array(self._times), np.array(self._positions).reshape(-1, self._joints)

    @property
    def stopped_at(self) -> float | None:
        """When the controller first said that its E-stop is pressed."""
        with self._lock:
            return next((at for at, stopped in self._stopped if stopped), None)

    def wait_for_state(self, timeout: float) -> bool:
        """Wait for a first joint state; return whether one came."""
        with self._news:
            return bool(self._news.wait_for(lambda: self._times, timeout))

    def wait_for_motion(self, until: float, ended: threading.Event) -> float | None:
        """Wait until the arm has moved since now; return when it did.

        None: it had not at that time, or when `ended` was set.
        """
        with self._news:
            start = self._positions[-1] if self._positions else None
            while time.monotonic() < until and not ended.is_set():
                if self._positions:
                    start = start or self._positions[-1]
                    away = max(abs(a - b) for a, b in zip(self._positions[-1], start, strict=True))
                    if away > MOVED:
                        return self._times[-1]
                self._news.wait(min(0.5, max(until - time.monotonic(), 0.01)))
        return None

    def moved_after_stop(self) -> bool:
        """Return whether the arm stood after the E-stop, and then moved."""
        stopped = self.stopped_at
        if stopped is None:
            return False
        times, positions = self.seen
        after = times > stopped
        times, positions = times[after], positions[after]
        stands = standstill(times, positions)
        if stands is None:
            return False
        return bool(np.any(np.abs(positions[stands:] - positions[stands]).max(axis=1) > MOVED))

    def _listen(self) -> None:
        while not self._closing.is_set():
            with (
                contextlib.suppress(OSError, SimpleMessageError),
                socket.create_connection(('127.0.0.1', self._port), timeout=5.0) as link,
            ):
                link.settimeout(READ_TIMEOUT_S)
                self._read(link)
            self._closing.wait(RETRY_S)

    def _read(self, link: socket.socket) -> None:
        framer = Framer()
        while not self._closing.is_set():
            try:
                data = link.recv(65536)
            except TimeoutError:
                continue
            if not data:
                return
            framer.receive_data(data)
            while (frame := framer.next_frame()) is not None:
                self._take(decode(frame).message)

    def _take(self, message: object) -> None:
        now = time.monotonic()
        with self._news:
            if isinstance(message, JointPosition | JointFeedback):
                joints = positions_of(message)
                self._times.append(now)
                self._positions.append(joints[: self._joints])
                self._news.notify_all()
            elif isinstance(message, Status) and message.e_stopped != TriState.UNKNOWN:
                self._stopped.append((now, message.e_stopped == TriState.TRUE))


def positions_of(message: JointPosition | JointFeedback) -> tuple[float, ...]:
    """Return the ten joint values of a message."""
    return message.joints if isinstance(message, JointPosition) else message.positions


def standstill(times: Array, positions: Array) -> int | None:
    """Return the first index from which the arm stood for STANDS_S; None if it never did."""
    for index in range(len(times)):
        within = (times >= times[index]) & (times <= times[index] + STANDS_S)
        if times[-1] < times[index] + STANDS_S:
            return None
        if np.all(np.abs(positions[within] - positions[index]).max(axis=1) <= MOVED / 10):
            return index
    return None
