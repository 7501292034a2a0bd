# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Many hostile frames on the ports of the SPEL+ program with motors on.

The program continues, nothing moves, and the next client is served. Single bad messages are tested
in test/controller_program/test_motion_rules.py.
"""

import logging
import random
import struct

import numpy as np
import pytest
from support.controller_harness import SUCCESS, frame, point
from support.spel_program_harness import OurProgramHarness

POINT_BYTES = 52
NUMBERS = (float('nan'), float('inf'), -float('inf'), 1e38, -1e38, 1e-45, 9.0, -0.5, 1e9)
WORDS = (-(2**31), 2**31 - 1, -5, -4, -3, -2, -1, 0, 1, 2, 3, 10, 11, 12, 13, 64, 1000, 65200)
PER_CLIENT = 25
PER_STEP = 5


def hostile_frame(chance):
    """Return invalid bytes or an invalid frame, never a valid point."""
    kind = chance.choice([1, 2, 10, 11, 11, 11, 13, *range(65200, 65208), chance.choice(WORDS)])
    comm, code = chance.choice([1, 2, 2, 2, 3, 0, 9]), chance.choice([0, 0, 0, 1, 7])
    form = chance.randrange(6)
    if form == 0:
        return chance.randbytes(chance.randrange(1, 60))
    if form == 1:
        length = chance.choice([*WORDS, chance.randrange(-100, 5000)])
        return struct.pack('<4i', length, kind, comm, code) + chance.randbytes(20)
    if form <= 3:
        body = chance.randbytes(chance.choice([0, 4, 8, 12, 40, 48, 56, 400, 987]))
    elif form == 4:
        count = chance.choice([1, 2, 3, 4, 5, 9, 12, 14])
        body = struct.pack(f'<{count}i', *chance.choices(WORDS, k=count))
    else:  # joint 1 at 9 rad makes each point invalid
        joints = [9.0, *chance.choices([*NUMBERS, 0.1], k=9)]
        velocity, duration = (
            chance.choice([0.0, 0.5, *NUMBERS]),
            chance.choice([0.0, 1.0, *NUMBERS]),
        )
        body = struct.pack('<i12f', chance.choice(WORDS), *joints, velocity, duration)
    assert len(body) != POINT_BYTES or form == 5
    return frame(kind, comm, code, body)


@pytest.mark.invariant(7)
@pytest.mark.invariant(1)
@pytest.mark.parametrize(
    'count', [1_000, pytest.param(100_000, marks=pytest.mark.soak)], ids=['few', 'many']
)
def test_many_hostile_frames_move_nothing(count, caplog):
    caplog.set_level(logging.CRITICAL)
    chance = random.Random(16)
    harness = OurProgramHarness(LOST_CLIENT_MOTORS_OFF='')
    harness.ready().leave()
    sent = 0
    while sent < count:
        port = chance.choice(['motion', 'motion', 'state', 'io'])
        client = harness.connect(port)
        for number in range(PER_CLIENT):
            client.send_bytes(hostile_frame(chance))
            sent += 1
            if number % PER_STEP == 0:
                harness.controller.step(0.05)
            if not client.open:
                break
        client.leave()
        assert not np.any(harness.position)
    names = [row.name for row in harness.controller.tasks()]
    assert names == ['main', 'BgMain', 'MotionServer', 'StateServer', 'IoServer']
    assert harness.controller.condition.powered
    assert harness.connect().stream(point(0, [0.1, *[0.0] * 5], 0.0, 0.5)) == [(0, SUCCESS)]
    harness.until(lambda: abs(harness.position[0] - 0.1) < 1e-6)
