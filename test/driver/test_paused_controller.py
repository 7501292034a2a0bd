# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Goals that are submitted or run while the controller is paused, in every delivery."""

import asyncio
import contextlib
from dataclasses import replace

import numpy as np
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
DELIVERIES = ('simulated', 'abb', 'motoman')


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


async def test_refused_goal_in_a_pause_does_not_end_the_paused_one():
    async with cell() as (harness, controller):
        paused = harness.submit(pose(0.5))
        await harness.until_moving()
        controller.apply(Event.PAUSE)
        await until(lambda: paused.handle.execution.paused)
        assert 'paused' in harness.submit(pose(0.0)).outcome.text
        assert not paused.outcomes
        controller.apply(Event.CONTINUE)
        assert (await paused.end()).end is End.SUCCEEDED


@pytest.mark.parametrize('status', [NOT_POSSIBLE, UNKNOWN], ids=['always 0', 'unknown'])
async def test_controller_that_never_reports_motion_possible_receives_goals(status):
    async with scripted_cell(enabled=False) as (harness, scripted):
        await report(harness, scripted, status)
        await harness.commands.enable()
        goal = harness.submit(pose(0.1))
        await until(lambda: scripted.received)
        harness.driver.goal_queue.cancel(goal.handle)
        await goal.end()


async def test_motion_possible_before_enable_is_ignored():
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


async def test_error_code_without_in_error_is_not_a_pause():
    async with scripted_cell() as (harness, scripted):
        await report(harness, scripted, (1, 0, 4031, -1, 0, 2, 0))
        assert not harness.driver.robot.paused


@pytest.mark.invariant(4)
async def test_inv4_goal_ends_with_the_controllers_program():
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


@contextlib.asynccontextmanager
async def paused_goal(name):
    """Pause a controller during a goal; yield the driver, the controller and the goal.

    Its queue has room for all points, because a Motoman refuses points in a pause.
    """
    profile = load_controller_profile(name)
    profile = replace(profile, motion=replace(profile.motion, pending_limit=1000))
    async with cell(profile=profile, **options_of(profile)) as (harness, controller):
        goal = harness.submit(*(pose(0.1 * step) for step in range(1, 9)), step=0.2)
        await harness.until_moving()
        controller.apply(Event.PAUSE)
        await until(lambda: goal.handle.execution.paused)
        yield harness, controller, goal


@pytest.mark.parametrize('name', DELIVERIES)
async def test_running_goal_waits_while_the_controller_is_paused(name):
    async with paused_goal(name) as (harness, controller, goal):
        assert goal.handle.execution.speed(0.0) == 0.0
        plan_time = goal.handle.execution.desired[0]
        here = harness.at
        assert here[0] < 0.75
        await asyncio.sleep(1.2)  # longer than the maximum rest away from the goal
        assert not goal.outcomes
        assert goal.handle.execution.desired[0] == plan_time
        np.testing.assert_allclose(harness.at, here, atol=1e-3)
        controller.apply(Event.CONTINUE)
        assert (await goal.end()).end is End.SUCCEEDED
        np.testing.assert_allclose(harness.at, pose(0.8), atol=1e-3)


@pytest.mark.parametrize('name', DELIVERIES)
async def test_goal_of_a_paused_controller_can_be_canceled(name):
    async with paused_goal(name) as (harness, controller, goal):
        harness.driver.goal_queue.cancel(goal.handle)
        assert (await goal.end()).end is End.CANCELED
        controller.apply(Event.CONTINUE)
        await until(lambda: possible(harness, 1))
        assert await harness.rests()
        assert harness.at[0] < 0.75
