# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Ctrl-C during a motion stops the arm and ends the goal, with each delivery of points."""

import signal
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.cell import START
from support.ros_peer import PATIENCE, trajectory
from support.watcher import PROFILE, Watcher

FAR = [1.5, 0.0, 0.3, 0.1, -0.6, 0.1]


LEGS = 6


def to_and_fro() -> Any:
    """Return a fast motion of 18 s, long enough for a busy machine."""
    shares = np.linspace(0.0, LEGS, 15 * LEGS + 1)
    there = 0.5 - 0.5 * np.cos(np.pi * shares)
    places = np.array(START) + there[:, None] * (np.array(FAR) - START)
    return trajectory(*zip((shares * 3.0).tolist(), places.tolist(), strict=True))


@pytest.mark.parametrize(
    ('kind', 'interface'),
    [
        ('simulated', 'streaming'),
        ('abb', 'download'),
        ('motoman', 'streaming'),
    ],
)
def test_ctrl_c_brakes_within_limits_and_ends_the_goal_once(
    make_cell: Any, tmp_path: Path, kind: str, interface: str
) -> None:
    profile = tmp_path / 'measured.yaml'
    profile.write_text(PROFILE.format(kind=kind), encoding='utf-8')
    cell = make_cell(
        f'--controller={profile}', '--motion=smooth', controller=profile, interface=interface
    ).ready()
    peer = cell.peer
    peer.enable()
    with closing(Watcher(cell.ports.state)) as watcher:
        goal = peer.goal(to_and_fro())
        peer.wait_for(lambda: peer.joint_states[-1].position[0] > 0.5, 'the arm at high speed')
        cell.client.send(signal.SIGINT)
        assert cell.client.wait(PATIENCE) == 0
        ended, code, text = goal.result()
        assert (ended, code) == ('aborted', -1), text
        assert text == 'the driver was shut down, the arm is at rest'
        assert cell.client.log_text().count('goal aborted: ') == 1
        watcher.until_at_rest()
    assert not np.allclose(watcher.seen[-1].positions[:6], START, atol=1e-3)
    watcher.assert_within_limits()
