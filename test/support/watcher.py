# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A second state client of the simulated controller: what the arm does without the driver."""

import socket
import threading

import numpy as np

from epson_driver.robots import load_robot_model
from epson_driver.simple_message import Framer, JointFeedback, decode
from support.cell import START
from support.ros_peer import PATIENCE

LIMITS = load_robot_model('c3_a601s').limits
ROUNDING = 0.02
"""What float32 and encoder pulses add to a velocity's difference in a step, rad/s."""

PROFILE = """
like: {kind}
name: measured
description: the same, but it tells two clients its velocities, often and with its own time
state: {{message: joint_feedback, period: 0.005}}
server: {{state_clients: 2}}
"""


class Watcher:
    """Another state client of the controller: it sees the arm also when the driver is gone."""

    def __init__(self, port: int) -> None:
        self.seen: list[JointFeedback] = []
        self._changed = threading.Condition()
        self._over = False
        self._socket = socket.create_connection(('127.0.0.1', port), PATIENCE)
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self) -> None:
        framer = Framer()
        while data := self._receive():
            framer.receive_data(data)
            while (frame := framer.next_frame()) is not None:
                message = decode(frame).message
                if isinstance(message, JointFeedback):
                    with self._changed:
                        self.seen.append(message)
                        self._changed.notify_all()
        with self._changed:
            self._over = True
            self._changed.notify_all()

    def _receive(self) -> bytes:
        try:
            return self._socket.recv(65536)
        except OSError:
            return b''

    def until_at_rest(self) -> None:
        """Wait until a hundred messages in a row show no motion."""
        with self._changed:
            begin = len(self.seen)

            def rests() -> bool:
                newest = self.seen[begin:][-100:]
                return len(newest) == 100 and not any(any(each.velocities) for each in newest)

            assert self._changed.wait_for(lambda: self._over or rests(), PATIENCE), 'it moves'
            assert not self._over, 'the controller closed the connection'

    def close(self) -> None:
        self._socket.shutdown(socket.SHUT_RDWR)
        self._socket.close()
        self._thread.join(PATIENCE)

    def changes(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return steps of time (s), velocities and their changes, one row per message."""
        seen = list(self.seen)  # more may come meanwhile
        times = np.array([each.time for each in seen])
        velocities = np.array([each.velocities[: len(START)] for each in seen])
        return np.diff(times), velocities, np.diff(velocities, axis=0)

    def assert_within_limits(self) -> None:
        """Check all velocities that were seen, and how they changed."""
        steps, velocities, changes = self.changes()
        assert np.all(np.abs(velocities) <= np.array(LIMITS.velocity) * 1.01)
        allowed = np.array(LIMITS.acceleration) * steps[:, None] + ROUNDING
        assert np.all(np.abs(changes) <= allowed), np.abs(changes / allowed).max(axis=0)
