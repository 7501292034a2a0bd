# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Smoothing in the driver: its trajectories, and the process that computes them."""

import asyncio
import sys
from dataclasses import replace

import numpy as np
import pytest

from epson_driver.driver import smoothing as smoothing_module
from epson_driver.driver.delivery.streaming import trajectory_points
from epson_driver.driver.goal.goal import check_limits, check_start, untimed
from epson_driver.driver.outcome import GoalRejectedError
from epson_driver.driver.smoothing import (
    MIN_TOLERANCE,
    Smoothing,
    SmoothingError,
    SmoothingProcess,
    check_tolerance,
)
from epson_driver.driver.smoothing_worker import smoothed_trajectory
from epson_driver.driver.state.joint_mapping import unmapped
from epson_driver.motion import Trajectory, problems
from epson_driver.motion import smoothed as smoothed_module
from epson_driver.motion.closest_samples import passed
from epson_driver.motion.smoothed import smoothed
from epson_driver.motion.smoother import Mode
from epson_driver.robots import load_robot_model
from epson_driver.share import share_path
from epson_driver.trajectory_file import read_trajectory

LIMITS = load_robot_model('c3_a601s').limits
PLAN = read_trajectory(share_path('config', 'trajectories', 'around_pillar_fast_100ms.yaml'))
START = PLAN.positions[0]
POSITIONS_ONLY = Trajectory(LIMITS.names, np.zeros(len(PLAN.times)), PLAN.positions)


def smooth(plan, smoothing, start=START):
    return smoothed_trajectory(plan, start, LIMITS, smoothing)[0]


def resampled(period, *, time_optimal=False, plan=PLAN):
    return smooth(plan, Smoothing(period, time_optimal))


@pytest.mark.parametrize('period', [0.004, 0.05, 0.1])
def test_resampled_points_are_equally_spaced_and_within_limits(period):
    motion = resampled(period)
    assert np.diff(motion.times) == pytest.approx(period)
    assert motion.times[0] == 0.0
    assert list(problems(motion, LIMITS)) == []
    assert np.array_equal(motion.positions[0], PLAN.positions[0])
    assert np.abs(motion.positions[-1] - PLAN.positions[-1]).max() < 1e-9
    assert not motion.velocities[0].any()
    assert not motion.velocities[-1].any()
    assert PLAN.duration <= motion.duration < 1.3 * PLAN.duration + period


def test_resampled_points_sent_respect_the_joint_velocities():
    points = trajectory_points(resampled(0.05), START, LIMITS, unmapped(len(LIMITS.names)))
    assert all(0.0 < point.velocity <= 1.0 for point in points)
    assert [point.duration for point in points[1:]] == pytest.approx([0.05] * (len(points) - 1))


def test_time_optimal_motion_ignores_the_times_of_the_plan():
    plan = untimed(POSITIONS_ONLY, LIMITS)
    check_limits(plan, LIMITS)
    check_start(plan, START, LIMITS, 0.01)
    motion = resampled(0.004, time_optimal=True, plan=plan)
    same = resampled(0.004, time_optimal=True)
    assert np.array_equal(motion.positions, same.positions)
    assert motion.duration <= resampled(0.004).duration
    assert motion.duration < resampled(0.004, plan=replace(PLAN, times=2.0 * PLAN.times)).duration


@pytest.mark.parametrize('thin', [False, True])
def test_time_optimal_goal_takes_the_fastest_motion(thin):
    plan = untimed(POSITIONS_ONLY, LIMITS)
    sent = smooth(plan, Smoothing(0.004, time_optimal=True, thin=thin))
    assert sent.duration < 1.1 * smoothed(plan, LIMITS, Mode.TIME_OPTIMAL).duration
    assert sent.duration < smoothed(plan, LIMITS, Mode.TIME_OPTIMAL, refine=False).duration - 0.02


def test_controller_that_ignores_times_gets_the_points_of_the_plan():
    plan = untimed(POSITIONS_ONLY, LIMITS)
    smoothing = Smoothing(time_optimal=True, own_points=True)
    sent = smooth(plan, smoothing)
    assert np.array_equal(sent.positions, plan.positions)


@pytest.mark.slow
@pytest.mark.parametrize('thin', [False, True])
def test_tolerance_removes_the_noise_of_a_recording(thin):
    """The times stay, and every point is passed within the tolerance."""
    times = np.arange(251) / 125.0
    wave = 0.5 - 0.5 * np.cos(np.pi * times / times[-1])
    noise = np.random.default_rng(8).normal(size=(len(times), len(START))) * 2e-4
    recorded = Trajectory(LIMITS.names, times, START + 0.3 * wave[:, None] + noise)

    def sent(tolerance):
        smoothing = Smoothing(0.02, thin=thin, deviation=1e-3, tolerance=tolerance)
        return smooth(recorded, smoothing, recorded.positions[0])

    assert sent(0.0).duration > 1.5 * times[-1]
    motion = sent(1e-3)
    assert motion.duration < 1.05 * times[-1]
    lines = 1e-3 if thin else 0.0
    assert passed(recorded.positions, motion)[0].max() < 1e-3 + lines


def test_tolerance_shortens_a_time_optimal_motion():
    corner = START + np.array([[0, 0], [0.3, 0], [0.3, 0.3], [0.6, 0.3]]) @ np.eye(2, len(START))
    plan = Trajectory(LIMITS.names, np.arange(4.0), corner)
    exact, free = (smooth(plan, Smoothing(time_optimal=True, tolerance=t)) for t in (0.0, 0.02))
    assert free.duration < 0.97 * exact.duration
    assert passed(corner, smoothed_module.smoothed(free, LIMITS))[0].max() < 0.02


@pytest.mark.parametrize(
    ('smoothing', 'words'),
    [
        (Smoothing(0.05, tolerance=1e-3), None),
        (Smoothing(0.05, thin=True, tolerance=5e-3), None),
        (Smoothing(time_optimal=True), None),
        (Smoothing(0.05, tolerance=0.99 * MIN_TOLERANCE), '0.00099 rad: must be 0, or 0.001'),
        (Smoothing(tolerance=1e-3), 'with smoothing = resample or thin'),
        (Smoothing(0.05, True, tolerance=1e-3), None),
        (Smoothing(time_optimal=True, own_points=True, tolerance=1e-3), 'or timing = time_opt'),
    ],
)
def test_tolerance_is_refused_unless_the_motion_is_smoothed(smoothing, words):
    if words is None:
        check_tolerance(smoothing)
        return
    with pytest.raises(ValueError, match=words):
        check_tolerance(smoothing)


def test_minimum_tolerances_of_driver_and_smoother_are_equal():
    assert smoothed_module.MIN_TOLERANCE == MIN_TOLERANCE


def test_first_point_with_a_time_is_approached_from_the_arm():
    start = np.zeros(6)
    plan = Trajectory(LIMITS.names, np.array([2.0]), START[None, :])
    for smoothing in (Smoothing(0.05), Smoothing(0.05, True), Smoothing(None, True)):
        motion = smooth(plan, smoothing, start)
        assert np.array_equal(motion.positions[0], start)
        assert np.abs(motion.positions[-1] - START).max() < 1e-9
    assert smooth(plan, Smoothing(0.05), start).duration == pytest.approx(2.0, abs=0.3)


def test_too_fast_plan_is_accepted_without_its_times():
    fast = Trajectory(LIMITS.names, PLAN.times / 100.0, PLAN.positions)
    with pytest.raises(GoalRejectedError, match='velocity limit'):
        check_limits(fast, LIMITS)
    check_limits(untimed(fast, LIMITS), LIMITS)


@pytest.mark.parametrize(
    ('value', 'words'),
    [
        (np.nan, 'point 2, joint_3: positions = nan rad is not finite'),
        (9.0, 'joint_3: position 9'),
    ],
)
def test_positions_of_an_untimed_plan_are_checked(value, words):
    positions = PLAN.positions.copy()
    positions[2, 2] = value
    plan = Trajectory(LIMITS.names, np.zeros(len(positions)), positions)
    with pytest.raises(GoalRejectedError) as caught:
        check_limits(untimed(plan, LIMITS), LIMITS)
    assert words in str(caught.value)


READ = 'import sys; sys.stdin.buffer.read1(); '


async def prepared(start, plan=PLAN):
    """Prepare one trajectory, and close the process."""
    smoother = SmoothingProcess(LIMITS, Smoothing(0.05))
    try:
        return await smoother.prepared(plan, start)
    finally:
        await smoother.close()


def test_error_text_of_the_smoother_process_is_reported():
    start = PLAN.positions[0].copy()
    start[0] = 3.0
    later = replace(PLAN, times=PLAN.times + 1.0)  # it starts at the arm's position
    with pytest.raises(SmoothingError, match=r'joint_1: position 3 is outside the limits -2\.9'):
        asyncio.run(prepared(start, later))


def replace_worker(monkeypatch, code):
    """Let the smoother's process run other Python code."""

    async def start_worker(_module):
        pipe = asyncio.subprocess.PIPE
        return await asyncio.create_subprocess_exec(
            sys.executable, '-S', '-c', code, stdin=pipe, stdout=pipe
        )

    monkeypatch.setattr(smoothing_module, 'start_worker', start_worker)


@pytest.mark.parametrize(
    ('code', 'text'),
    [
        (READ + 'print("no trajectory" * 9)', 'the smoother sent a value of'),
        (READ + 'sys.exit(3)', 'the smoother ended with exit code 3'),
        (READ, 'the smoother ended with exit code 0'),
    ],
)
@pytest.mark.invariant(9)
def test_inv9_failed_smoothing_process_is_an_error_of_its_goal(monkeypatch, code, text):
    replace_worker(monkeypatch, code)
    with pytest.raises(SmoothingError, match=text):
        asyncio.run(prepared(np.zeros(6)))


@pytest.mark.invariant(9)
def test_inv9_close_ends_a_motion_in_preparation(monkeypatch):
    replace_worker(monkeypatch, 'import time; time.sleep(60)')
    result_of = smoothing_module.result_of

    async def scenario():
        asked = asyncio.Event()

        def seen(*arguments):
            asked.set()
            return result_of(*arguments)

        monkeypatch.setattr(smoothing_module, 'result_of', seen)
        smoother = SmoothingProcess(LIMITS, Smoothing(0.05))
        pending = asyncio.create_task(smoother.prepared(PLAN, PLAN.positions[0]))
        await asked.wait()
        await smoother.close()
        with pytest.raises(SmoothingError, match='the smoother was ended by SIGKILL'):
            await pending
        with pytest.raises(SmoothingError, match='the driver has ended'):
            await smoother.prepared(PLAN, PLAN.positions[0])

    asyncio.run(scenario())


@pytest.mark.invariant(9)
async def test_inv9_smoothing_process_that_cannot_start_fails_each_goal(monkeypatch, tmp_path):
    monkeypatch.setattr(sys, 'executable', str(tmp_path / 'no_python'))
    smoother = SmoothingProcess(LIMITS, Smoothing(0.05))
    for _ in range(2):
        with pytest.raises(SmoothingError, match='the smoother could not be started: '):
            await smoother.prepared(PLAN, PLAN.positions[0])
    await smoother.close()
