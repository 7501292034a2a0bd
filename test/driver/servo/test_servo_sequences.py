# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Random sequences of streams, goals, stops, E-stops and gaps send only permitted points."""

import asyncio
import contextlib

import numpy as np
import pytest
from support.driver_harness import JOINTS, LIMITS, cell, pose
from support.event_loop import run, stand_still, until
from support.streams import JOG, SERVO, positions, sending, velocities

from epson_driver.driver.arm_commands import CommandError
from epson_driver.driver.delivery.streaming import STOP
from epson_driver.driver.outcome import End
from epson_driver.sim_controller.condition.states import Event

ACTIONS = 12
"""Number of actions in one run."""


class Spy:
    """Checks every message for the motion port when it is sent."""

    def __init__(self, harness):
        self._driver = harness.driver
        self._post = harness.driver.motion_link.post
        self.points = 0
        harness.driver.motion_link.post = self.post

    def post(self, message, on_reply):
        driver = self._driver
        if message != STOP:
            self.points += 1
            assert driver.gate.reason is None
            assert driver.stopper.over
            assert not (driver.servo.active and driver.goal_queue.busy)
            inside = np.array(message.joints[:JOINTS])
            assert np.all(inside >= LIMITS.position_min - 1e-6)
            assert np.all(inside <= LIMITS.position_max + 1e-6)
        return self._post(message, on_reply)


class Sender:
    """Two streams, either of which may be active: positions near or far, and velocities."""

    def __init__(self, harness, random):
        self._harness = harness
        self._random = random
        self.on = False
        self._target = np.zeros(JOINTS)
        self._velocity = np.zeros(JOINTS)

    def change(self):
        self.on = True
        sample = self._harness.driver.robot.sample
        at = np.zeros(JOINTS) if sample is None else sample.positions
        self._target = at + self._random.uniform(-1.0, 1.0, JOINTS) * self._random.choice(
            [0.03, 0.5, 4.0]
        )
        self._velocity = self._random.uniform(-3.0, 3.0, JOINTS) * self._random.integers(0, 2)

    def positions(self, time):
        if self.on and time % 1.0 < 0.7:  # with gaps
            return positions(self._target, source=SERVO)
        return positions([0.0], source=SERVO)  # dropped

    def velocities(self, _time):
        return velocities(self._velocity if self.on else np.full(JOINTS, np.nan), source=JOG)


async def act(harness, controller, sender, random):
    """Perform a random action."""
    action = random.integers(0, 10)
    if action < 3:
        sender.change()
    elif action == 3:
        sender.on = False
    elif action == 4:
        harness.submit(pose(random.uniform(-0.5, 0.5)), start=None)
    elif action == 5:
        with contextlib.suppress(CommandError):
            await harness.commands.stop()
    elif action == 6:
        controller.apply(Event.ESTOP_PRESS)
        await asyncio.sleep(random.uniform(0.0, 0.3))
        await repaired(harness, controller)
    elif action == 7:
        harness.driver.motion_link.reconnect('for the test')
        await asyncio.sleep(0.3)
        await repaired(harness, controller)
    elif action == 8:
        stand_still(random.uniform(0.0, 0.6))
    else:
        harness.driver.goal_queue.set_speed(float(random.choice([0.0, 0.3, 1.0])))
    await asyncio.sleep(random.uniform(0.0, 0.6))


async def repaired(harness, controller):
    """Reset and enable the arm as a user does after an E-stop or a lost link."""
    await asyncio.sleep(1.0)  # the controller refuses a reset while the arm moves
    for event in (Event.ESTOP_RELEASE, Event.RESET, Event.MOTORS_ON):
        controller.apply(event)
    await asyncio.sleep(0.3)
    await harness.ready()
    for _ in range(5):
        with contextlib.suppress(CommandError):
            await harness.commands.enable()
            return
        await asyncio.sleep(0.5)


@pytest.mark.invariant(4)
@pytest.mark.slow
@pytest.mark.parametrize('seed', range(8))
def test_inv4_random_events_send_no_forbidden_point_and_end_at_rest(seed):
    async def check():
        random = np.random.default_rng(seed)
        async with cell(smooth=bool(seed % 2)) as (harness, controller):
            spy = Spy(harness)
            sender = Sender(harness, random)
            async with sending(harness, sender.positions), sending(harness, sender.velocities):
                for _ in range(ACTIONS):
                    await act(harness, controller, sender, random)
                assert harness.running
            harness.driver.goal_queue.set_speed(1.0)
            await until(lambda: not harness.driver.busy)
            assert await harness.rests()
            await repaired(harness, controller)
            goal = harness.submit(harness.at + 0.01 * np.sign(-harness.at))
            assert (await goal.end()).end is End.SUCCEEDED
            assert spy.points > 0
            assert all(abs(ratio).max() < 1.3 for ratio in velocity_ratios(harness))

    run(check(), patience=240.0)


def velocity_ratios(harness):
    """Yield the measured velocities divided by the limits."""
    for _, sample in harness.events.samples:
        yield sample.velocities / LIMITS.velocity
