# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The driver makes the motion smooth for a controller that goes from point to point."""

from typing import Any

import numpy as np
from support.cell import START
from support.ros_peer import trajectory

from epson_driver.motion.passages import passages

POINTS = [
    START,
    [0.3, 0.2, 0.2, 0.1, -0.6, 0.1],
    [0.6, 0.2, 0.4, 0.2, -0.7, 0.2],
    [0.8, 0.0, 0.5, 0.2, -0.6, 0.3],
]


def test_a_plan_without_times_is_resampled_along_the_time_optimal_motion(make_cell: Any) -> None:
    cell = make_cell(smoothing='resample', resample_period=0.05, timing='time_optimal').ready()
    peer = cell.peer
    peer.enable()
    first = len(peer.joint_states)
    goal = peer.goal(trajectory(*((0.0, point) for point in POINTS)))
    ended, code, text = goal.result()
    assert (ended, code) == ('succeeded', 0), text
    assert np.abs(peer.assert_still() - POINTS[-1]).max() < 1e-6
    states = peer.joint_states[first:]
    path = np.array([state.position for state in states])
    at = passages(np.array(POINTS), path)
    # between two points the arm goes straight: off by a · 0.05² / 8, with a up to 100 rad/s²
    assert np.abs(path[at] - POINTS).max() < 0.04
    desired = [each.reference.time_from_start for each in peer.controller_states]
    assert max(time.sec + time.nanosec * 1e-9 for time in desired) < 2.0
    # stopped while it moves, and on its way back
    goal = peer.goal(trajectory((0.0, POINTS[-1]), (0.0, POINTS[-2]), (0.0, START)))
    peer.wait_for_motion()
    goal.cancel()
    ended, code, text = goal.result()
    assert (ended, code) == ('canceled', 0), text
    position = peer.assert_still()
    ended, code, text = peer.goal(trajectory((0.0, [9.0] * 6))).result()
    assert (ended, code) == ('aborted', -1)
    assert 'joint_1: position 9 rad is outside the limits' in text
    assert np.array_equal(peer.assert_still(), position)


def test_without_it_a_plan_without_times_is_refused(make_cell: Any) -> None:
    peer = make_cell().ready().peer
    peer.enable()
    ended, code, text = peer.goal(trajectory(*((0.0, point) for point in POINTS))).result()
    assert (ended, code) == ('aborted', -1)
    assert 'times must strictly increase' in text
