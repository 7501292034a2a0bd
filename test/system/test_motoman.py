# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The node and a Motoman, as real processes, without any remote port."""

from typing import Any

import numpy as np
from support.cell import START
from support.ros_peer import trajectory


def test_a_motoman_is_enabled_reset_and_disabled_by_its_own_commands(make_cell: Any) -> None:
    cell = make_cell('--controller=motoman', controller='motoman', remote_port=0).ready()
    peer = cell.peer
    assert peer.robot_status[-1].drives_powered.val == 0
    peer.enable()
    peer.wait_for(lambda: peer.robot_status[-1].drives_powered.val == 1, 'servos on')
    there = [START[0] + 0.1, *START[1:]]
    ended, _, text = peer.goal(trajectory((0.0, START), (0.5, there))).result()
    assert ended == 'succeeded', text

    cell.pendant('estop', 'press')
    peer.wait_for(lambda: peer.robot_status[-1].e_stopped.val == 1, 'E-stop')
    assert peer.call('reset_error') == (
        False,
        'RESET_ALARM: FAILURE: reset the error at the controller',
    )
    cell.pendant('estop', 'release')
    success, message = peer.call('reset_error')
    assert success, message
    peer.wait_for(lambda: peer.robot_status[-1].e_stopped.val == 0, 'E-stop reset')
    assert peer.robot_status[-1].drives_powered.val == 0
    peer.enable()
    here = peer.position().tolist()
    np.testing.assert_allclose(here, there, atol=1e-3)
    ended, _, text = peer.goal(trajectory((0.0, here), (0.5, START))).result()
    assert ended == 'succeeded', text

    success, message = peer.call('disable')
    assert (success, message) == (True, 'the arm is disabled and the motors are off')
    peer.wait_for(lambda: peer.robot_status[-1].drives_powered.val == 0, 'servos off')
