# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Ctrl-C in the middle of a motion, for each way to a controller: the arm rests, the goal ends."""

import signal
import socket
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cell import START
from ros_peer import PATIENCE, trajectory

from epson_driver.robots import load_robot_model
from epson_driver.simple_message import Framer, JointFeedback, decode

LIMITS = load_robot_model('c3_a601s').limits
FAR = [1.5, 0.0, 0.3, 0.1, -0.6, 0.1]
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
                    self.seen.append(message)

    def _receive(self) -> bytes:
        try:
            return self._socket.recv(65536)
        except OSError:
            return b''

    def until_at_rest(self) -> None:
        """Wait until a hundred messages in a row show no motion."""
        end = time.monotonic() + PATIENCE
        while len(self.seen) < 100 or any(any(each.velocities) for each in self.seen[-100:]):
            assert time.monotonic() < end, 'the arm does not come to rest'
            assert self._thread.is_alive(), 'the controller closed the connection'
            time.sleep(0.01)

    def close(self) -> None:
        self._socket.shutdown(socket.SHUT_RDWR)
        self._socket.close()
        self._thread.join(PATIENCE)

    def changes(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return steps of time (s), velocities and their changes, one row per message."""
        times = np.array([each.time for each in self.seen])
        velocities = np.array([each.velocities[: len(START)] for each in self.seen])
        return np.diff(times), velocities, np.diff(velocities, axis=0)


def far_away() -> Any:
    """Return a long motion in small steps, at rest at both ends."""
    shares = np.linspace(0.0, 1.0, 61)
    smooth = shares**2 * (3.0 - 2.0 * shares)
    places = np.array(START) + smooth[:, None] * (np.array(FAR) - START)
    return trajectory(*zip((shares * 3.0).tolist(), places.tolist(), strict=True))


@pytest.mark.parametrize(
    ('kind', 'interface'),
    [('rc620', 'streaming'), ('abb', 'download'), ('motoman', 'streaming')],
)
def test_ctrl_c_in_mid_motion_brakes_within_limits_and_ends_the_goal_once(
    make_cell: Any, tmp_path: Path, kind: str, interface: str
) -> None:
    profile = tmp_path / 'measured.yaml'
    profile.write_text(PROFILE.format(kind=kind), encoding='utf-8')
    cell = make_cell(
        f'--controller={profile}', '--motion=smooth', controller=profile, interface=interface
    ).ready()
    peer = cell.peer
    peer.enable()
    watcher = Watcher(cell.ports.state)
    try:
        goal = peer.goal(far_away())
        peer.wait_for(lambda: peer.joint_states[-1].velocity[0] > 0.6, 'a fast motion')
        begin = time.monotonic()
        cell.client.send(signal.SIGINT)
        assert cell.client.wait(PATIENCE) == 0
        print(f'{kind}: the process had ended {time.monotonic() - begin:.2f} s after Ctrl-C')
        ended, code, text = goal.result()
        assert (ended, code) == ('aborted', -1), text
        assert text == 'the driver was shut down; the arm stands'
        assert cell.client.log_text().count('goal aborted: ') == 1
        watcher.until_at_rest()
    finally:
        watcher.close()
    assert START[0] < watcher.seen[-1].positions[0] < 1.4
    steps, velocities, changes = watcher.changes()
    assert velocities[:, 0].max() > 0.6
    assert np.all(np.abs(velocities) <= np.array(LIMITS.velocity) * 1.01)
    allowed = np.array(LIMITS.acceleration) * steps[:, None] + ROUNDING
    assert np.all(np.abs(changes) <= allowed), np.abs(changes / allowed).max(axis=0)
