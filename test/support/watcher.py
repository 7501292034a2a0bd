# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A second state client of the simulated controller, to measure the arm without the driver."""

import socket
import threading
import time
from contextlib import suppress

import numpy as np

from epson_driver.robots import load_robot_model
from epson_driver.simple_message import Framer, JointFeedback, decode
from support.cell import START
from support.ros_peer import PATIENCE

LIMITS = load_robot_model('c3_a601s').limits
ROUNDING = 0.02
"""Effect of float32 and encoder pulses on a velocity difference, rad/s."""

PROFILE = """
like: {kind}
name: measured
description: the same, but it tells two clients its velocities and its own time, and waits for them
state: {{message: joint_feedback, feedback_time: true, period: 0.01}}
server: {{state_clients: 2, client_timeout: 0}}
"""


BUFFER = 4_000_000
"""Size of the receive buffer, bytes: minutes of messages, in case the process is delayed."""

AT_REST = 50
"""Number of consecutive messages without a velocity that mean an arm at rest."""


class Watcher:
    """A state client of the controller that also works without the driver.

    Its thread only reads the bytes, so that the controller never waits for this client.
    `seen` decodes them.
    """

    def __init__(self, port: int) -> None:
        self._seen: list[JointFeedback] = []
        self._framer = Framer()
        self._unread: list[bytes] = []
        self._changed = threading.Condition()
        self._over = False
        self._socket = socket.socket()
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER)  # before it connects
        self._socket.settimeout(PATIENCE)
        self._socket.connect(('127.0.0.1', port))
        self._socket.settimeout(None)
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self) -> None:
        while data := self._receive():
            with self._changed:
                self._unread.append(data)
                self._changed.notify_all()
        with self._changed:
            self._over = True
            self._changed.notify_all()

    def _receive(self) -> bytes:
        try:
            return self._socket.recv(65536)
        except OSError:
            return b''

    @property
    def seen(self) -> list[JointFeedback]:
        """All received messages, the oldest first."""
        with self._changed:
            unread, self._unread = self._unread, []
        for data in unread:
            self._framer.receive_data(data)
        while (frame := self._framer.next_frame()) is not None:
            message = decode(frame).message
            if isinstance(message, JointFeedback):
                self._seen.append(message)
        return self._seen

    def until_at_rest(self) -> None:
        """Wait until AT_REST new consecutive messages show no motion."""
        start = len(self.seen)
        end = time.monotonic() + PATIENCE
        while True:
            newest = self.seen[max(start, len(self._seen) - AT_REST) :]
            if len(newest) == AT_REST and not any(any(item.velocities) for item in newest):
                return
            assert time.monotonic() < end, 'it moves'
            with self._changed:
                assert self._unread or not self._over, 'the controller closed the connection'
                self._changed.wait_for(lambda: self._unread or self._over, PATIENCE)

    def close(self) -> None:
        with suppress(OSError):  # the controller may have closed it
            self._socket.shutdown(socket.SHUT_RDWR)
        self._thread.join(PATIENCE)
        self._socket.close()

    def changes(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return steps of time (s), velocities and their changes, one row per message."""
        seen = self.seen
        times = np.array([item.time for item in seen])
        velocities = np.array([item.velocities[: len(START)] for item in seen])
        return np.diff(times), velocities, np.diff(velocities, axis=0)

    def assert_within_limits(self) -> None:
        """Check all received velocities and their changes."""
        steps, velocities, changes = self.changes()
        assert np.all(np.abs(velocities) <= np.array(LIMITS.velocity) * 1.01)
        allowed = np.array(LIMITS.acceleration) * steps[:, None] + ROUNDING
        assert np.all(np.abs(changes) <= allowed), np.abs(changes / allowed).max(axis=0)
