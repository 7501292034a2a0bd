# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The node and a simulated RC800 with Real-time Motion Control, over DDS."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.cell import START
from support.ros_peer import trajectory

pytestmark = [pytest.mark.slow, pytest.mark.invariant(3, 4)]


def test_goal_estop_reset_and_goal_over_dds(make_cell: Any, tmp_path: Path) -> None:
    slow = tmp_path / 'slow.yaml'  # its buffer lasts 0.2 s, also on a busy machine
    slow.write_text('like: rtmc\nname: slow\ndescription: slow\nrtmc:\n  cycle: 0.02\n')
    cell = make_cell(
        f'--controller={slow}', controller=str(slow), remote_port=0, io_port=0
    ).ready()
    peer = cell.peer
    peer.enable()
    there = [0.4, *START[1:]]
    ended, _, text = peer.goal(trajectory((0.0, START), (2.0, there))).result()
    assert ended == 'succeeded', text
    np.testing.assert_allclose(peer.position(), there, atol=1e-3)

    goal = peer.goal(trajectory((0.0, there), (30.0, START)))
    peer.wait_for(lambda: peer.robot_status[-1].in_motion.val == 1, 'motion')
    cell.pendant('estop', 'press')
    ended, _, text = goal.result()
    assert ended == 'aborted'
    assert 'E-stop' in text
    cell.pendant('estop', 'release')
    stopped = peer.wait_until_still()
    assert START[0] < stopped[0] <= there[0]

    success, text = peer.call('reset_error')
    assert success, text
    peer.enable()
    np.testing.assert_allclose(peer.assert_still(5), stopped, atol=1e-4)
    ended, _, text = peer.goal(trajectory((0.0, stopped.tolist()), (2.0, START))).result()
    assert ended == 'succeeded', text
    np.testing.assert_allclose(peer.position(), START, atol=1e-3)
