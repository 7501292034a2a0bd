# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`joint_states` if the controller's state arrives in bursts or is read late."""

import os
import signal
import time
from typing import Any

import numpy as np
import pytest
from support.cell import START, Cell
from support.ros_peer import trajectory

PERIOD = 0.005
"""Period of the controller's state, s: ten joint messages, then a STATUS."""

STRETCH = 20
"""Number of samples of a stretch, many more than the velocity filter uses."""

SPEED = 0.64
"""Speed of joint 1 during the motion, rad/s: 1.6 rad in 2.5 s."""

FASTEST = 1.5 * 7.85
"""Velocity limit of joint 1 with a margin, rad/s."""

AWAY = [1.6, *START[1:]]


@pytest.mark.invariant(8)
@pytest.mark.parametrize(
    'fault',
    [
        'coalesce 0.05 port=state',
        pytest.param('coalesce 0.2 port=state', marks=pytest.mark.slow),
    ],
)
def test_inv8_velocities_are_derivatives_on_the_controller_s_clock(
    make_cell: Any, fault: str
) -> None:
    """During a motion of constant speed, positions show the controller's time.

    Only stretches count in which the controller kept its period, which a busy machine prevents.
    The motion is repeated until one is accurate. Without an estimate of the controller's clock,
    none ever is.
    """
    cell: Cell = make_cell(
        f'--state-period={PERIOD}', '--motion=smooth', state_timeout=10.0
    ).ready()
    cell.peer.enable()
    cell.pendant('fault', *fault.split())
    judged: list[tuple[int, float, float]] = []
    for _ in range(10):
        cell.peer.enable()  # a busy machine may have stopped the arm
        here = cell.peer.assert_still().tolist()
        there = AWAY if here[0] < 0.8 else START
        seen = len(cell.peer.joint_states)
        cell.peer.goal(trajectory((0.0, here), (2.5, there))).result()
        received = cell.peer.joint_states[seen:]
        positions = np.array([state.position[0] for state in received])
        velocities = np.array([state.velocity[0] for state in received])
        errors = _errors(positions, velocities)
        if len(errors) >= 50:
            judged.append((len(errors), *np.quantile(errors, (0.5, 0.9)).tolist()))
        assert np.abs(velocities).max() <= FASTEST
        moved = np.abs(np.diff(positions)) > 1e-4
        assert np.all(velocities[1:][moved] != 0.0)
        if len(errors) >= 50 and judged[-1][1] < 0.02 and judged[-1][2] < 0.05:
            break
    else:
        pytest.fail(f'samples, median and 90 % of the errors of each motion: {judged}')
    stamps = [state.header.stamp.sec + state.header.stamp.nanosec * 1e-9 for state in received]
    spans = np.diff(stamps)
    assert np.all(spans > 0.0)
    assert np.median(spans) == pytest.approx(PERIOD, rel=0.1)  # although they arrived in bursts


def _errors(positions: np.ndarray, velocities: np.ndarray) -> np.ndarray:
    """Return the relative errors of velocities in stretches of constant speed.

    Two joint messages are one slot apart, or two if a STATUS is between them, with the jitter of
    the simulation's loop. A velocity is checked if its window lasts as long as its slots, to 1 %,
    within a longer stretch without a pause.
    """
    distance = np.abs(positions - positions[0])
    steps = np.diff(distance) / (SPEED * PERIOD)
    slots = np.where(steps < 1.6, 1, 2)
    regular = np.abs(steps - slots) < 0.6
    errors = []
    for end in range(STRETCH, len(positions)):
        stretch = slice(end - STRETCH, end)
        if (
            not regular[stretch].all()
            or abs(steps[stretch].sum() / slots[stretch].sum() - 1) > 0.01
        ):
            continue
        spans = [8 - (slots[end - 8 : end][::-1].cumsum() <= limit).sum() for limit in (7, 8)]
        windows = [slice(end - 8 + span, end) for span in spans]
        if all(abs(steps[w].sum() / slots[w].sum() - 1) < 0.01 for w in windows):
            errors.append(abs(abs(velocities[end]) / SPEED - 1.0))
    return np.array(errors)


@pytest.mark.invariant(6)
def test_node_resumes_after_a_stall_of_seconds(make_cell: Any) -> None:
    """Invariant 6: no stale state is published as new, and the link is not considered lost."""
    cell: Cell = make_cell(state_timeout=3.0).ready()
    cell.peer.enable()
    connected = list(cell.peer.link_states)
    seen = len(cell.peer.joint_states)
    os.kill(cell.client.process_id, signal.SIGSTOP)
    try:
        time.sleep(4.0)  # longer than the state time-out
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
