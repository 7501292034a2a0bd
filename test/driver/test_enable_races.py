# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""An `~/enable` on its way against what closes the gate (docs/invariants.md, 4).

Real sockets and the simulated controller; its remote port takes a random time to switch the motors
on, and what closes the gate comes at a random moment meanwhile.
"""

import asyncio
import random
from dataclasses import replace

import pytest
from support.driver_harness import Harness, cell, pose, simulated
from support.event_loop import PATIENCE, now, run, until
from support.slow_remote import SlowRemote

from epson_driver.driver import arm_commands
from epson_driver.driver.arm_commands import CommandError
from epson_driver.profiles import load_controller_profile
from epson_driver.sim_controller.condition.states import Event
from epson_driver.sim_controller.faults.fault_kinds import parse

pytestmark = pytest.mark.invariant(4)

SIMULATED = load_controller_profile('simulated')
QUICK = replace(SIMULATED, state=replace(SIMULATED.state, joint_positions_per_status=1))
"""A STATUS every 10 ms: more races per second."""


async def enable(harness):
    """Return what ~/enable answers, and whether it is yes."""
    try:
        return True, await harness.commands.enable()
    except CommandError as error:
        return False, str(error)


async def seen(harness, **fields):
    """Wait until a STATUS that is yet to come says so."""
    asked = now()
    await until(
        lambda: (
            harness.driver.robot.status is not None
            and harness.driver.robot.status_time > asked
            and all(getattr(harness.driver.robot.status, k) == v for k, v in fields.items())
        )
    )


# --- what closes the gate ---------------------------------------------------------------------


async def disabled(harness, controller, chance):
    answer = await harness.commands.disable()
    assert 'the motors are off' in answer
    assert controller.status().drives_powered == 0


async def estop_comes_and_goes(harness, controller, chance):
    controller.apply(Event.ESTOP_PRESS)
    await seen(harness, e_stopped=1)
    controller.apply(Event.ESTOP_RELEASE)
    await asyncio.sleep(chance.uniform(0.0, 0.02))
    controller.apply(Event.RESET)
    await seen(harness, e_stopped=0)


async def links_are_cut(harness, controller, chance):
    links = (harness.driver.state_link, harness.driver.motion_link)
    connections = [link.statistics.connections for link in links]
    controller.faults.start(parse('cut port=all for=0.01'))
    await until(
        lambda: all(
            link.connected and link.statistics.connections > before
            for link, before in zip(links, connections, strict=True)
        )
    )


async def error_comes_and_goes(harness, controller, chance):
    controller.servo_error(1)
    await seen(harness, in_error=1)
    controller.apply(Event.RESET)
    await seen(harness, in_error=0)


async def shut_down(harness, controller, chance):
    await harness.driver.shut_down()


CLOSING = (disabled, estop_comes_and_goes, links_are_cut, error_comes_and_goes, shut_down)


async def race(harness, controller, remote, closing, chance):
    """Let ~/enable and something that closes the gate run against each other, once.

    Whatever the order in which they get through: what closes it was later than ~/enable.
    """
    # a command that a canceled ~/enable has left on its way would switch them on again
    await until(lambda: not harness.driver.motors.busy and harness.driver.motion_link.connected)
    controller.apply(Event.MOTORS_OFF)
    await seen(harness, drives_powered=0)
    remote.delay = chance.uniform(0.0, 0.04)
    asking = asyncio.create_task(enable(harness))
    await asyncio.sleep(chance.uniform(0.0, 0.06))
    await closing(harness, controller, chance)
    opened_before = asking.done() and asking.result()[0]
    success, text = await asking
    assert harness.gate is not None, f'armed after {closing.__name__}: ~/enable said {text}'
    if not opened_before:
        assert not success, text
        assert text
    goal = harness.submit(pose(0.1), start=pose())
    assert 'not enabled' in goal.outcome.text
    return opened_before


async def races(count, closings, seed):
    """Run `count` races; return how many of them ~/enable had won."""
    chance = random.Random(seed)
    won = 0
    async with (
        simulated(profile=QUICK) as (controller, ports),
        SlowRemote(controller, 0.0) as far,
        Harness(ports._replace(remote=far.port)) as harness,
    ):
        await harness.ready()
        for index in range(count):
            closing = closings[index % len(closings)]
            async with asyncio.timeout(PATIENCE):
                won += await race(harness, controller, far, closing, chance)
        await until(lambda: harness.driver.motion_link.connected)
        await seen(harness, e_stopped=0, in_error=0)
        assert await enable(harness) == (True, 'the arm is enabled')  # and it still works
    return won


@pytest.mark.parametrize('closing', CLOSING)
def test_inv4_what_closes_the_gate_is_not_overtaken_by_an_enable_on_its_way(closing):
    """docs/invariants.md, 4."""
    run(races(6, [closing], 20261122), 12.0)


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_inv4_in_1000_races_no_enable_on_its_way_arms_what_was_closed(record_property):
    """docs/invariants.md, 4."""

    async def scenario():
        won = await races(1000, CLOSING, 1)
        record_property('enabled before it was closed', won)
        print(f'1000 races, none armed; ~/enable got through before in {won}')

    run(scenario(), 3500.0)


# --- one by one -------------------------------------------------------------------------------


async def pending(harness, remote):
    """Begin an ~/enable, and wait until it has the motors switched on."""
    remote.told.clear()
    asking = asyncio.create_task(enable(harness))
    await remote.told.wait()
    return asking


def slow_cell(scenario, delay=0.5, **options):
    """Run a scenario with a driver, a controller, and its remote port that takes its time."""

    async def whole():
        async with (
            simulated(profile=QUICK) as (controller, ports),
            SlowRemote(controller, delay) as far,
            Harness(ports._replace(remote=far.port), **options) as harness,
        ):
            await harness.ready()
            await scenario(harness, controller, far)

    run(whole())


def test_inv4_disable_is_obeyed_after_the_enable_that_it_overtakes():
    """The command that switches the motors on is on its way: they go off after it."""

    async def scenario(harness, controller, far):
        asking = await pending(harness, far)
        disabling = asyncio.create_task(harness.commands.disable())
        success, text = await asking
        assert not success
        assert 'disabled on request while the arm was being enabled' in text
        assert far.obeyed == []  # it was told at once
        assert await disabling == 'the arm is disabled and the motors are off'
        assert far.obeyed == ['SetMotorsOn', 'SetMotorsOff']
        assert controller.status().drives_powered == 0

    slow_cell(scenario)


@pytest.mark.invariant(9)
def test_inv9_disable_says_that_the_motors_may_come_on_yet(monkeypatch):
    """docs/invariants.md, 9: the controller does not answer in time that it switch them on."""

    async def scenario(harness, controller, far):
        asking = await pending(harness, far)
        await asking
        far.delay = 0.0
        assert 'has not answered an earlier command' in await harness.commands.disable()

    monkeypatch.setattr(arm_commands, 'ANSWER_TIMEOUT_S', 0.5)
    slow_cell(scenario, delay=1.5)


def test_inv4_an_enable_that_comes_while_the_arm_is_being_disabled_is_refused():
    async def scenario(harness, controller, far):
        controller.apply(Event.MOTORS_ON)
        await seen(harness, drives_powered=1)
        await harness.commands.enable()
        disabling = asyncio.create_task(harness.commands.disable())
        await asyncio.sleep(0)
        success, text = await enable(harness)
        assert not success
        assert 'still being disabled' in text
        await disabling
        assert harness.gate == 'disabled on request'

    slow_cell(scenario, delay=0.1)


def test_inv4_an_estop_that_comes_and_goes_cancels_an_enable_that_waits_for_the_motors():
    async def scenario(harness, controller, far):
        asking = await pending(harness, far)
        controller.apply(Event.ESTOP_PRESS)
        success, text = await asking
        assert not success
        assert 'E-stop is pressed or not reset' in text
        controller.apply(Event.ESTOP_RELEASE)
        controller.apply(Event.RESET)
        await until(lambda: far.obeyed == ['SetMotorsOn'])
        await seen(harness, drives_powered=1, e_stopped=0)
        assert harness.gate is not None

    slow_cell(scenario)


def test_inv4_motors_that_go_off_again_cancel_an_enable():
    """They were seen on, and no link is as slow as the second command to switch them on."""

    async def scenario(harness, controller, far):
        asking = await pending(harness, far)
        controller.apply(Event.MOTORS_ON)  # by hand, before the driver's command gets through
        await seen(harness, drives_powered=1)
        controller.apply(Event.MOTORS_OFF)
        success, text = await asking
        assert not success
        assert 'the motors are off while the arm was being enabled' in text
        await until(lambda: far.obeyed == ['SetMotorsOn'])
        await seen(harness, drives_powered=1)
        assert harness.gate is not None

    slow_cell(scenario)


def test_inv4_motors_that_a_door_took_are_said_with_the_door():
    async def scenario():
        async with cell(profile='rc700a', enabled=False) as (harness, controller):
            asking = asyncio.create_task(enable(harness))
            await until(lambda: controller.status().drives_powered)
            controller.apply(Event.DOOR_OPEN)
            success, text = await asking
            assert not success
            assert text == 'the safeguard door is open'

    run(scenario())


def test_inv4_two_enables_at_once_switch_the_motors_on_once():
    async def scenario(harness, controller, far):
        first = await pending(harness, far)
        second = asyncio.create_task(enable(harness))
        assert await first == await second == (True, 'the arm is enabled')
        assert far.obeyed == ['SetMotorsOn']
        assert harness.gate is None

    slow_cell(scenario, delay=0.1)


def test_inv4_disable_cancels_all_enables_and_those_that_wait_give_no_command():
    async def scenario(harness, controller, far):
        first = await pending(harness, far)
        second = asyncio.create_task(enable(harness))
        await asyncio.sleep(0)
        await harness.commands.disable()
        for asking in (first, second):
            success, text = await asking
            assert not success
            assert 'disabled on request' in text
        assert far.obeyed == ['SetMotorsOn', 'SetMotorsOff']

    slow_cell(scenario, delay=0.1)


def test_a_reset_waits_for_the_command_before_it_and_does_not_disturb_an_enable():
    async def scenario(harness, controller, far):
        asking = await pending(harness, far)
        await harness.commands.reset_error()
        assert far.obeyed == ['SetMotorsOn', 'Reset']
        assert await asking == (True, 'the arm is enabled')

    slow_cell(scenario, delay=0.1)


def test_an_enable_that_nobody_waits_for_any_more_opens_nothing():
    async def scenario(harness, controller, far):
        asking = await pending(harness, far)
        asking.cancel()
        with pytest.raises(asyncio.CancelledError):
            await asking
        await seen(harness, drives_powered=1)
        assert harness.gate is not None
        assert await enable(harness) == (True, 'the arm is enabled')

    slow_cell(scenario, delay=0.1)


async def test_inv4_a_needless_enable_does_not_switch_motors_on_that_went_off_under_a_goal():
    async with cell() as (harness, controller):
        goal = harness.submit(pose(1.0))
        await harness.until_moving()
        asking = asyncio.create_task(enable(harness))
        await asyncio.sleep(0)
        controller.apply(Event.MOTORS_OFF)
        await goal.end()
        await asking
        await seen(harness, drives_powered=0)
        assert controller.status().drives_powered == 0
        assert harness.gate is not None
