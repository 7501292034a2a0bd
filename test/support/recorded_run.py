# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Synthetic traces with known content: a motion, replies, an E-stop."""

import io
from pathlib import Path
from typing import Any

import numpy as np

from epson_driver.simple_message import (
    LITTLE_ENDIAN,
    JointPosition,
    JointTrajPt,
    Message,
    ReplyCode,
    SpecialSequence,
    Status,
    encode,
    joint_data,
    reply,
    request,
    topic,
)
from epson_driver.trace.pcap import Conversation, PcapWriter

START = 1_790_000_000
"""Start of all runs, s since 1970."""

PERIOD = 0.005
DEAD_TIME = 0.05
SENT = 1.0
MOVED = 2.0
POINTS = np.array([[0.0] * 6, [0.5, -0.25, 0.1, 0.0, -0.5, 0.2], [1.0, -0.5, 0.2, 0.0, -1.0, 0.4]])
READY = Status(1, 0, 0, 0, 0, 2, 1)
MOVING = Status(1, 0, 0, 0, 1, 2, 1)


class Recorder:
    """Writes a trace, message by message. Times are in s since START."""

    def __init__(self, controller: str = '10.0.0.2') -> None:
        self._file = io.BytesIO()
        self._writer = PcapWriter(self._file)
        self._controller = controller
        self._conversations: dict[int, Conversation] = {}

    def connect(self, time: float, port: int) -> None:
        """Open a connection to a port."""
        self._conversations[port] = Conversation(
            self._writer,
            ('10.0.0.1', 40_000 + port % 100),
            (self._controller, port),
            nanoseconds(time),
        )

    def controller_sends(
        self, time: float, port: int, message: Message, *, answers: bool = False
    ) -> None:
        """Record a message of the controller, as a topic or as a reply."""
        packet = reply(message, ReplyCode.SUCCESS) if answers else topic(message)
        self.raw(time, port, encode(packet, LITTLE_ENDIAN))

    def controller_refuses(self, time: float, port: int, message: Message) -> None:
        """Record a reply with FAILURE."""
        self.raw(time, port, encode(reply(message, ReplyCode.FAILURE), LITTLE_ENDIAN))

    def driver_sends(self, time: float, port: int, message: Message) -> None:
        """Record a request of the driver."""
        self.raw(time, port, encode(request(message), LITTLE_ENDIAN), from_client=True)

    def raw(self, time: float, port: int, data: bytes, *, from_client: bool = False) -> None:
        """Record unchanged bytes."""
        self._conversations[port].data(nanoseconds(time), data, from_client=from_client)

    def lose(self, time: float, port: int) -> None:
        """Record that the controller closes a connection."""
        self._conversations[port].finish(nanoseconds(time), from_client=False)

    def content(self) -> bytes:
        """Return the file."""
        return self._file.getvalue()

    def write(self, path: Path) -> Path:
        """Write the file."""
        path.write_bytes(self.content())
        return path


def nanoseconds(time: float) -> int:
    """Return ns since 1970."""
    return (START * 1_000_000 + round(time * 1e6)) * 1000


def position(time: float) -> np.ndarray:
    """Return the arm's position: from the first to the last point in MOVED s, rest to rest."""
    fraction = np.clip((time - SENT - DEAD_TIME) / MOVED, 0.0, 1.0)
    return POINTS[-1] * (fraction - np.sin(2 * np.pi * fraction) / (2 * np.pi))


def usual_run(seconds: float = 4.0, *, estop: float | None = None) -> Recorder:
    """Return a run with a trajectory of three points, sent at SENT, and an optional E-stop."""
    recorder = Recorder()
    recorder.connect(0.0, 11002)
    recorder.connect(0.001, 11000)
    entries: list[tuple[float, Any]] = []
    for slot in range(round(seconds / PERIOD)):
        time = 0.01 + slot * PERIOD
        if slot % 11 == 10:
            status = MOVING if SENT + DEAD_TIME < time < SENT + DEAD_TIME + MOVED else READY
            if estop is not None and time >= estop:
                status = Status(0, 1, 2313, 1, 0, 2, 0)
            entries.append((time, lambda t, s=status: recorder.controller_sends(t, 11002, s)))
        else:
            held = time if estop is None else min(time, estop)
            joints = JointPosition(0, joint_data(position(held).tolist()))
            entries.append((time, lambda t, j=joints: recorder.controller_sends(t, 11002, j)))
    for number, point in enumerate(POINTS):
        at = SENT + 0.02 * number
        sent = JointTrajPt(number, joint_data(point.tolist()), 0.5, 1.0 if number else 0.001)
        answer = JointPosition(number)
        entries.append((at, lambda t, m=sent: recorder.driver_sends(t, 11000, m)))
        entries.append(
            (at + 0.004, lambda t, m=answer: recorder.controller_sends(t, 11000, m, answers=True))
        )
    if estop is not None:
        stop = JointTrajPt(SpecialSequence.STOP_TRAJECTORY)
        entries.append((estop + 0.06, lambda t: recorder.driver_sends(t, 11000, stop)))
        entries.append(
            (
                estop + 0.07,
                lambda t: recorder.controller_sends(t, 11000, JointPosition(), answers=True),
            )
        )
    for time, record in sorted(entries, key=lambda entry: entry[0]):
        record(time)
    return recorder
