# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The same inputs and the same seed give the same bytes, on every port, with faults too."""

from contextlib import suppress

import numpy as np
import pytest
from support.controller_harness import LIMITS, MODEL, RC620, STOP, InlinePlanner, Peer, point

from epson_driver.sim_controller.assembly import new_controller
from epson_driver.sim_controller.condition.states import Event, RejectedError
from epson_driver.sim_controller.faults.fault_text import parse
from epson_driver.simple_message import FrameError

PORTS = ('motion', 'state', 'io', 'remote')


def run(seed, planner=None, inputs=7):
    """Live through a few seconds that are drawn from `inputs`; return the bytes of each port."""
    controller = new_controller(MODEL, RC620, planner=planner, seed=seed)
    random = np.random.default_rng(inputs)
    peers = {port: Peer() for port in PORTS}
    connections = {port: controller.connect(port, peer) for port, peer in peers.items()}
    out = {port: bytearray() for port in PORTS}
    events = (Event.ESTOP_PRESS, Event.ESTOP_RELEASE, Event.RESET, Event.PAUSE, Event.CONTINUE)
    for fault in ('jitter 0.03', 'bit_errors 0.3 bits=3', 'coalesce 0.02 port=motion'):
        controller.faults.start(parse(fault))
    connections['remote'].receive(b'$Login\r\n')
    for index in range(80):
        chosen = [*events, *[Event.MOTORS_ON] * 5][random.integers(10)]
        with suppress(RejectedError):
            controller.apply(chosen)
        joints = 0.2 * random.uniform(LIMITS.position_min, LIMITS.position_max)
        sequence = int(random.choice([0, index % 5, STOP]))
        connections['motion'].receive(
            point(sequence, joints, float(random.uniform(0.0, 1.0)), 0.1)
        )
        connections['remote'].receive(b'$GetStatus\r\n')
        try:
            connections['io'].receive(bytes(random.integers(0, 2, 16, dtype=np.uint8)))
        except FrameError:
            connections['io'].closed()
            connections['io'] = controller.connect('io', peers['io'])
        controller.step(float(random.uniform(0.0, 0.2)))
        for port, peer in peers.items():
            out[port] += peer.take()
    return {port: bytes(data) for port, data in out.items()}


@pytest.mark.parametrize('smooth', [False, True])
def test_the_same_inputs_and_seed_give_the_same_bytes(smooth):
    first, second = (run(3, InlinePlanner() if smooth else None) for _ in range(2))
    assert first == second
    assert all(first[port] for port in ('motion', 'state', 'remote'))


def test_another_seed_gives_other_bytes_where_chance_is_and_only_there():
    first, second = run(3), run(4)
    assert first['state'] != second['state']
    assert first['remote'] == second['remote']
