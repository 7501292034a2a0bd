# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Whatever comes on the ports: no task ends, nothing moves by it, and the next client works."""

import struct

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from support.examples import examples
from support.robot_program import IO_PORT, MOTION_PORT, STATE_PORT, RobotHarness, moved, point

POINT_BYTES = 52
"""Of the body of a JOINT_TRAJ_PT. Here joint 1 is at 9 rad: others could be good points."""
EDGES = [-(2**31), 2**31 - 1, -5, -4, -3, -2, -1, 0, 1, 2, 3, 10, 11, 12, 13, 64, 1000, 65200]
WORDS = st.one_of(st.sampled_from(EDGES), st.integers(-(2**31), 2**31 - 1))
KINDS = st.one_of(st.sampled_from([1, 2, 10, 11, 11, 11, *range(65200, 65207)]), WORDS)
BODIES = st.one_of(
    st.lists(WORDS, max_size=30)
    .filter(lambda words: len(words) != POINT_BYTES // 4)
    .map(lambda words: struct.pack(f'<{len(words)}i', *words)),
    st.binary(max_size=80).filter(lambda body: len(body) != POINT_BYTES),
    st.builds(
        lambda sequence, floats: struct.pack('<i12f', sequence, 9.0, *floats[1:]),
        st.sampled_from(EDGES),
        st.lists(
            st.sampled_from([float('nan'), float('inf'), 1e38, -1e38, 1e-45, 9.0, -0.5, 1e9]),
            min_size=12,
            max_size=12,
        ),
    ),
)


def _frame(kind: int, comm: int, code: int, body: bytes) -> bytes:
    return struct.pack('<iiii', 12 + len(body), kind, comm, code) + body


FRAMES = st.builds(
    _frame, KINDS, st.sampled_from([1, 2, 2, 2, 3, 0, 9]), st.sampled_from([0, 0, 0, 1, 7]), BODIES
)
CHUNKS = st.lists(st.one_of(FRAMES, FRAMES, FRAMES, st.binary(max_size=40)), max_size=12)


@settings(max_examples=examples(25), deadline=None, suppress_health_check=list(HealthCheck))
@given(port=st.sampled_from([STATE_PORT, MOTION_PORT, IO_PORT]), chunks=CHUNKS, cut=st.booleans())
def test_hostile_frames_end_nothing_and_move_nothing(
    port: int, chunks: list[bytes], cut: bool
) -> None:
    harness = RobotHarness(LOST_CLIENT_MOTORS_OFF='')
    client = harness.client(port)
    for chunk in chunks:
        if client.open:
            client.send_bytes(chunk)
            if cut:
                harness.run(0.02)
    harness.run(0.5)
    client.leave()
    harness.run(1.0)
    assert harness.robot.gone_to == []
    assert harness.robot.failures == []
    assert all(harness.task(number) for number in (1, 65, 66, 67, 68))
    good = harness.client()
    start = harness.robot.position
    points = [point(n, moved(start, j1=n + 1.0)) for n in range(3)]
    assert harness.stream(good, points) == [(0, 1), (1, 1), (2, 1)]
    harness.rest()
    assert abs(harness.robot.position[0] - 3.0) < 1e-4
