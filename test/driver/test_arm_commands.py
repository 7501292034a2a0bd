# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Enable, disable, stop and reset against the simulated controller, and why they say no."""

import asyncio
import socket

import pytest
from support.driver_harness import (
    Harness,
    ScriptedController,
    answer,
    cell,
    pose,
    scripted_cell,
    simulated,
)
from support.event_loop import until
from support.sim_process import vacant_port

from epson_driver.driver import arm_commands
from epson_driver.driver.arm_commands import CommandError
from epson_driver.driver.inhibit import Cause, Purpose
from epson_driver.driver.outcome import End
from epson_driver.sim_controller.condition.states import Event
from epson_driver.sim_controller.faults.fault_kinds import parse
from epson_driver.sim_controller.network.servers import Ports
from epson_driver.simple_message import JointTrajPt


async def rejection(coroutine):
    """Return why a command could not be done, with the name of what helps."""
    with pytest.raises(CommandError) as caught:
        await coroutine
    return f'{caught.value}; {caught.value.remedy.name}'


# --- enable -----------------------------------------------------------------------------------


async def test_enable_switches_the_motors_on_and_opens_the_gate():
    async with cell(enabled=False) as (harness, controller):
        assert controller.status().drives_powered == 0
        assert 'motors are off' in harness.gate or 'not enabled' in harness.gate
        text = await harness.commands.enable()
        assert text == 'the arm is enabled'
        assert controller.status().drives_powered == 1
        assert harness.gate is None


async def test_enable_when_the_motors_are_on_already_needs_no_remote_port():
    async with cell(enabled=False, remote_port=0) as (harness, controller):
        controller.apply(Event.MOTORS_ON)
        await until(lambda: harness.driver.robot.status.drives_powered == 1)
        await harness.commands.enable()
        assert harness.gate is None


@pytest.mark.invariant(10)
async def test_inv10_a_second_driver_of_its_names_stops_the_arm_and_forbids_enable():
    async with cell() as (harness, _):
        driver, refused = harness.driver, 'a second driver has its names: the other; RENAME'
        goal = harness.submit(pose(0.5), step=5.0)
        await harness.until_moving()
        driver.namesakes = lambda: 'the other'
        driver.look_for_namesakes()
        assert 'a second driver has its names' in (await goal.end()).text
        assert await driver.stopper.wait(1.0)
        assert await harness.rests()
        assert await rejection(harness.commands.enable()) == refused
        now = asyncio.get_running_loop().time()
        assert driver.why_not(Purpose.REPORT, now).cause is Cause.SECOND_DRIVER
        driver.namesakes = str
        await harness.commands.enable()
        assert harness.gate is None
        driver.namesakes = iter(['', 'the other']).__next__  # found when the gate would open
        assert 'the other' in await rejection(harness.commands.enable())
        assert harness.gate is not None
        driver.namesakes = iter(['', 'the other']).__next__
        assert 'the other' in await rejection(harness.commands.enable())
        assert harness.gate is not None


@pytest.mark.invariant(10)
async def test_inv10_enable_waits_until_a_second_driver_would_be_known():
    async with cell(enabled=False) as (harness, _):
        driver = harness.driver
        driver.namesakes_known = asyncio.get_running_loop().time() + 2.0
        enabling = asyncio.create_task(harness.commands.enable())
        await asyncio.sleep(1.9)
        driver.namesakes = lambda: 'the other'
        assert 'the other' in await rejection(enabling)
        driver.namesakes = str
        driver.look_for_namesakes()
        driver.namesakes_known = asyncio.get_running_loop().time() + 2.0
        enabling = asyncio.create_task(harness.commands.enable())
        await asyncio.sleep(1.9)
        await harness.commands.disable()
        assert 'disabled' in await rejection(enabling)
        assert harness.gate is not None


async def test_enable_without_a_controller_names_the_link():
    port = vacant_port()
    async with Harness(Ports(port, port, 0, port)) as harness:
        text = await rejection(harness.commands.enable())
        assert f'the state link to 127.0.0.1:{port} is ' in text
        assert text.endswith('; CONNECT')


async def test_enable_without_a_motion_link_names_it():
    port = vacant_port()
    async with (
        simulated() as (_, ports),
        Harness(ports._replace(motion=port)) as harness,
    ):
        await until(lambda: harness.driver.robot.status is not None)
        text = await rejection(harness.commands.enable())
        assert f'the motion link to 127.0.0.1:{port}' in text


async def test_enable_with_the_estop_pressed_or_latched():
    async with cell(enabled=False) as (harness, controller):
        controller.apply(Event.ESTOP_PRESS)
        await until(lambda: harness.driver.robot.status.e_stopped == 1)
        assert 'E-stop is pressed or not reset' in await rejection(harness.commands.enable())
        controller.apply(Event.ESTOP_RELEASE)
        assert 'RELEASE_ESTOP' in await rejection(harness.commands.enable())
        assert harness.gate is not None
        await harness.commands.reset_error()  # and the status shows it
        await harness.commands.enable()
        assert harness.gate is None


async def test_a_reset_waits_for_an_arm_that_brakes():
    async with cell() as (harness, controller):
        harness.submit(pose(1.0))
        await until(lambda: harness.driver.robot.status.in_motion == 1)
        controller.apply(Event.ESTOP_PRESS)
        controller.apply(Event.ESTOP_RELEASE)
        await until(lambda: harness.gate is not None)
        assert controller.in_motion
        await harness.commands.reset_error()
        assert controller.error_number == 0


async def test_enable_goes_by_the_next_status_not_by_the_last():
    async with cell() as (harness, controller):
        assert harness.driver.robot.status.drives_powered == 1
        controller.apply(Event.MOTORS_OFF)  # the driver does not know it yet
        await harness.commands.enable()
        assert controller.status().drives_powered == 1
        assert harness.gate is None
        assert (await harness.submit(pose(0.1)).end()).end is End.SUCCEEDED


async def test_enable_in_error_names_the_number_and_reset_clears_it():
    async with cell() as (harness, _):
        harness.driver.motion_link.post(JointTrajPt(0, (9.0,) * 10), lambda *_: None)
        await until(lambda: harness.driver.robot.status.in_error == 1)
        assert '4001' in harness.gate
        text = await rejection(harness.commands.enable())
        assert 'in error 4001' in text
        assert text.endswith('; RESET')
        assert 'until it is enabled' in await harness.commands.reset_error()
        assert harness.driver.robot.status.in_error == 0
        assert harness.gate is not None  # a reset alone moves nothing
        await harness.commands.enable()


async def test_enable_with_the_motors_off_and_no_remote_port_says_what_to_do():
    async with cell(enabled=False, remote_port=0) as (harness, controller):
        text = await rejection(harness.commands.enable())
        assert 'the port of Remote Ethernet is 0' in text
        assert 'switch the motors on at the controller' in text
        assert controller.status().drives_powered == 0
        assert harness.gate is not None


async def test_enable_with_a_remote_port_where_nobody_listens():
    port = vacant_port()
    async with cell(enabled=False, remote_port=port) as (harness, _):
        text = await rejection(harness.commands.enable())
        assert f'remote port 127.0.0.1:{port}' in text
        assert 'switch the motors on at the controller' in text


async def test_enable_with_a_remote_port_that_does_not_answer(monkeypatch):
    monkeypatch.setattr(arm_commands, 'ANSWER_TIMEOUT_S', 0.1)

    with socket.create_server(('127.0.0.1', 0)) as deaf:
        port = deaf.getsockname()[1]
        async with cell(enabled=False, remote_port=port) as (harness, _):
            text = await rejection(harness.commands.enable())
            assert f'remote port 127.0.0.1:{port}: no answer: switch the motors on' in text


async def test_enable_that_the_remote_port_refuses():
    async with cell(enabled=False) as (harness, controller):
        controller.apply(Event.PAUSE)
        text = await rejection(harness.commands.enable())
        assert text.startswith('the tasks are paused')
        assert harness.gate is not None


async def test_enable_without_any_status(monkeypatch):
    monkeypatch.setattr(arm_commands, 'ANSWER_TIMEOUT_S', 0.1)

    async with ScriptedController() as scripted:
        scripted.shows_status = False
        async with Harness(scripted.ports) as harness:
            await until(lambda: harness.driver.robot.sample is not None)
            await until(lambda: harness.driver.motion_link.connected)
            assert 'no STATUS' in await rejection(harness.commands.enable())
            assert harness.gate is not None


async def test_enable_twice_is_no_error():
    async with cell() as (harness, _):
        await harness.commands.enable()
        assert harness.gate is None


# --- stop -------------------------------------------------------------------------------------


async def test_stop_without_a_goal_is_acknowledged_by_the_controller():
    async with cell() as (harness, _):
        text = await harness.commands.stop()
        assert text == 'no motion was running; the controller acknowledged STOP'
        assert harness.gate is None


@pytest.mark.invariant(3)
async def test_inv3_stop_ends_the_goal_when_the_arm_stands_and_the_next_one_works():
    """docs/invariants.md, 3."""
    async with cell() as (harness, _):
        goal = harness.submit(pose(1.0))
        await harness.until_moving()
        text = await harness.commands.stop()
        assert 'stopped on request; the arm stands' in text
        assert goal.outcome.end is End.ABORTED
        assert goal.outcome.text in text
        assert await harness.rests()
        assert harness.at[0] < 0.9
        following = harness.submit(pose(0.0))
        assert (await following.end()).end is End.SUCCEEDED


async def test_stop_without_a_link():
    port = vacant_port()
    async with Harness(Ports(port, port, 0, 0)) as harness:
        assert 'STOP could not be sent' in await rejection(harness.commands.stop())


@pytest.mark.parametrize(
    ('reply', 'text'), [(b'', 'no reply to STOP'), (answer(2), 'refused STOP')]
)
async def test_stop_that_the_controller_does_not_obey(monkeypatch, reply, text):
    monkeypatch.setattr(arm_commands, 'ANSWER_TIMEOUT_S', 0.1)

    async with scripted_cell(lambda _: reply, enabled=False) as (harness, scripted):
        assert text in await rejection(harness.commands.stop())
        assert scripted.received == [-4]


async def test_stop_that_finds_no_standstill(monkeypatch):
    monkeypatch.setattr(arm_commands, 'ANSWER_TIMEOUT_S', 0.2)

    async with scripted_cell(lambda _: b'') as (harness, _):
        harness.submit(pose(0.5))
        assert 'no standstill' in await rejection(harness.commands.stop())


async def test_stop_ends_a_goal_that_waits_too():
    async with cell() as (harness, _):
        first = harness.submit(pose(1.0))
        await harness.until_moving()
        second = harness.submit(pose(0.2))
        await harness.commands.stop()
        assert 'stopped on request before it could start' in second.outcome.text
        assert first.outcome.end is End.ABORTED
        assert await harness.rests()
        assert not harness.driver.goal_queue.busy


@pytest.mark.invariant(4)
async def test_inv4_a_goal_that_comes_before_the_stop_is_answered_never_begins():
    """It may have been sent before, and waited: ROS tells neither when nor in which order."""
    async with cell() as (harness, _):
        stopping = asyncio.create_task(harness.commands.stop())
        await asyncio.sleep(0.0)
        goal = harness.submit(pose(0.2))
        assert goal.outcome.text == 'stopped on request before it could start'
        await stopping
        assert await harness.rests()
        assert (await harness.submit(pose(0.1)).end()).end is End.SUCCEEDED


# --- disable, reset ---------------------------------------------------------------------------


async def test_disable_stops_the_arm_then_switches_the_motors_off():
    async with cell() as (harness, controller):
        goal = harness.submit(pose(1.0))
        await harness.until_moving()
        text = await harness.commands.disable()
        assert 'motors are off' in text
        assert goal.outcome.text == 'disabled on request; the arm stands'
        await until(lambda: controller.status().drives_powered == 0)
        assert harness.gate == 'disabled on request'
        refused = harness.submit(pose(0.5))
        assert 'disabled on request' in refused.outcome.text
        await until(lambda: harness.driver.robot.status.drives_powered == 0)
        await harness.commands.enable()
        assert (await harness.submit(pose(0.1)).end()).end is End.SUCCEEDED


async def test_disable_accepts_no_goal_while_the_arm_stops():
    async with cell() as (harness, _):
        harness.submit(pose(1.0))
        await harness.until_moving()
        disabling = asyncio.create_task(harness.commands.disable())
        await asyncio.sleep(0)
        assert 'not enabled' in harness.submit(pose(0.5)).outcome.text
        await disabling


async def test_disable_without_a_remote_port_says_that_the_motors_stay():
    async with cell(enabled=False, remote_port=0) as (harness, controller):
        controller.apply(Event.MOTORS_ON)
        await until(lambda: harness.driver.robot.status.drives_powered == 1)
        await harness.commands.enable()
        assert 'motors were left as they are' in await harness.commands.disable()
        assert harness.gate == 'disabled on request'
        assert controller.status().drives_powered == 1


async def test_disable_closes_the_gate_even_if_the_motors_cannot_be_switched():
    async with cell(enabled=False, remote_port=vacant_port()) as (harness, controller):
        controller.apply(Event.MOTORS_ON)
        await until(lambda: harness.driver.robot.status.drives_powered == 1)
        await harness.commands.enable()
        text = await rejection(harness.commands.disable())
        assert 'switch the motors off at the controller' in text
        assert harness.gate == 'disabled on request'


async def test_reset_error_without_a_remote_port():
    async with cell(enabled=False, remote_port=0) as (harness, _):
        text = await rejection(harness.commands.reset_error())
        assert 'reset the error at the controller' in text


async def test_a_reset_that_no_status_shows_is_no_success(monkeypatch):
    monkeypatch.setattr(arm_commands, 'ANSWER_TIMEOUT_S', 0.3)

    async with cell() as (harness, controller):
        controller.faults.start(parse('cut port=state for=5'))
        await until(lambda: harness.driver.robot.status is None)
        text = await rejection(harness.commands.reset_error())
        assert 'took the reset, but no STATUS shows' in text


async def test_reset_error_while_the_estop_is_pressed_is_refused():
    async with cell(enabled=False) as (harness, controller):
        controller.apply(Event.ESTOP_PRESS)
        text = await rejection(harness.commands.reset_error())
        assert text.startswith('the E-stop is pressed or not reset')
