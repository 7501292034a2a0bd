# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Goals with a later start end like running ones while they wait."""

import asyncio

import numpy as np
import pytest
from support.driver_harness import cell, pose, smooth_in_process
from support.event_loop import now, until

from epson_driver.driver.goal.goal_states import GoalState
from epson_driver.driver.outcome import End
from epson_driver.driver.smoothing import Smoothing
from epson_driver.sim_controller.condition.states import Event

AHEAD_S = 0.8


@pytest.mark.parametrize('options', [{}, {'smoothing': Smoothing(0.1)}])
async def test_goal_starts_at_its_stamp(options, monkeypatch):
    smooth_in_process(monkeypatch)
    async with cell(**options) as (harness, _):
        start, before = now(), harness.at
        goal = harness.submit(pose(0.3), ahead=2.0)
        await until(lambda: goal.handle.execution.state is GoalState.STREAMING)
        assert now() - start == pytest.approx(2.0, abs=0.02)
        assert np.array_equal(harness.at, before)
        outcome = await goal.end()
        assert outcome.end is End.SUCCEEDED
        assert 'header.stamp' not in outcome.text


@pytest.mark.invariant(4, 5)
@pytest.mark.parametrize('what', ['cancel', 'stop', 'disable', 'E-stop', 'cut', 'replace'])
async def test_inv4_inv5_goal_ended_before_its_start_time_moves_nothing(what):
    async with cell() as (harness, controller):
        goal = harness.submit(pose(0.5), ahead=AHEAD_S)
        await asyncio.sleep(AHEAD_S / 2)
        if what == 'cancel':
            harness.driver.goal_queue.cancel(goal.handle)
        elif what == 'stop':
            await harness.commands.stop()
        elif what == 'disable':
            await harness.commands.disable()
        elif what == 'E-stop':
            controller.apply(Event.ESTOP_PRESS)
        elif what == 'cut':
            harness.driver.motion_link.transport.abort()
        else:
            assert (await harness.submit(pose(-0.1)).end()).end is End.SUCCEEDED
        outcome = await goal.end()
        assert outcome.end is (End.CANCELED if what == 'cancel' else End.ABORTED)
        there = harness.at
        if what != 'replace':
            assert not there.any()
        await asyncio.sleep(2 * AHEAD_S)
        assert np.array_equal(harness.at, there)


@pytest.mark.invariant(4)
async def test_inv4_goal_is_checked_again_at_its_start_time():
    async with cell() as (harness, _):
        goal = harness.submit(pose(0.5), start=pose(0.015), ahead=AHEAD_S)
        harness.driver.goal_queue.start_tolerance = 0.01
        assert 'starts at 0.015 rad, the joint is at 0 rad' in (await goal.end()).text
        assert goal.handle.execution.state is GoalState.ABORTED
        assert not harness.at.any()


async def test_running_goal_is_stopped_for_a_goal_with_a_later_start():
    async with cell(smooth=True) as (harness, _):
        first = harness.submit(pose(1.0), step=4.0)
        await harness.until_moving()
        second = harness.submit(pose(0.0), step=2.0, ahead=AHEAD_S)
        outcome = await first.end()
        assert outcome.text == 'replaced by a new goal, the arm is at rest'
        assert await harness.rests()
        assert (await second.end()).end is End.SUCCEEDED


async def test_late_start_of_a_goal_is_reported():
    async with cell() as (harness, _):
        outcome = await harness.submit(pose(0.1), ahead=-0.5).end()
        assert outcome.end is End.SUCCEEDED
        assert 'it started 0.5 s after its header.stamp' in outcome.text
