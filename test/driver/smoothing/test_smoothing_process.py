# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The process that prepares trajectories, and one that fails in its place: each is told."""

import asyncio
import sys
from dataclasses import replace

import numpy as np
import pytest

from epson_driver.cli.trajectory_file import read_trajectory
from epson_driver.driver.smoothing import smoothing_process
from epson_driver.driver.smoothing.smoothing import Smoothing
from epson_driver.driver.smoothing.smoothing_process import SmoothingError, SmoothingProcess
from epson_driver.robots import load_robot_model
from epson_driver.share import share_file

LIMITS = load_robot_model('c3_a601s').limits
PLAN = read_trajectory(share_file('config', 'trajectories', 'around_pillar_fast_100ms.yaml'))
READ = 'import sys; sys.stdin.buffer.read(); '


async def prepared(start, plan=PLAN):
    """Ask for one trajectory; close the process whatever becomes of it."""
    smoother = SmoothingProcess(LIMITS, Smoothing(0.05))
    try:
        return await smoother.prepared(plan, start)
    finally:
        await smoother.close()


def test_what_no_smooth_motion_can_be_made_of_is_told_in_the_words_of_the_smoother():
    start = PLAN.positions[0].copy()
    start[0] = 3.0
    later = replace(PLAN, times=PLAN.times + 1.0)  # it begins where the arm is
    with pytest.raises(SmoothingError, match=r'joint_1: position 3 is outside the limits -2\.9'):
        asyncio.run(prepared(start, later))


@pytest.mark.parametrize(
    ('code', 'said'),
    [
        (READ + 'print("no pickle")', 'the answer of the smoother is no pickle: '),
        (READ + 'sys.exit(3)', 'the smoother ended with exit code 3'),
        (READ, 'the smoother ended with exit code 0'),
    ],
)
@pytest.mark.invariant(9)
def test_inv9_a_process_that_fails_is_an_error_of_its_goal(monkeypatch, code, said):
    async def start_process():
        pipe = asyncio.subprocess.PIPE
        return await asyncio.create_subprocess_exec(
            sys.executable, '-S', '-c', code, stdin=pipe, stdout=pipe
        )

    monkeypatch.setattr(smoothing_process, 'start_process', start_process)
    with pytest.raises(SmoothingError, match=said):
        asyncio.run(prepared(np.zeros(6)))


@pytest.mark.invariant(9)
def test_inv9_a_process_that_cannot_be_started_is_an_error_and_the_next_goal_has_its_own(
    monkeypatch, tmp_path
):
    async def check():
        smoother = SmoothingProcess(LIMITS, Smoothing(0.05))
        for _ in range(2):
            with pytest.raises(SmoothingError, match='the smoother could not be started: '):
                await smoother.prepared(PLAN, PLAN.positions[0])
        await smoother.close()

    monkeypatch.setattr(sys, 'executable', str(tmp_path / 'no_python'))
    asyncio.run(check())
