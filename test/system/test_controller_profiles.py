# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The driver with controllers of all profiles."""

from typing import Any

import numpy as np
import pytest
from support.cell import START
from support.ros_peer import trajectory

from epson_driver.motion import Trajectory
from epson_driver.share import share_path
from epson_driver.trajectory_file import read_trajectory

PLANS = ('around_pillar_11_points', 'around_pillar_fast_100ms', 'around_pillar_positions_only')


def message_of(plan: Trajectory) -> Any:
    """Return a plan as a ROS message with velocities."""
    message = trajectory(*zip(plan.times.tolist(), plan.positions.tolist(), strict=True))
    if plan.velocities is not None:
        for point, velocities in zip(message.points, plan.velocities.tolist(), strict=True):
            point.velocities = velocities
    return message


@pytest.mark.parametrize('name', ['motoman', 'spel'])
def test_planned_trajectories_succeed_on_every_controller(make_cell: Any, name: str) -> None:
    how = () if name == 'spel' else ('--motion=smooth',)
    cell = make_cell(f'--controller={name}', *how, controller=name).ready()
    cell.peer.enable()
    for file in PLANS if name == 'spel' else PLANS[1:2]:  # the program that an owner loads
        plan = read_trajectory(share_path('config', 'trajectories', f'{file}.yaml'))
        to_start = trajectory((2.0, plan.positions[0].tolist()))
        assert cell.peer.goal(to_start).result()[0] == 'succeeded'
        ended, _, text = cell.peer.goal(message_of(plan)).result()
        assert ended == 'succeeded', f'{file}: {text}'
        end = plan.positions[-1]
        assert np.abs(cell.peer.assert_still(5) - end).max() < 1e-4


def test_motoman_is_enabled_reset_and_disabled_by_its_commands(make_cell: Any) -> None:
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
    success, text = peer.call('reset_error')
    assert not success
    assert 'the E-stop is not reset (RESET_ALARM: FAILURE: reset the error at the' in text
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
