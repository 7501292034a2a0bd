# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Errors of a call that cannot move the arm name the present cause and the remedy."""

import asyncio
from itertools import product
from typing import NamedTuple

import pytest
from support.api_harness import robot_cell
from support.examples import quickly

from epson_driver.aio import MotionError, RobotError
from epson_driver.driver.stopping.motors import RemoteEthernetMotors
from epson_driver.sim_controller.condition.states import Event

PROFILES = (
    'simulated',
    'remote',
    'spel',
    'motoman',
    'abb',
    'fanuc',
    'generic',
)
NO_STREAMS = ('motoman', 'abb', 'remote')
NO_REMOTE_ETHERNET = ('motoman',)


class Row(NamedTuple):
    """Events, and the errors of enable() and of moves. `in_status`: STATUS shows it."""

    events: tuple[Event, ...]
    enable: str
    move: str
    in_status: bool = True


ESTOP = r'the E-stop is pressed or not reset.*; release it, call reset\(\)'
ROWS = {
    'E-stop': Row((Event.ESTOP_PRESS,), ESTOP, rf'not enabled.*{ESTOP}'),
    'E-stop that is not reset': Row(
        (Event.ESTOP_PRESS, Event.ESTOP_RELEASE), ESTOP, rf'not enabled.*{ESTOP}'
    ),
    'door': Row(
        (Event.DOOR_OPEN,),
        r'the safeguard door is open; close it, .*then call enable\(\)',
        r'not enabled.*(motors are off|door is open).*; .*call enable\(\)',
        in_status=False,
    ),
    'key': Row(
        (Event.MODE_MANUAL,),
        r'(the mode is TEACH|key switch is at MANUAL); turn it to AUTO, then call enable\(\)',
        r'not enabled.*(TEACH|MANUAL)\)?; turn it to AUTO, then call enable\(\)',
    ),
    'error': Row(
        (Event.ERROR,),
        r'the controller is in error .*; call reset\(\), then enable\(\)',
        r'not enabled.*; call (reset\(\), then )?enable\(\)',
        in_status=False,
    ),
}


LONG = list(product(['spel'], list(ROWS)[1:]))
"""Combinations for the slow run only, because a SPEL+ program takes long."""


@pytest.mark.invariant(4)
@pytest.mark.parametrize(
    ('profile', 'name'),
    quickly(
        [pair for pair in product(PROFILES, ROWS) if pair not in LONG][::3],
        product(PROFILES, ROWS),
    ),
)
async def test_refused_motion_and_enable_name_the_cause(profile: str, name: str) -> None:
    row = ROWS[name]
    async with robot_cell(profile=profile) as (robot, controller):
        here = robot.joints
        for event in row.events:
            controller.apply(event)
        await asyncio.sleep(1.5)  # time for braking and a STATUS
        near = here + 0.05
        for move in (lambda: robot.move_joints(near), lambda: robot.move_waypoints([near, here])):
            with pytest.raises(MotionError, match=row.move):
                await move()
        if profile not in NO_STREAMS:
            with pytest.raises(MotionError, match=row.move):
                robot.servo(near)
        if row.in_status or profile not in NO_REMOTE_ETHERNET:
            with pytest.raises(RobotError, match=row.enable) as refused:
                await robot.enable()
            assert str(refused.value).endswith(robot.status.remedy)
        else:  # the refusal has no reason
            with pytest.raises(RobotError, match=r'START_SERVOS: FAILURE: .* a safeguard door is'):
                await robot.enable()


@pytest.mark.parametrize('event', [Event.PAUSE, Event.STOP])
@pytest.mark.parametrize('profile', ['simulated', 'generic', 'fanuc', 'abb'])
async def test_paused_or_stopped_program_is_not_called_an_error(profile, event):
    async with robot_cell(profile=profile) as (robot, controller):
        controller.apply(event)
        await asyncio.sleep(0.5)
        expected = r'paused, or main is not running .*; continue at the controller, or start main'
        with pytest.raises(MotionError, match=expected):
            await robot.move_joints(robot.joints + 0.05)


@pytest.mark.invariant(4)
async def test_enable_starts_a_stopped_spel_program():
    """Stopping all tasks does not disable the arm, and enable() still restarts the program."""
    async with robot_cell(profile='spel') as (robot, controller):
        near = robot.joints + 0.05
        controller.apply(Event.STOP)
        await asyncio.sleep(0.5)
        expected = r'motion is not possible, error 2261 .*; start main, or call enable\(\)'
        assert robot.status.enabled
        with pytest.raises(MotionError, match=expected):
            await robot.move_joints(near)
        with pytest.raises(MotionError, match=expected):
            robot.servo(near)
        assert robot.status.remedy == 'start main, or call enable()'
        await robot.enable()
        assert robot.joints == pytest.approx(near - 0.05, abs=1e-3)
        await robot.move_joints(near)


async def test_enable_reports_that_main_does_not_run():
    async with robot_cell() as (robot, controller):
        controller.apply(Event.STOP)
        await asyncio.sleep(0.5)
        assert 'but the controller is paused, or main is not running' in await robot.enable()
        await robot.disable()
        assert 'but the controller reports that motion is not possible' in await robot.enable()


async def test_unexplained_rejection_is_reported_unchanged(monkeypatch):
    """The controller's flags may already be fine again, or unknown."""
    replies = []

    async def refuses(_self, ask, _action, _timeout):
        replies.append(await ask('GetStatus'))
        await ask('Nothing')

    async with robot_cell(enabled=False) as (robot, _):
        monkeypatch.setattr(RemoteEthernetMotors, '_execute', refuses)
        with pytest.raises(RobotError, match=r'Nothing: .*switch the motors on at the controller'):
            await robot.enable()
    assert replies
