# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Smoothing in the driver: what it makes of trajectories, and the process it runs in."""

import asyncio
import sys
from dataclasses import replace

import numpy as np
import pytest

from epson_driver.driver import smoothing as smoothing_module
from epson_driver.driver.delivery.trajectory_points import trajectory_points
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
from epson_driver.motion.passages import passed
from epson_driver.motion.smoothed import smoothed
from epson_driver.motion.smoother import Mode
from epson_driver.robots import load_robot_model
from epson_driver.share import share_file
from epson_driver.trajectory_file import read_trajectory

LIMITS = load_robot_model('c3_a601s').limits
PLAN = read_trajectory(share_file('config', 'trajectories', 'around_pillar_fast_100ms.yaml'))
START = PLAN.positions[0]
POSITIONS_ONLY = Trajectory(LIMITS.names, np.zeros(len(PLAN.times)), PLAN.positions)


def resampled(period, *, time_optimal=False, plan=PLAN):
    return smoothed_trajectory(plan, START, LIMITS, Smoothing(period, time_optimal))


@pytest.mark.parametrize('period', [0.004, 0.05, 0.1])
def test_resampled_points_are_dense_equally_spaced_and_within_the_limits(period):
    motion = resampled(period)
    assert np.diff(motion.times) == pytest.approx(period)
    assert motion.times[0] == 0.0
    assert list(problems(motion, LIMITS)) == []
    assert np.array_equal(motion.positions[0], PLAN.positions[0])
    assert np.abs(motion.positions[-1] - PLAN.positions[-1]).max() < 1e-9
    assert not motion.velocities[0].any()
    assert not motion.velocities[-1].any()
    assert PLAN.duration <= motion.duration < 1.3 * PLAN.duration + period


def test_resampled_points_lie_on_the_one_smooth_motion():
    fine, coarse = resampled(0.004), resampled(0.04)
    assert coarse.positions[1:-1] == pytest.approx(
        fine.positions[10 : 10 * (len(coarse.times) - 1) : 10], abs=1e-6
    )
    errors, _ = passed(PLAN.positions, fine)
    assert errors.max() < 1e-4


def test_what_goes_over_the_wire_is_no_faster_than_the_joints():
    points = trajectory_points(resampled(0.05), START, LIMITS, unmapped(len(LIMITS.names)))
    assert all(0.0 < point.velocity <= 1.0 for point in points)
    assert [point.duration for point in points[1:]] == pytest.approx([0.05] * (len(points) - 1))


def test_time_optimal_needs_no_times_and_is_the_same_with_them():
    plan = untimed(POSITIONS_ONLY, LIMITS)
    check_limits(plan, LIMITS)
    check_start(plan, START, LIMITS, 0.01)
    motion = resampled(0.004, time_optimal=True, plan=plan)
    same = resampled(0.004, time_optimal=True)
    assert np.array_equal(motion.positions, same.positions)
    assert motion.duration <= resampled(0.004).duration
    assert motion.duration < resampled(0.004, plan=replace(PLAN, times=2.0 * PLAN.times)).duration


@pytest.mark.parametrize('thin', [False, True])
def test_a_goal_is_never_sent_along_the_faster_path_that_no_planner_has_checked(thin):
    """Between its points a plan is followed on the spline through them."""
    plan = untimed(POSITIONS_ONLY, LIMITS)
    sent = smoothed_trajectory(plan, START, LIMITS, Smoothing(0.004, time_optimal=True, thin=thin))
    spline, free = (
        smoothed(plan, LIMITS, Mode.TIME_OPTIMAL, refine=refine) for refine in (False, True)
    )
    assert sent.duration == pytest.approx(spline.duration, abs=0.005)
    assert free.duration < spline.duration - 0.02


@pytest.mark.parametrize('thin', [False, True])
def test_with_a_tolerance_the_noise_of_a_recording_is_not_sent(thin):
    """The times are kept, and the points that are sent pass each given one within it."""
    times = np.arange(251) / 125.0
    wave = 0.5 - 0.5 * np.cos(np.pi * times / times[-1])
    noise = np.random.default_rng(8).normal(size=(len(times), len(START))) * 2e-4
    recorded = Trajectory(LIMITS.names, times, START + 0.3 * wave[:, None] + noise)

    def sent(tolerance):
        how = Smoothing(0.02, thin=thin, deviation=1e-3, tolerance=tolerance)
        return smoothed_trajectory(recorded, recorded.positions[0], LIMITS, how)

    assert sent(0.0).duration > 1.5 * times[-1]
    motion = sent(1e-3)
    assert motion.duration < 1.05 * times[-1]
    lines = 1e-3 if thin else 0.0
    assert passed(recorded.positions, motion)[0].max() < 1e-3 + lines


@pytest.mark.parametrize(
    ('smoothing', 'words'),
    [
        (Smoothing(0.05, tolerance=1e-3), None),
        (Smoothing(0.05, thin=True, tolerance=5e-3), None),
        (Smoothing(time_optimal=True), None),
        (Smoothing(0.05, tolerance=0.99 * MIN_TOLERANCE), '0.00099 rad: must be 0, or 0.001'),
        (Smoothing(tolerance=1e-3), 'with smoothing = resample or thin'),
        (Smoothing(0.05, True, tolerance=1e-3), 'and timing = as_planned'),
    ],
)
def test_a_tolerance_is_for_motions_that_are_planned_in_the_times_given(smoothing, words):
    if words is None:
        check_tolerance(smoothing)
        return
    with pytest.raises(ValueError, match=words):
        check_tolerance(smoothing)


def test_the_driver_knows_the_least_tolerance_of_the_smoother():
    assert smoothed_module.MIN_TOLERANCE == MIN_TOLERANCE


def test_retiming_keeps_the_points_of_the_plan():
    plan = smoothed_trajectory(
        untimed(POSITIONS_ONLY, LIMITS), START, LIMITS, Smoothing(None, True)
    )
    assert np.array_equal(plan.positions, PLAN.positions)
    assert plan.times[0] == 0.0
    assert np.all(np.diff(plan.times) > 0.0)
    assert not plan.velocities[-1].any()
    motion = resampled(0.004, time_optimal=True)
    assert plan.duration == motion.duration
    assert passed(PLAN.positions, motion)[1][1:-1] == pytest.approx(plan.times[1:-1])


def test_retiming_leaves_repeated_points_out():
    positions = np.repeat(PLAN.positions, 3, axis=0)
    plan = untimed(Trajectory(LIMITS.names, np.zeros(len(positions)), positions), LIMITS)
    retimed = smoothed_trajectory(plan, START, LIMITS, Smoothing(None, True))
    assert np.array_equal(retimed.positions, PLAN.positions)


def test_a_first_point_with_a_time_is_gone_to_from_where_the_arm_is():
    start = np.zeros(6)
    plan = Trajectory(LIMITS.names, np.array([2.0]), START[None, :])
    for smoothing in (Smoothing(0.05), Smoothing(0.05, True), Smoothing(None, True)):
        motion = smoothed_trajectory(plan, start, LIMITS, smoothing)
        assert np.array_equal(motion.positions[0], start)
        assert np.abs(motion.positions[-1] - START).max() < 1e-9
    assert smoothed_trajectory(plan, start, LIMITS, Smoothing(0.05)).duration == pytest.approx(
        2.0, abs=0.3
    )


def test_a_plan_that_is_too_fast_becomes_slower_when_its_times_do_not_count():
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
def test_positions_are_checked_all_the_same(value, words):
    positions = PLAN.positions.copy()
    positions[2, 2] = value
    plan = Trajectory(LIMITS.names, np.zeros(len(positions)), positions)
    with pytest.raises(GoalRejectedError) as caught:
        check_limits(untimed(plan, LIMITS), LIMITS)
    assert words in str(caught.value)


def test_an_arm_outside_its_limits_is_said_to_be():
    start = START.copy()
    start[0] = 3.0
    plan = Trajectory(LIMITS.names, PLAN.times + 1.0, PLAN.positions)
    with pytest.raises(ValueError, match=r'joint_1: position 3 is outside the limits -2\.9'):
        smoothed_trajectory(plan, start, LIMITS, Smoothing(0.05))


READ = 'import sys; sys.stdin.buffer.read1(); '


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
        (READ + 'print("no trajectory" * 9)', 'the smoother sent a value of'),
        (READ + 'sys.exit(3)', 'the smoother ended with exit code 3'),
        (READ, 'the smoother ended with exit code 0'),
    ],
)
@pytest.mark.invariant(9)
def test_inv9_a_process_that_fails_is_an_error_of_its_goal(monkeypatch, code, said):
    async def start_worker(_module):
        pipe = asyncio.subprocess.PIPE
        return await asyncio.create_subprocess_exec(
            sys.executable, '-S', '-c', code, stdin=pipe, stdout=pipe
        )

    monkeypatch.setattr(smoothing_module, 'start_worker', start_worker)
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
