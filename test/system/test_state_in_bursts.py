# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`joint_states` when the controller's state comes in bursts, or is read late."""

import os
import signal
import time
from typing import Any

import numpy as np
import pytest
from support.cell import START, Cell
from support.ros_peer import trajectory

PERIOD = 0.005
"""Of the controller's state, s: ten joints, and a STATUS in the eleventh slot."""

STRETCH = 20
"""Samples, many more than the velocity is the mean of."""

SPEED = 0.64
"""Of joint 1 in the middle of the motion, rad/s: 1.6 rad in 2.5 s."""

FASTEST = 1.5 * 7.85
"""rad/s, of joint 1 with its margin."""

AWAY = [1.6, *START[1:]]


@pytest.mark.invariant(8)
@pytest.mark.parametrize(
    'fault',
    [
        'coalesce 0.05 port=state',
        pytest.param('coalesce 0.2 port=state', marks=pytest.mark.slow),
    ],
)
def test_inv8_velocities_are_the_derivative_of_the_positions_on_the_controllers_clock(
    make_cell: Any, fault: str
) -> None:
    """docs/invariants.md, 8. In a motion of one speed positions tell the controller's time.

    What counts is where the controller kept its period: on a busy machine it may not.
    """
    cell: Cell = make_cell(
        f'--state-period={PERIOD}', '--motion=smooth', state_timeout=10.0
    ).ready()
    cell.peer.enable()
    cell.pendant('fault', *fault.split())
    judged: list[np.ndarray] = []
    for _ in range(10):
        if sum(map(len, judged)) >= 50:
            break
        cell.peer.enable()  # a machine that is too busy may have stopped the arm
        here = cell.peer.assert_still().tolist()
        there = AWAY if here[0] < 0.8 else START
        seen = len(cell.peer.joint_states)
        cell.peer.goal(trajectory((0.0, here), (2.5, there))).result()
        came = cell.peer.joint_states[seen:]
        positions = np.array([state.position[0] for state in came])
        velocities = np.array([state.velocity[0] for state in came])
        judged.append(_errors(positions, velocities))
        assert np.abs(velocities).max() <= FASTEST
        moved = np.abs(np.diff(positions)) > 1e-4
        assert np.all(velocities[1:][moved] != 0.0)
    errors = np.concatenate(judged)
    assert len(errors) >= 50
    assert np.median(errors) < 0.02
    assert np.quantile(errors, 0.9) < 0.15  # a controller that is not scheduled has no clock
    stamps = [state.header.stamp.sec + state.header.stamp.nanosec * 1e-9 for state in came]
    spans = np.diff(stamps)
    assert np.all(spans > 0.0)
    assert np.median(spans) == pytest.approx(PERIOD, rel=0.1)  # though they came all at once


def _errors(positions: np.ndarray, velocities: np.ndarray) -> np.ndarray:
    """Return how far velocities are from the speed of the motion, relative, where it is constant.

    Between two joints there is one slot, or two if a STATUS came between: more or less, as the
    simulation's loop runs. Where a window has as much time as it has slots, to 1 %, the velocity
    must be right; all of it within a longer stretch without a pause.
    """
    way = np.abs(positions - positions[0])
    steps = np.diff(way) / (SPEED * PERIOD)
    slots = np.where(steps < 1.6, 1, 2)
    kept = np.abs(steps - slots) < 0.6
    errors = []
    for end in range(STRETCH, len(positions)):
        stretch = slice(end - STRETCH, end)
        if not kept[stretch].all() or abs(steps[stretch].sum() / slots[stretch].sum() - 1) > 0.01:
            continue
        spans = [8 - (slots[end - 8 : end][::-1].cumsum() <= most).sum() for most in (7, 8)]
        windows = [slice(end - 8 + span, end) for span in spans]
        if all(abs(steps[each].sum() / slots[each].sum() - 1) < 0.01 for each in windows):
            errors.append(abs(abs(velocities[end]) / SPEED - 1.0))
    return np.array(errors)


@pytest.mark.invariant(6)
def test_a_node_that_stood_still_for_seconds_goes_on(make_cell: Any) -> None:
    """Invariant 6: it takes nothing old for new, and its own absence not for the controller's."""
    cell: Cell = make_cell(state_timeout=3.0).ready()
    cell.peer.enable()
    connected = list(cell.peer.link_states)
    seen = len(cell.peer.joint_states)
    os.kill(cell.client.process_id, signal.SIGSTOP)
    try:
        time.sleep(4.0)  # longer than its time-out, which is what is tested
    finally:
        os.kill(cell.client.process_id, signal.SIGCONT)
    ended, _, text = cell.peer.goal(trajectory((0.0, START), (1.0, AWAY))).result()
    assert ended == 'succeeded', text
    assert cell.peer.link_states == connected
    stamps = [
        state.header.stamp.sec + state.header.stamp.nanosec * 1e-9
        for state in cell.peer.joint_states[seen:]
    ]
    assert np.all(np.diff(stamps) > 0.0)
