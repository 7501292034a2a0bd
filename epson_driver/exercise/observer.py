# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""An observer at the controller's remote port: the arm's position and the E-stop.

It queries the controller like a person at the pendant. So its observations depend on neither
driver nor program, it occupies no place at a state port that serves one client, and faults of the
messages do not affect it. When the controller reboots, it logs in again.
"""

import asyncio
import contextlib
import threading
import time

import numpy as np

from epson_driver.motion import Array
from epson_driver.remote_ethernet.client import Ask, RemoteError, logged_in
from epson_driver.robots import RobotModel

HOST = '127.0.0.1'
PERIOD_S = 0.02
"""Polling period of the simulated controller, s. Its remote port sends nothing unrequested."""

RETRY_S = 0.2
SESSION_S = 86_400.0
ESTOP_FLAG = 6
"""Position of the E-stop flag in the answer to GetStatus."""

MOVED = 0.002
"""Minimum displacement of a joint that counts as motion, rad or m."""

STANDS_S = 0.2
"""Time without motion after which the arm counts as at rest, s."""


class Observer:
    """Polls the controller in a thread until `close`. Times are s on the monotonic clock."""

    def __init__(self, port: int, model: RobotModel, password: str = '') -> None:
        self._port = port
        self._password = password
        self._joints = len(model.joint_names)
        self._units = [float(each) for each in model.shown_per_unit]
        self._lock = threading.Lock()
        self._times: list[float] = []
        self._positions: list[tuple[float, ...]] = []
        self._stopped: list[tuple[float, bool]] = []
        self._news = threading.Condition(self._lock)
        self._closing = False
        self._thread = threading.Thread(
            target=lambda: asyncio.run(self._look_on()), name='observer', daemon=True
        )
        self._thread.start()

    def close(self) -> None:
        """Stop the thread."""
        self._closing = True
        self._thread.join()

    @property
    def seen(self) -> tuple[Array, Array]:
        """Times, shape (k,), and positions, shape (k, n), rad or m."""
        with self._lock:
            return np.array(self._times), np.array(self._positions).reshape(-1, self._joints)

    @property
    def stopped_at(self) -> float | None:
        """The time of the first report of a pressed E-stop, or None."""
        with self._lock:
            return next((at for at, stopped in self._stopped if stopped), None)

    def wait_for_state(self, timeout: float) -> bool:
        """Wait for the first report and return whether it arrived in time."""
        with self._news:
            return bool(self._news.wait_for(lambda: self._times, timeout))

    def wait_for_motion(self, until: float, ended: threading.Event) -> float | None:
        """Wait until the arm moves and return the time of the motion.

        Returns None if it has not moved by `until`, or when `ended` is set.
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
        """Return whether the arm came to rest after the E-stop, and then moved."""
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

    async def _look_on(self) -> None:
        while not self._closing:
            with contextlib.suppress(RemoteError, ConnectionError, TimeoutError):
                async with logged_in(HOST, self._port, SESSION_S, self._password) as ask:
                    while not self._closing:
                        await self._look(ask)
                        await asyncio.sleep(PERIOD_S)
            if not self._closing:
                await asyncio.sleep(RETRY_S)

    async def _look(self, ask: Ask) -> None:
        shown = (await ask('Sim,joints')).split()
        joints = tuple(float(value) / unit for value, unit in zip(shown, self._units, strict=True))
        stopped = (await ask('GetStatus'))[ESTOP_FLAG : ESTOP_FLAG + 1] == '1'
        now = time.monotonic()
        with self._news:
            self._times.append(now)
            self._positions.append(joints)
            self._stopped.append((now, stopped))
            self._news.notify_all()


def standstill(times: Array, positions: Array) -> int | None:
    """Return the first index after which the arm was at rest for STANDS_S, or None."""
    for index in range(len(times)):
        within = (times >= times[index]) & (times <= times[index] + STANDS_S)
        if times[-1] < times[index] + STANDS_S:
            return None
        if np.all(np.abs(positions[within] - positions[index]).max(axis=1) <= MOVED / 10):
            return index
    return None
