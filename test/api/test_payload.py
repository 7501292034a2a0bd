# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Conversion of the payload to SPEL+ Weight and Inertia."""

import pytest
from support.api_harness import robot_cell
from support.event_loop import until
from support.remote_peer import RemotePeer
from support.rtmc_cell import goal, rtmc_cell

from epson_driver import Robot, RobotError, aio
from epson_driver.aio import ArgumentError
from epson_driver.driver.delivery.statements import Load

HOME = [0.0] * 6


async def test_payload_and_inertia_are_sent_with_each_motion():
    async with (
        RemotePeer() as peer,
        aio.Robot(controller='remote', remote_port=peer.port) as robot,
    ):
        await robot.enable()
        inertia = [0.01, 0.0, 0.0, 0.02, 0.0, 0.03]
        robot.set_payload(2.0, center=[0.03, 0.04, 0.1], inertia=inertia)
        await robot.move_joints(HOME)
        (line,) = [line for line in peer.given('Execute') if 'Go' in line]
        # about the flange's axis: 0.03 + 2 · 0.05²
        assert 'Weight 2; Inertia 0.035, 50; Power Low' in line


async def test_simulated_controller_applies_the_payload():
    async with robot_cell(profile='remote') as (robot, controller):
        robot.set_payload(1.5, [0.0, 0.0, 0.05], [[0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.2]])
        await robot.move_joints([0.1, *HOME[1:]])
        assert controller.spel.values('Weight') == (1.5,)
        assert controller.spel.values('Inertia') == (0.2, 0.0)


async def test_payload_is_set_by_real_time_motion_before_each_motion(monkeypatch):
    async with rtmc_cell(monkeypatch) as (harness, cell):
        harness.driver.set_load(Load(1.5, 0.2, 0.05))
        port = cell.port
        for angle in (0.2, 0.1):
            port.weight = port.inertia = port.eccentricity = 0
            await until(lambda: not harness.driver.motion_link.moves)
            await goal(harness, [angle, *harness.at[1:]]).end()
            assert (port.weight, port.inertia, port.eccentricity) == (1.5, 0.2, 50)


@pytest.mark.parametrize(
    ('given', 'expected'),
    [
        ((-1.0,), 'mass = -1'),
        ((float('nan'),), 'mass = nan'),
        ((50.0,), 'mass = 50'),
        ((1.0, [0.0, 0.0]), r'center has shape \(2,\): must be \(3,\)'),
        ((1.0, [0.0, -65.6, 0.0]), 'center is 65.6 m from the flange axis: must be at most 1'),
        ((1.0, [0.0, 0.0, float('inf')]), 'center .* must be finite'),
        ((1.0, [0.0, 0.0, 0.0], [1.0]), r'inertia has shape \(1,\): must be \(6,\)'),
        ((1.0, [0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0, 0.0, -1.0]), 'must not be negative'),
        ((1.0, 'abc'), r"center = 'abc': must be numbers$"),
    ],
)
def test_invalid_payload_is_rejected_by_name(given, expected):
    robot = aio.Robot(controller='remote')
    with pytest.raises(ArgumentError, match=expected):
        robot.set_payload(*given)


def test_payload_is_rejected_if_a_program_moves_the_arm():
    with pytest.raises(RobotError, match='set Weight and Inertia in its program'):
        Robot(controller='simulated').set_payload(1.0)


@pytest.mark.slow
def test_simulated_operator_needs_no_second_remote_connection():
    with Robot.simulated(controller='remote') as robot:
        robot.simulation.estop()
        with pytest.raises(RobotError, match='E-stop'):
            robot.enable()
        robot.simulation.estop(pressed=False)
        robot.reset()
        robot.enable()
