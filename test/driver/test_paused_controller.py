# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Goals that come while the controller is paused, and those that run then, in every delivery."""

import asyncio
from dataclasses import replace

import numpy as np
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

from epson_driver.driver.delivery.delivery_factory import delivery_rules
from epson_driver.driver.outcome import End, ErrorCode
from epson_driver.driver.remedy import Remedy
from epson_driver.profiles import load_controller_profile
from epson_driver.setup.setup import profile_defaults
from epson_driver.sim_controller.condition.states import Event

POSSIBLE = (1, 0, 0, 0, 0, 2, 1)
NOT_POSSIBLE = (1, 0, 0, 0, 0, 2, 0)
MAIN_ENDED = (1, 0, 2261, 0, 0, 2, 0)
UNKNOWN = (1, 0, 0, 0, 0, 2, -1)
DELIVERIES = ('simulated', 'abb', 'motoman')


def possible(harness, value):
    return (status := harness.driver.robot.status) is not None and status.motion_possible == value


def long_queue(name):
    """Return the profile of that name with room for all points of a goal.

    A Motoman refuses those that come in a pause, and the goal ends.
    """
    profile = load_controller_profile(name)
    return replace(profile, motion=replace(profile.motion, pending_limit=1000))


def as_profile(name):
    """Return what a profile sets of a driver's configuration."""
    profile = load_controller_profile(name)
    defaults = profile_defaults(profile)
    rules = delivery_rules(profile, defaults['interface'], defaults['point_message'])
    return {'delivery': rules, 'usual_byte_order': profile.byte_order}


async def tell(harness, scripted, status):
    """Let the scripted controller report a status, and the driver see it."""
    scripted.status = status
    await until(lambda: possible(harness, status[-1]))


# --- a goal that comes ------------------------------------------------------------------------


async def test_a_goal_that_comes_in_a_pause_is_refused_at_once_and_the_next_one_runs():
    async with cell() as (harness, controller):
        controller.apply(Event.PAUSE)
        await until(lambda: possible(harness, 0))
        sent = harness.driver.motion_link.statistics.frames_sent
        goal = harness.submit(pose(0.2))
        assert goal.outcome.end is End.ABORTED
        assert goal.outcome.code is ErrorCode.INVALID_GOAL
        assert goal.outcome.text.startswith('the controller is paused')
        assert goal.outcome.remedy is Remedy.CONTINUE
        assert harness.driver.motion_link.statistics.frames_sent == sent
        assert harness.gate is None
        controller.apply(Event.CONTINUE)
        await until(lambda: possible(harness, 1))
        assert (await harness.submit(pose(0.2)).end()).end is End.SUCCEEDED


async def test_a_goal_that_comes_in_a_pause_leaves_the_one_that_waits():
    async with cell() as (harness, controller):
        waits = harness.submit(pose(0.5))
        await harness.until_moving()
        controller.apply(Event.PAUSE)
        await until(lambda: waits.handle.execution.paused)
        assert 'paused' in harness.submit(pose(0.0)).outcome.text
        assert not waits.outcomes
        controller.apply(Event.CONTINUE)
        assert (await waits.end()).end is End.SUCCEEDED


@pytest.mark.parametrize('never', [NOT_POSSIBLE, UNKNOWN], ids=['always no', 'not told'])
async def test_a_controller_that_never_says_yes_gets_its_goals(never):
    async with ScriptedController() as scripted, Harness(scripted.ports) as harness:
        scripted.status = never
        await harness.ready()
        await until(lambda: possible(harness, never[-1]))
        await harness.commands.enable()
        goal = harness.submit(pose(0.1))
        await until(lambda: scripted.received)
        harness.driver.goal_queue.cancel(goal.handle)
        await goal.end()


async def test_only_what_was_said_since_the_arm_was_enabled_counts():
    async with scripted_cell() as (harness, scripted):
        await tell(harness, scripted, POSSIBLE)
        await tell(harness, scripted, NOT_POSSIBLE)
        await harness.commands.enable()  # it is enabled already: that changes nothing
        assert 'paused' in harness.submit(pose(0.1)).outcome.text
        await harness.commands.disable()
        await harness.commands.enable()
        goal = harness.submit(pose(0.1))
        assert not goal.outcomes
        harness.driver.goal_queue.cancel(goal.handle)
        await goal.end()


async def test_an_error_without_a_reason_to_close_the_gate_is_no_pause():
    async with scripted_cell() as (harness, scripted):
        await tell(harness, scripted, (1, 0, 4031, -1, 0, 2, 0))
        assert not harness.driver.robot.paused


@pytest.mark.invariant(4)
async def test_inv4_a_goal_ends_with_the_controllers_program_not_when_that_runs_again():
    """What is still under way to it would move the arm when a person has started it again."""
    async with scripted_cell(lambda number: answer(1, number) if number < 0 else b'') as (
        harness,
        scripted,
    ):
        await tell(harness, scripted, POSSIBLE)
        goal = harness.submit(pose(0.5))
        await until(lambda: scripted.received)
        await tell(harness, scripted, MAIN_ENDED)
        assert (await goal.end()).end is End.ABORTED
        assert 'error 2261' in goal.outcome.text
        await tell(harness, scripted, POSSIBLE)
        assert 'error 2261' in harness.gate
        assert 'not enabled' in harness.submit(pose(0.1)).outcome.text


# --- a goal that runs -------------------------------------------------------------------------


@pytest.mark.parametrize('name', DELIVERIES)
async def test_a_running_goal_waits_for_a_paused_controller_in_every_delivery(name):
    async with (
        simulated(profile=long_queue(name)) as (controller, ports),
        Harness(ports, **as_profile(name)) as harness,
    ):
        await harness.ready()
        await harness.commands.enable()
        steps = [pose(0.1 * step) for step in range(1, 9)]
        goal = harness.submit(*steps, step=0.2)
        await harness.until_moving()
        controller.apply(Event.PAUSE)
        await until(lambda: goal.handle.execution.paused)
        assert goal.handle.execution.speed(0.0) == 0.0
        plan_time = goal.handle.execution.desired[0]
        here = harness.at
        assert here[0] < 0.75
        await asyncio.sleep(1.2)  # longer than an arm may stand beside its goal
        assert not goal.outcomes
        assert goal.handle.execution.desired[0] == plan_time
        np.testing.assert_allclose(harness.at, here, atol=1e-3)
        controller.apply(Event.CONTINUE)
        assert (await goal.end()).end is End.SUCCEEDED
        np.testing.assert_allclose(harness.at, steps[-1], atol=1e-3)


@pytest.mark.parametrize('name', DELIVERIES)
async def test_a_goal_that_waits_for_a_paused_controller_can_be_canceled_in_every_delivery(name):
    async with (
        simulated(profile=long_queue(name)) as (controller, ports),
        Harness(ports, **as_profile(name)) as harness,
    ):
        await harness.ready()
        await harness.commands.enable()
        goal = harness.submit(*[pose(0.1 * step) for step in range(1, 9)], step=0.2)
        await harness.until_moving()
        controller.apply(Event.PAUSE)
        await until(lambda: goal.handle.execution.paused)
        harness.driver.goal_queue.cancel(goal.handle)
        assert (await goal.end()).end is End.CANCELED
        controller.apply(Event.CONTINUE)
        await until(lambda: possible(harness, 1))
        assert await harness.rests()
        assert harness.at[0] < 0.75
