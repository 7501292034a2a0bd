# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What our SPEL+ program costs on the simulated controller: share of a core, statements per s.

`make bench`: a client of each port; points all 0.2 s, 104 I/O points subscribed to. CPU time of
this process over the controller's time, without sockets.
"""

import struct
import time
from collections.abc import Callable

import numpy as np

from epson_driver.profiles.profile import load_controller_profile
from epson_driver.robots import load_robot_model
from epson_driver.sim_controller.assembly import SpelSource, new_controller, program_network
from epson_driver.sim_controller.condition.states import Event
from epson_driver.sim_controller.core import Controller
from epson_driver.sim_controller.ports.session import Session
from epson_driver.sim_controller.spel_host.profile_project import profile_project
from epson_driver.sim_controller.spel_host.spel_program import SpelProgram
from epson_driver.spel import build

CYCLE_S = 0.004
SECONDS = 10.0
POINT_S = 0.2
SUBSCRIPTIONS = ((1, 24), (2, 16), (7, 64))
"""Type of I/O point and how many: digital inputs, outputs, memory bits."""


class _Client:
    """A client in this process."""

    local = True

    def __init__(self) -> None:
        self.bytes = 0

    def send(self, data: bytes) -> None:
        """Count what comes."""
        self.bytes += len(data)

    def close(self) -> None:
        """Be closed."""
        raise RuntimeError('the program has closed the connection')

    abort = close


def _frame(kind: int, body: bytes) -> bytes:
    return struct.pack('<4i', 12 + len(body), kind, 2, 0) + body


def _points(motion: Session) -> Callable[[float], None]:
    """Return what sends points along joint 1, to and fro, each when it is due."""
    sent = 0

    def send(now: float) -> None:
        nonlocal sent
        while sent * POINT_S <= now + 1.0:
            joints = [0.4 * float(np.sin(sent * POINT_S)), *[0.0] * 9]
            motion.receive(_frame(11, struct.pack('<i12f', sent, *joints, 0.0, POINT_S)))
            sent += 1

    return send


def _controller() -> tuple[Controller, SpelProgram]:
    model, profile = load_robot_model('c3_a601s'), load_controller_profile('spel')
    source = SpelSource(build(profile_project(profile.spel, model)), program_network(profile))
    controller = new_controller(model, profile, spel=source)
    program = controller.program
    if not isinstance(program, SpelProgram):
        raise TypeError('the profile runs no SPEL+ program')
    return controller, program


def measure(ports: tuple[str, ...]) -> tuple[float, float, float]:
    """Return the share of a core, statements per s of the controller, and µs for a statement."""
    controller, program = _controller()
    controller.step(1.0)
    controller.apply(Event.MOTORS_ON)
    sessions = {port: controller.connect(port, _Client()) for port in ports}
    controller.step(0.5)
    if 'io' in sessions:
        ranges = b''.join(struct.pack('<3i', kind, 0, count) for kind, count in SUBSCRIPTIONS)
        sessions['io'].receive(_frame(65204, struct.pack('<2i', 1, len(SUBSCRIPTIONS)) + ranges))
    send = _points(sessions['motion']) if 'motion' in sessions else None
    begin, statements = time.process_time(), program.statements
    for cycle in range(round(SECONDS / CYCLE_S)):
        if send is not None:
            send(cycle * CYCLE_S)
        controller.step(CYCLE_S)
    used = time.process_time() - begin
    statements = program.statements - statements
    return used / SECONDS, statements / SECONDS, used / statements * 1e6


def main() -> None:
    """Print a row for each set of clients."""
    print('SPEL+ program    share of a core   statements/s   µs / statement, the arm included')
    for ports in (('state',), ('state', 'motion'), ('state', 'motion', 'io')):
        share, rate, cost = measure(ports)
        print(f'{", ".join(ports):20} {share:10.4f} {rate:14.0f} {cost:10.2f}', flush=True)


if __name__ == '__main__':
    main()
