# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Streams of setpoints for a driver in the test's event loop."""

import asyncio
import contextlib
from collections.abc import AsyncIterator
from typing import Any

import numpy as np

from epson_driver.driver.servo.setpoint import ServoSettings, Setpoint, Window
from epson_driver.motion import Array
from epson_driver.profiles import load_controller_profile
from support.driver_harness import Harness, cell, options_of

PERIOD = 0.02
SERVO = '~/servo'
JOG = '~/joint_jog'


def positions(values: Array, velocities: Array | None = None, source: Any = SERVO) -> Setpoint:
    return Setpoint(source, np.array(values, dtype=float), velocities)


def window(state_at, ends=0.1, step=0.01, begins=0.0, source=SERVO):
    """Return a window of MoveIt Servo. state_at(t): positions and velocities in t s."""
    times = np.arange(begins, ends + step / 2.0, step)
    states = [state_at(t) for t in times]
    positions = np.array([position for position, _ in states], dtype=float)
    speeds = np.array([speed for _, speed in states], dtype=float)
    return Setpoint(source, positions[-1], speeds[-1], Window(times, positions, speeds))


def velocities(values, source=JOG):
    return Setpoint(source, None, np.array(values, dtype=float))


async def send(harness, setpoint_at, duration, period=PERIOD):
    """Send setpoint_at(time) every `period` for `duration` s, from time 0."""
    for count in range(round(duration / period)):
        harness.driver.servo.take(setpoint_at(count * period))
        await asyncio.sleep(period)


@contextlib.asynccontextmanager
async def sending(harness, setpoint_at, period=PERIOD):
    """Send setpoints until the block ends."""
    task = asyncio.create_task(send(harness, setpoint_at, 1e6, period))
    try:
        yield task
    finally:
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await task


@contextlib.asynccontextmanager
async def jogging(profile: str, smooth: bool) -> AsyncIterator[Harness]:
    """Run an enabled driver at rest with the setpoint period of a simulated controller."""
    async with cell(profile=profile, smooth=smooth, **options_of(profile)) as (harness, _):
        period = load_controller_profile(profile).program.setpoint_period
        harness.driver.servo.settings = ServoSettings(period=period)
        await asyncio.sleep(0.5)
        yield harness
