# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Streams of setpoints on an RC800 with Real-time Motion Control."""

import asyncio
import contextlib

import numpy as np
import pytest
from support.driver_harness import LIMITS, cell, options_of, pose
from support.event_loop import now, stand_still, until
from support.examples import quickly
from support.fault_play import standing, where
from support.policy_lag import behind
from support.streams import PERIOD, positions, send, sending, velocities

from epson_driver.driver.outcome import End
from epson_driver.profiles import load_controller_profile
from epson_driver.sim_controller.condition.states import Event

PROFILE = load_controller_profile('rtmc')
CYCLE = PROFILE.rtmc.cycle
OPTIONS = options_of(PROFILE) | {'state_period': PROFILE.state.period}


def sine(t):
    """0.5 Hz, 0.2 rad."""
    return 0.2 * (1.0 - np.cos(np.pi * t))


def speed(t):
    return 0.2 * np.pi * np.sin(np.pi * t)


@contextlib.asynccontextmanager
async def robot():
    """Yield a driver, a controller, and the positions that the arm takes, one per cycle."""
    async with cell(profile=PROFILE, **OPTIONS) as (harness, controller):
        motion, path = controller.real_time.motion, []
        take = motion.take_target

        def recorded():
            problem = take()
            path.append(motion.position)
            return problem

        motion.take_target = recorded
        yield harness, controller, path


def usage(path):
    """Return the largest velocity, acceleration and jerk, in units of the limits."""
    steps, result = np.array(path), []
    for limit in (LIMITS.velocity, LIMITS.acceleration, LIMITS.jerk):
        steps = np.diff(steps, axis=0) / CYCLE
        result.append(float(np.max(np.abs(steps) / limit, initial=0.0)))
    return result


def at_sine(t):
    return positions(pose(sine(t)))


def at_sine_with_velocities(t):
    return positions(pose(sine(t)), pose(speed(t)))


@pytest.mark.parametrize(('stream', 'bar'), [(at_sine, 0.03), (at_sine_with_velocities, 0.02)])
async def test_arm_follows_a_sine_with_low_lag_and_jerk(stream, bar):
    async with robot() as (harness, _, path):
        start = now()
        await send(harness, stream, 4.0)
        samples = [sample for time, sample in harness.events.samples if time > start]
        times = np.array([sample.measured for sample in samples]) - start
        lag, _ = behind(times, np.array([sample.positions[0] for sample in samples]), sine)
        assert 0.0 <= lag <= bar
        settled = np.array(path)[round(2.0 / CYCLE) :, 0]
        jerks = np.abs(np.diff(settled, 3)) / CYCLE**3
        assert jerks.mean() <= 0.05 * LIMITS.jerk[0]
        assert harness.gate is None


@pytest.mark.invariant(2)
async def test_inv2_random_streams_stay_within_the_limits():
    random = np.random.default_rng(3)
    async with robot() as (harness, controller, path):
        for index in range(3):
            target = where(controller)
            for _ in range(40):
                if index % 2:
                    setpoint = velocities(random.uniform(-3.0, 3.0, 6))
                else:
                    target = target + random.uniform(-0.1, 0.1, 6)
                    setpoint = positions(np.clip(target, -1.0, 1.0))
                harness.driver.servo.take(setpoint)
                await asyncio.sleep(random.uniform(0.005, 0.035))
            await standing(controller)
            await until(lambda: not harness.driver.servo.active)
            await asyncio.sleep(1.1)
        assert np.ptp(path, axis=0).max() > 0.3
        assert max(usage(path)) <= 1.0 + 1e-4
        assert controller.real_time.motion.ran_empty == 0
        assert harness.gate is None


@pytest.mark.invariant(3)
@pytest.mark.parametrize('stall', quickly([0.0, 0.5], [0.0, 0.05, 0.5], several=False))
async def test_inv3_silent_or_stalled_stream_ends_at_rest(stall):
    async with robot() as (harness, controller, path):
        await send(harness, at_sine_with_velocities, 1.5)
        last = sine(1.5 - PERIOD)
        stand_still(stall)
        await until(lambda: not harness.driver.servo.active)
        await standing(controller)
        assert where(controller)[0] == pytest.approx(last, abs=0.05)
        assert max(usage(path)) <= 1.0 + 1e-4
        await until(lambda: not controller.real_time.enabled)
        goal = harness.submit(pose(0.1))
        assert (await goal.end()).end is End.SUCCEEDED


@pytest.mark.invariant(3, 4)
@pytest.mark.parametrize('event', ['stop', 'disable', 'estop', 'lost link'])
async def test_inv4_stopped_stream_does_not_move_the_arm_again(event):
    async with robot() as (harness, controller, path):
        async with sending(harness, at_sine_with_velocities):
            await until(lambda: where(controller)[0] > 0.1)
            if event == 'estop':
                controller.apply(Event.ESTOP_PRESS)
            elif event == 'lost link':
                harness.driver.motion_link.reconnect('a test')
            else:
                await getattr(harness.commands, event)()
            await standing(controller)
            stopped = where(controller)
            await asyncio.sleep(1.0)
            np.testing.assert_allclose(where(controller), stopped, atol=1e-6)
        assert not harness.driver.servo.active
        assert max(usage(path)) <= 1.0 + 1e-4
