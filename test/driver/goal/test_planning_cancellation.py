# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Goals in planning: their end is reported immediately, and they do not start later."""

import asyncio
import logging
import threading

import pytest
from support.driver_harness import cell, pose
from support.event_loop import run, until

from epson_driver.driver.goal.planning_cancellation import (
    PlanningCancellation,
    PlanningCancellations,
    PlanningEndedError,
)
from epson_driver.sim_controller.condition.states import Event


@pytest.mark.invariant(5)
async def test_cancellation_wakes_the_caller_while_the_planning_thread_runs():
    """Even a thread that never checks its scope keeps no caller waiting."""
    started, go_on = threading.Event(), threading.Event()
    asked = []

    def work(look):
        started.set()
        go_on.wait()
        try:
            look()
        except PlanningEndedError as error:
            asked.append(str(error))
            raise

    plan = PlanningCancellation()
    task = asyncio.create_task(plan.in_thread(work))
    await until(started.is_set)
    assert not task.done()
    plan.end('canceled')
    plan.end('something else')
    with pytest.raises(PlanningEndedError, match=r'^canceled$'):
        await task
    assert asked == []
    go_on.set()
    await until(lambda: asked)
    assert asked == ['canceled']
    with pytest.raises(PlanningEndedError, match=r'^canceled$'):
        await plan.in_thread(work)


async def test_planning_returns_or_raises_the_result_of_its_thread():
    def fails(_look):
        raise ValueError('out of reach')

    assert await PlanningCancellation().in_thread(lambda look: look()) is None
    with pytest.raises(ValueError, match='out of reach'):
        await PlanningCancellation().in_thread(fails)


def test_failure_of_abandoned_planning_is_logged(caplog):
    started, go_on = threading.Event(), threading.Event()

    def work(_look):
        started.set()
        go_on.wait()
        raise RuntimeError('broken')

    async def scenario():
        task = asyncio.create_task(PlanningCancellation().in_thread(work))
        await until(started.is_set)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        go_on.set()
        await until(lambda: caplog.records)

    with caplog.at_level(logging.WARNING, 'epson_driver'):
        run(scenario())
    assert "RuntimeError('broken')" in caplog.text


def test_plans_are_canceled_together_and_released():
    plans = PlanningCancellations()
    first, second = plans.begin(), plans.begin(PlanningCancellation())
    plans.end('stopped')
    assert first.why == second.why == 'stopped'
    del first, second
    assert len(plans._plans) == 0
    assert plans.begin().why is None


async def estop(harness, controller):
    controller.apply(Event.ESTOP_PRESS)
    await until(lambda: harness.gate is not None)
    controller.apply(Event.ESTOP_RELEASE)
    await harness.commands.reset_error()


async def stop(harness, _controller):
    await harness.commands.stop()


async def disable(harness, _controller):
    await harness.commands.disable()


async def move(harness, _controller):
    await harness.submit(pose(0.05)).end()


@pytest.mark.invariant(4)
@pytest.mark.parametrize('happens', [estop, stop, disable, move])
async def test_stop_or_motion_cancels_plans_even_if_enabled_again(happens):
    async with cell() as (harness, controller):
        plan = harness.driver.goal_queue.plans.begin()
        await happens(harness, controller)
        await harness.commands.enable()
        assert plan.why is not None
        assert harness.driver.goal_queue.plans.begin().why is None
