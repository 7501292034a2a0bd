# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Sends joint positions to drivers at a set rate, with recorded times, in a separate process.

Each position encodes its number, so that a receiver can look up the sending time.
"""

import contextlib
import socket
import struct
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection

STEP_RAD = 2.0**-20
"""Difference between two positions, rad: a float32 represents every multiple of it below 1
exactly."""

STATUS_PERIOD_S = 0.1
FRAME = struct.Struct('<4ii10f')
STATUS = struct.pack('<4i7i', 40, 13, 1, 0, 1, 0, 0, 0, 0, 2, 1)
BEGIN_AFTER_S = 0.05


@dataclass(frozen=True)
class Order:
    """Request for `messages` positions to each of `targets` (0, 1, ...), `rate` per second.

    The targets take turns, evenly spaced. The numbering of the positions starts at `first`.
    """

    rate: float
    messages: int
    targets: tuple[int, ...]
    first: int


def frame(number: int) -> bytes:
    """Return the JOINT_POSITION with a number."""
    angle = STEP_RAD * number
    return FRAME.pack(56, 10, 1, 0, 0, *(angle,) * 6, 0.0, 0.0, 0.0, 0.0)


def serve(pipe: Connection, drivers: int) -> None:
    """Send the requested positions until the pipe is closed.

    Writes the motion port and a state port for each driver to the pipe. Then, for each Order, it
    writes the times (monotonic, s) at which each target's messages were sent.
    """
    servers = [socket.create_server(('127.0.0.1', 0)) for _ in range(drivers + 1)]
    pipe.send([server.getsockname()[1] for server in servers])
    threading.Thread(target=_hold, args=(servers[0],), daemon=True).start()
    sockets = [server.accept()[0] for server in servers[1:]]
    for item in sockets:
        item.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    pipe.send('connected')
    with contextlib.suppress(EOFError):
        while True:
            order: Order = pipe.recv()
            pipe.send(_send([sockets[target] for target in order.targets], order))


def _hold(server: socket.socket) -> None:
    """Accept motion connections, and ignore them."""
    held = []
    while True:
        held.append(server.accept())


def _send(sockets: Sequence[socket.socket], order: Order) -> list[list[float]]:
    sent: list[list[float]] = [[] for _ in sockets]
    period = 1.0 / order.rate
    start = time.monotonic() + BEGIN_AFTER_S
    status_due = start
    for number in range(order.messages):
        data = frame(order.first + number)
        due = start + number * period
        for place, item in enumerate(sockets):
            wait = due + place * period / len(sockets) - time.monotonic()
            if wait > 0.0:
                time.sleep(wait)
            sent[place].append(time.monotonic())
            item.sendall(data)
        if due >= status_due:
            status_due += STATUS_PERIOD_S
            for item in sockets:
                item.sendall(STATUS)
    return sent
