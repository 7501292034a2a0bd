# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Goals that are submitted or run while the controller is paused, in every delivery."""

import pytest
from support.driver_harness import (
    answer,
    cell,
    options_of,
    pose,
    scripted_cell,
)
from support.event_loop import until

from epson_driver.driver.outcome import End, ErrorCode
from epson_driver.driver.remedy import Remedy
from epson_driver.profiles import load_controller_profile
from epson_driver.sim_controller.condition.states import Event

POSSIBLE = (1, 0, 0, 0, 0, 2, 1)
NOT_POSSIBLE = (1, 0, 0, 0, 0, 2, 0)
MAIN_ENDED = (1, 0, 2261, 0, 0, 2, 0)
UNKNOWN = (1, 0, 0, 0, 0, 2, -1)


def possible(harness, value):
    return (status := harness.driver.robot.status) is not None and status.motion_possible == value


async def report(harness, scripted, status):
    """Report a status, and wait until the driver receives it."""
    scripted.status = status
    await until(lambda: possible(harness, status[-1]))


# --- new goals ------------------------------------------------------------------------


async def test_goal_submitted_in_a_pause_is_refused():
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


async def test_goal_refused_in_a_pause_does_not_end_the_paused_goal():
    async with cell() as (harness, controller):
        paused = harness.submit(pose(0.5))
        await harness.until_moving()
        controller.apply(Event.PAUSE)
        await until(lambda: paused.handle.execution.paused)
        assert 'paused' in harness.submit(pose(0.0)).outcome.text
        assert not paused.outcomes
        controller.apply(Event.CONTINUE)
        assert (await paused.end()).end is End.SUCCEEDED


async def test_pause_reported_before_enable_does_not_refuse_goals():
    async with scripted_cell() as (harness, scripted):
        await report(harness, scripted, POSSIBLE)
        await report(harness, scripted, NOT_POSSIBLE)
        await harness.commands.enable()  # no effect, because the arm is enabled
        assert 'paused' in harness.submit(pose(0.1)).outcome.text
        await harness.commands.disable()
        await harness.commands.enable()
        goal = harness.submit(pose(0.1))
        assert not goal.outcomes
        harness.driver.goal_queue.cancel(goal.handle)
        await goal.end()


@pytest.mark.invariant(4)
async def test_inv4_goal_ends_when_the_program_of_the_controller_ends():
    """Points still in transit would move the arm when a user restarts the program."""
    async with scripted_cell(lambda number: answer(1, number) if number < 0 else b'') as (
        harness,
        scripted,
    ):
        await report(harness, scripted, POSSIBLE)
        goal = harness.submit(pose(0.5))
        await until(lambda: scripted.received)
        await report(harness, scripted, MAIN_ENDED)
        assert (await goal.end()).end is End.ABORTED
        assert 'error 2261' in goal.outcome.text
        await report(harness, scripted, POSSIBLE)
        assert 'error 2261' in harness.gate
        assert 'not enabled' in harness.submit(pose(0.1)).outcome.text


# --- running goals -------------------------------------------------------------------------


@pytest.mark.invariant(3, 4)
@pytest.mark.parametrize('name', ['simulated', 'abb', 'motoman'])
async def test_canceled_goal_of_a_paused_controller_does_not_continue(name):
    profile = load_controller_profile(name)
    async with cell(profile=profile, **options_of(profile)) as (harness, controller):
        goal = harness.submit(pose(0.8), step=2.0)
        await harness.until_moving()
        controller.apply(Event.PAUSE)
        await until(lambda: goal.handle.execution.paused)
        harness.driver.goal_queue.cancel(goal.handle)
        assert (await goal.end()).end is End.CANCELED
        controller.apply(Event.CONTINUE)
        await until(lambda: possible(harness, 1))
        assert await harness.rests()
        assert harness.at[0] < 0.75
