# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Enable, disable, stop and reset with the simulated controller, and their refusals."""

import asyncio

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
    """Return why a command was refused, with the name of the remedy."""
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


async def test_enable_with_motors_on_needs_no_remote_port():
    async with cell(enabled=False, remote_port=0) as (harness, controller):
        controller.apply(Event.MOTORS_ON)
        await until(lambda: harness.driver.robot.status.drives_powered == 1)
        await harness.commands.enable()
        assert harness.gate is None


@pytest.mark.invariant(10)
async def test_inv10_second_driver_with_the_same_names_stops_and_prevents_enable():
    async with cell() as (harness, _):
        driver, refused = harness.driver, 'a second driver uses the same names: the other; RENAME'
        goal = harness.submit(pose(0.5), step=5.0)
        await harness.until_moving()
        driver.second_driver = lambda: 'the other'
        driver.check_second_driver()
        assert 'a second driver uses the same names' in (await goal.end()).text
        assert await driver.stopper.wait(1.0)
        assert await harness.rests()
        assert await rejection(harness.commands.enable()) == refused
        now = asyncio.get_running_loop().time()
        assert driver.why_not(Purpose.REPORT, now).cause is Cause.SECOND_DRIVER
        driver.second_driver = str
        await harness.commands.enable()
        assert harness.gate is None
        driver.second_driver = iter(['', 'the other']).__next__  # found just before the gate opens
        assert 'the other' in await rejection(harness.commands.enable())
        assert harness.gate is not None
        driver.second_driver = iter(['', 'the other']).__next__
        assert 'the other' in await rejection(harness.commands.enable())
        assert harness.gate is not None


@pytest.mark.invariant(10)
async def test_inv10_enable_waits_until_a_second_driver_is_discovered():
    async with cell(enabled=False) as (harness, _):
        driver = harness.driver
        driver.second_driver_known = asyncio.get_running_loop().time() + 2.0
        enabling = asyncio.create_task(harness.commands.enable())
        await asyncio.sleep(1.9)
        driver.second_driver = lambda: 'the other'
        assert 'the other' in await rejection(enabling)
        driver.second_driver = str
        driver.check_second_driver()
        driver.second_driver_known = asyncio.get_running_loop().time() + 2.0
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


async def test_enable_beside_another_client_names_it():
    async with simulated() as (_, ports):
        _, other = await asyncio.open_connection('127.0.0.1', ports.motion)
        async with Harness(ports) as harness:
            motion = harness.driver.motion_link
            await until(lambda: motion.attempt > 3 and not motion.connected)
            text = await rejection(harness.commands.enable())
            assert 'immediately: another client is connected, or its program is' in text
            assert text.endswith('; END_CLIENT')
        other.close()


async def test_enable_names_no_other_client_of_a_silent_controller():
    async with simulated() as (_, ports):
        silent = await asyncio.start_server(lambda reader, _: reader.read(), '127.0.0.1', 0)
        port = silent.sockets[0].getsockname()[1]
        async with Harness(ports._replace(state=port), state_timeout=0.3) as harness:
            link = harness.driver.state_link
            await until(lambda: link.attempt > 3 and not link.connected)
            assert (await rejection(harness.commands.enable())).endswith('; CONNECT')
        silent.close()


async def test_enable_with_the_estop_pressed_or_latched_is_refused():
    async with cell(enabled=False) as (harness, controller):
        controller.apply(Event.ESTOP_PRESS)
        await until(lambda: harness.driver.robot.status.e_stopped == 1)
        assert 'E-stop is pressed or not reset' in await rejection(harness.commands.enable())
        controller.apply(Event.ESTOP_RELEASE)
        assert 'RELEASE_ESTOP' in await rejection(harness.commands.enable())
        assert harness.gate is not None
        await harness.commands.reset_error()
        await harness.commands.enable()
        assert harness.gate is None


async def test_reset_waits_until_the_arm_rests():
    async with cell() as (harness, controller):
        harness.submit(pose(1.0))
        await until(lambda: harness.driver.robot.status.in_motion == 1)
        controller.apply(Event.ESTOP_PRESS)
        controller.apply(Event.ESTOP_RELEASE)
        await until(lambda: harness.gate is not None)
        assert controller.in_motion
        await harness.commands.reset_error()
        assert controller.error_number == 0


async def test_enable_waits_for_a_new_status():
    async with cell() as (harness, controller):
        assert harness.driver.robot.status.drives_powered == 1
        controller.apply(Event.MOTORS_OFF)  # not received by the driver yet
        await harness.commands.enable()
        assert controller.status().drives_powered == 1
        assert harness.gate is None
        assert (await harness.submit(pose(0.1)).end()).end is End.SUCCEEDED


async def test_enable_during_an_error_names_its_number_and_reset_clears_it():
    async with cell() as (harness, _):
        harness.driver.motion_link.post(JointTrajPt(0, (9.0,) * 10), lambda *_: None)
        await until(lambda: harness.driver.robot.status.in_error == 1)
        assert '4001' in harness.gate
        text = await rejection(harness.commands.enable())
        assert 'in error 4001' in text
        assert text.endswith('; RESET')
        assert 'until it is enabled' in await harness.commands.reset_error()
        assert harness.driver.robot.status.in_error == 0
        assert harness.gate is not None  # a reset does not enable
        await harness.commands.enable()
        assert 'the arm stays enabled' in await harness.commands.reset_error()
        assert harness.gate is None


async def test_enable_with_motors_off_and_no_remote_port_names_the_remedy():
    async with cell(enabled=False, remote_port=0) as (harness, controller):
        text = await rejection(harness.commands.enable())
        assert 'the port of Remote Ethernet is 0' in text
        assert 'switch the motors on at the controller' in text
        assert controller.status().drives_powered == 0
        assert harness.gate is not None


async def test_enable_with_a_closed_remote_port_names_the_port():
    port = vacant_port()
    async with cell(enabled=False, remote_port=port) as (harness, _):
        text = await rejection(harness.commands.enable())
        assert f'remote port 127.0.0.1:{port}' in text
        assert 'switch the motors on at the controller' in text


async def test_enable_refused_by_the_remote_port_has_its_reason():
    async with cell(enabled=False) as (harness, controller):
        controller.apply(Event.PAUSE)
        text = await rejection(harness.commands.enable())
        assert text.startswith('the tasks are paused')
        assert harness.gate is not None


async def test_enable_without_a_status_is_refused(monkeypatch):
    monkeypatch.setattr(arm_commands, 'ANSWER_TIMEOUT_S', 0.1)

    async with ScriptedController() as scripted:
        scripted.shows_status = False
        async with Harness(scripted.ports) as harness:
            await until(lambda: harness.driver.robot.sample is not None)
            await until(lambda: harness.driver.motion_link.connected)
            assert 'no STATUS' in await rejection(harness.commands.enable())
            assert harness.gate is not None


# --- stop -------------------------------------------------------------------------------------


@pytest.mark.invariant(3)
async def test_inv3_stop_ends_the_goal_at_rest_and_the_next_goal_succeeds():
    async with cell() as (harness, _):
        goal = harness.submit(pose(1.0))
        await harness.until_moving()
        text = await harness.commands.stop()
        assert 'stopped on request, the arm is at rest' in text
        assert goal.outcome.end is End.ABORTED
        assert goal.outcome.text in text
        assert await harness.rests()
        assert harness.at[0] < 0.9
        following = harness.submit(pose(0.0))
        assert (await following.end()).end is End.SUCCEEDED


async def test_stop_without_a_link_is_refused():
    port = vacant_port()
    async with Harness(Ports(port, port, 0, 0)) as harness:
        assert 'STOP could not be sent' in await rejection(harness.commands.stop())


@pytest.mark.parametrize(
    ('reply', 'text'), [(b'', 'no reply to STOP'), (answer(2), 'refused STOP')]
)
async def test_stop_refused_or_unanswered_by_the_controller_fails(monkeypatch, reply, text):
    monkeypatch.setattr(arm_commands, 'ANSWER_TIMEOUT_S', 0.1)

    async with scripted_cell(lambda _: reply, enabled=False) as (harness, scripted):
        assert text in await rejection(harness.commands.stop())
        assert scripted.received == [-4]


async def test_stop_ends_the_running_and_the_waiting_goal():
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
async def test_inv4_goal_received_before_the_stop_reply_never_starts():
    """It may have been sent before the stop, because ROS gives neither time nor order."""
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
        assert goal.outcome.text == 'disabled on request, the arm is at rest'
        await until(lambda: controller.status().drives_powered == 0)
        assert harness.gate == 'disabled on request'
        refused = harness.submit(pose(0.5))
        assert 'disabled on request' in refused.outcome.text
        await until(lambda: harness.driver.robot.status.drives_powered == 0)
        await harness.commands.enable()
        assert (await harness.submit(pose(0.1)).end()).end is End.SUCCEEDED


async def test_disable_refuses_goals_while_the_arm_stops():
    async with cell() as (harness, _):
        harness.submit(pose(1.0))
        await harness.until_moving()
        disabling = asyncio.create_task(harness.commands.disable())
        await asyncio.sleep(0)
        assert 'not enabled' in harness.submit(pose(0.5)).outcome.text
        await disabling


async def test_disable_without_a_remote_port_reports_motors_unchanged():
    async with cell(enabled=False, remote_port=0) as (harness, controller):
        controller.apply(Event.MOTORS_ON)
        await until(lambda: harness.driver.robot.status.drives_powered == 1)
        await harness.commands.enable()
        assert 'the motors are unchanged' in await harness.commands.disable()
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


async def test_reset_without_a_new_status_fails(monkeypatch):
    monkeypatch.setattr(arm_commands, 'ANSWER_TIMEOUT_S', 0.3)

    async with cell() as (harness, controller):
        controller.faults.start(parse('cut port=state for=5'))
        await until(lambda: harness.driver.robot.status is None)
        text = await rejection(harness.commands.reset_error())
        assert 'accepted the reset, but STATUS still shows' in text


async def test_reset_error_while_the_estop_is_pressed_is_refused():
    async with cell(enabled=False) as (harness, controller):
        controller.apply(Event.ESTOP_PRESS)
        text = await rejection(harness.commands.reset_error())
        assert text.startswith('the E-stop is pressed or not reset')
