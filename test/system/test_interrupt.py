# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Ctrl-C in the middle of a motion, for each way to a controller: the arm rests, the goal ends."""

import signal
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cell import START
from ros_peer import PATIENCE, trajectory
from watcher import PROFILE, Watcher

FAR = [1.5, 0.0, 0.3, 0.1, -0.6, 0.1]


def far_away() -> Any:
    """Return a long motion in small steps, at rest at both ends."""
    shares = np.linspace(0.0, 1.0, 61)
    smooth = shares**2 * (3.0 - 2.0 * shares)
    places = np.array(START) + smooth[:, None] * (np.array(FAR) - START)
    return trajectory(*zip((shares * 3.0).tolist(), places.tolist(), strict=True))


@pytest.mark.parametrize(
    ('kind', 'interface'),
    [('rc620', 'streaming'), ('abb', 'download'), ('motoman', 'streaming')],
)
def test_ctrl_c_in_mid_motion_brakes_within_limits_and_ends_the_goal_once(
    make_cell: Any, tmp_path: Path, kind: str, interface: str
) -> None:
    profile = tmp_path / 'measured.yaml'
    profile.write_text(PROFILE.format(kind=kind), encoding='utf-8')
    cell = make_cell(
        f'--controller={profile}', '--motion=smooth', controller=profile, interface=interface
    ).ready()
    peer = cell.peer
    peer.enable()
    watcher = Watcher(cell.ports.state)
    try:
        goal = peer.goal(far_away())
        peer.wait_for(lambda: peer.joint_states[-1].velocity[0] > 0.6, 'a fast motion')
        begin = time.monotonic()
        cell.client.send(signal.SIGINT)
        assert cell.client.wait(PATIENCE) == 0
        print(f'{kind}: the process had ended {time.monotonic() - begin:.2f} s after Ctrl-C')
        ended, code, text = goal.result()
        assert (ended, code) == ('aborted', -1), text
        assert text == 'the driver was shut down; the arm stands'
        assert cell.client.log_text().count('goal aborted: ') == 1
        watcher.until_at_rest()
    finally:
        watcher.close()
    assert START[0] < watcher.seen[-1].positions[0] < 1.4
    _, velocities, _ = watcher.changes()
    assert velocities[:, 0].max() > 0.6
    watcher.assert_within_limits()
