# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Speed scaling where points are sent long before execution: download and Motoman's queue."""

import contextlib
from dataclasses import replace

import numpy as np
import pytest
from support import goal_execution_harness
from support.driver_harness import cell, options_of, pose

from epson_driver.driver.goal.reference import RAMP_PER_S
from epson_driver.driver.outcome import End
from epson_driver.profiles import load_controller_profile
from epson_driver.simple_message import JointTrajPt, JointTrajPtFull, decode

STEP = 0.2
STEPS = [pose(0.1 * step) for step in range(1, 9)]


@contextlib.asynccontextmanager
async def cell_of(name, **motion):
    """Run an enabled driver with the controller of a profile; yield it and the points received."""
    profile = load_controller_profile(name)
    profile = replace(profile, motion=replace(profile.motion, **motion))
    async with cell(profile=profile, **options_of(profile)) as (harness, controller):
        points = []
        take = controller.program.receive

        def receive(frame, *rest):
            message = decode(frame).message
            if isinstance(message, JointTrajPt | JointTrajPtFull):
                points.append(message)
            return take(frame, *rest)

        controller.program.receive = receive
        yield harness, points


def test_points_sent_ahead_have_the_speed_at_their_execution():
    """All points of a plan of 1 s are sent at the moment at which the factor starts to fall."""
    line = np.linspace([0.0, 0.0], [1.0, 0.5], 6)
    harness = goal_execution_harness.Harness(line, step=STEP, start=False)
    harness.scaling.set(0.1, harness.now)
    harness.start()
    while harness.state == 'streaming':
        harness.answer()
    _, *rest = (point.duration for point in harness.sent)
    in_ramp = 0.9 / RAMP_PER_S
    done = in_ramp * (1.0 + 0.1) / 2
    assert sum(rest) == pytest.approx(in_ramp + (1.0 - done) / 0.1, rel=0.01)
    assert rest[-1] == pytest.approx(STEP / 0.1)
    harness.see(2.0)
    after = done + (2.0 - in_ramp) * 0.1
    assert harness.execution.desired[0] == pytest.approx(after, abs=0.02)


@pytest.mark.parametrize('factor', [1.0, 0.5])
async def test_download_has_the_speed_scaling_of_its_start(factor):
    async with cell_of('abb') as (harness, points):
        harness.driver.goal_queue.set_speed(factor)
        assert (await harness.submit(*STEPS, step=STEP).end()).end is End.SUCCEEDED
        durations = [point.duration for point in points[1:]]
        assert durations == pytest.approx([STEP / factor] * len(STEPS), rel=1e-5)
        np.testing.assert_allclose(harness.at, STEPS[-1], atol=1e-3)


async def test_running_download_refuses_lower_speed_and_pause():
    async with cell_of('abb') as (harness, points):
        goal = harness.submit(*STEPS, step=STEP)
        await harness.until_moving()
        assert len(points) == len(STEPS) + 1
        for factor in (0.5, 0.0):
            with pytest.raises(
                ValueError, match=f'factor = {factor:g}: the controller has all points'
            ):
                harness.driver.goal_queue.set_speed(factor)
        assert (await goal.end()).end is End.SUCCEEDED
        np.testing.assert_allclose(harness.at, STEPS[-1], atol=1e-3)
