# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Races of stops with goals on an RC800 with Real-time Motion Control.

Each event happens at a random moment around the start of a goal. Then the arm comes to rest, and
nothing moves it until a new goal, which succeeds.
"""

import asyncio
import random

import numpy as np
import pytest
from support.driver_harness import pose
from support.event_loop import run, until
from support.fault_play import Witness, cell_of, linked, standing, where

from epson_driver.driver.outcome import End
from epson_driver.profiles import load_controller_profile
from epson_driver.sim_controller.condition.states import Event
from epson_driver.sim_controller.faults.fault_kinds import parse

PROFILE = load_controller_profile('rtmc')
RACES, BLOCKS, SLOW_BLOCKS = 660, 22, 2
"""Number of races, of their blocks, and of blocks in the slow tests."""

pytestmark = pytest.mark.invariant(3, 4, 5)


async def stop(harness, _controller, _goal):
    await harness.commands.stop()


async def cancel(harness, _controller, goal):
    if not goal.outcomes:
        harness.driver.goal_queue.cancel(goal.handle)


async def disable(harness, _controller, _goal):
    await harness.commands.disable()


async def estop(_harness, controller, _goal):
    controller.apply(Event.ESTOP_PRESS)
    await standing(controller)
    controller.apply(Event.ESTOP_RELEASE)
    controller.apply(Event.RESET)


async def door(_harness, controller, _goal):
    controller.apply(Event.DOOR_OPEN)
    controller.apply(Event.DOOR_CLOSE)


async def lost_link(harness, _controller, _goal):
    harness.driver.motion_link.reconnect('a test')


EVENTS = (stop, cancel, disable, estop, door, lost_link)


async def race(harness, controller, event, chance):
    await harness.commands.enable()
    distance = chance.choice([-0.3, 0.3])
    goal = harness.submit(where(controller) * [0, 1, 1, 1, 1, 1] + pose(distance), step=0.4)
    await asyncio.sleep(chance.uniform(0.0, chance.choice([0.02, 0.1, 0.6])))
    await event(harness, controller, goal)
    outcome = await goal.end()
    await standing(controller)
    await until(lambda: harness.driver.motion_link.connected)
    stopped = where(controller)
    await asyncio.sleep(0.3)
    np.testing.assert_allclose(where(controller), stopped, atol=1e-6)
    arrived = abs(stopped[0] - distance) < 0.01
    assert arrived or outcome.end is not End.SUCCEEDED, outcome
    assert outcome.end is not End.CANCELED or event is cancel
    assert len(goal.outcomes) == 1


async def races(count, events, seed):
    chance = random.Random(seed)
    async with cell_of(PROFILE) as (harness, controller, _):
        Witness(controller)
        for index in range(count):
            async with asyncio.timeout(30.0):
                await race(harness, controller, events[index % len(events)], chance)
        await harness.commands.enable()
        assert (await harness.submit(pose(0.0, 0.1)).end()).end is End.SUCCEEDED
        assert controller.real_time.motion.ran_empty == 0


@pytest.mark.parametrize('event', EVENTS)
def test_inv4_stopped_goal_of_real_time_motion_moves_nothing_afterwards(event):
    run(races(3, (event,), 1), 120.0)


@pytest.mark.parametrize(
    'block',
    [
        pytest.param(block, marks=pytest.mark.slow if block < SLOW_BLOCKS else pytest.mark.soak)
        for block in range(BLOCKS)
    ],
)
def test_inv4_in_660_races_of_stops_nothing_moves_afterwards(block):
    run(races(RACES // BLOCKS, EVENTS, 2 + block), 600.0)


@pytest.mark.parametrize('event', [disable, estop, lost_link])
async def test_inv4_pending_enable_does_not_undo_an_event_that_disables_the_arm(event):
    chance = random.Random(3)
    async with cell_of(PROFILE) as (harness, controller, _):
        for _ in range(3):
            await until(lambda: linked(harness))
            controller.apply(Event.MOTORS_OFF)
            controller.faults.start(parse('delay seconds=0.03'))
            enabling = asyncio.create_task(harness.commands.enable())
            await asyncio.sleep(chance.uniform(0.0, 0.1))
            await event(harness, controller, None)
            await asyncio.wait([enabling])
            enabled_before = enabling.exception() is None
            await until(lambda: harness.gate is not None)
            controller.faults.clear()
            await asyncio.sleep(0.3)
            assert harness.gate is not None, (event, enabled_before)
