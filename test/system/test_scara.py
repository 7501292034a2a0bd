# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A SCARA, whose joint 3 is in metres, with node and controller as processes."""

from typing import Any

import numpy as np
from support.ros_peer import trajectory

from epson_driver.robots import load_robot_model

ROBOT = 'gx4_c251s'
START = [0.1, 0.2, -0.05, 0.3]
NAMES = [f'joint_{number}' for number in range(1, 5)]
TARGET = [0.5, -0.4, -0.12, -1.0]


def test_scara_moves_and_errors_use_metres(make_cell: Any) -> None:
    start = '--start=' + ','.join(map(str, START))
    cell = make_cell(f'--robot={ROBOT}', '--motion=smooth', start, robot_model=ROBOT).ready()
    peer = cell.peer
    peer.enable()
    assert peer.joint_states[-1].name == NAMES
    # to the nearest encoder pulse, 0.09 µm for joint 3
    pulse = 1.0 / load_robot_model(ROBOT).pulses_per_unit
    assert np.all(np.abs(peer.position() - START) <= pulse)

    out_of_range = trajectory((0.0, START), (2.0, [*START[:2], -0.2, START[3]]), names=NAMES)
    ended, _, text = peer.goal(out_of_range).result()
    assert ended == 'aborted'
    expected = 'point 1, joint_3: position -0.2 m is outside the limits -0.15 … 0 m'
    assert expected in text

    too_fast = trajectory((0.0, START), (0.05, TARGET), names=NAMES)
    ended, _, text = peer.goal(too_fast).result()
    assert ended == 'aborted'
    assert 'joint_1: 8 rad/s would be needed, the velocity limit is 7.85' in text
    assert 'joint_3: 1.4 m/s would be needed, the velocity limit is 1.152 m/s' in text

    elsewhere = trajectory((0.0, [*START[:2], -0.1, START[3]]), (2.0, TARGET), names=NAMES)
    ended, _, text = peer.goal(elsewhere).result()
    assert ended == 'aborted'
    assert (
        'joint_3: the trajectory starts at -0.1 m, the joint is at -0.05 m: 0.05 m apart' in text
    )

    middle = [0.3, -0.1, -0.08, -0.3]
    plan = trajectory((0.0, START), (0.5, middle), (1.0, TARGET), names=NAMES)
    ended, _, text = peer.goal(plan).result()
    assert ended == 'succeeded', text
    np.testing.assert_allclose(peer.assert_still(5), TARGET, atol=1e-4)
    third = np.array([state.position[2] for state in peer.joint_states])
    assert third.min() >= -0.1201
    assert third.max() <= -0.0499
    speeds = np.array([state.velocity[2] for state in peer.joint_states])
    assert -1.152 < speeds.min() < -0.02
