# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Speed scaling in the driver's own smoother: its motion, and goals of it in virtual time."""

import asyncio
from dataclasses import replace

import numpy as np
import pytest
from support.driver_harness import HOME, JOINTS, LIMITS, cell, options_of, pose, smooth_on_the_spot
from support.event_loop import now, until
from support.examples import one_in
from support.replacement_runs import goal, long_way
from support.speed_scaling import pace, progress, scale, slowed_on_the_way, submit

from epson_driver.driver.delivery.delivery import DeliveryRules
from epson_driver.driver.goal.goal import Tolerances
from epson_driver.driver.outcome import End
from epson_driver.driver.smoothing import Smoothing, SmoothingError
from epson_driver.driver.smoothing_worker import ScaledMotion, smoothed_trajectory
from epson_driver.motion import Trajectory
from epson_driver.motion.passages import passed

RESAMPLE = Smoothing(0.05)
REACTION_S = 1.0
"""When an arm is slower, s: after what the controller has, the answer, and a ramp."""


@pytest.fixture
def motions(monkeypatch):
    return smooth_on_the_spot(monkeypatch)


def resampling_cell(**options):
    return cell(smooth=True, **{'smoothing': RESAMPLE} | options)


def executed(way, smoothing, changes):
    """Return positions, velocities, accelerations with changes: (sample, share); the last is 1."""
    motion = ScaledMotion(way.trajectory, HOME, LIMITS, smoothing)
    samples, index, share = [], 0, 1.0
    for at, following in [*changes, (np.inf, 1.0), (np.inf, 1.0)]:
        while True:
            remainder = motion.after(index, share)
            block = remainder.samples
            columns = (block.positions, block.velocities, block.accelerations)
            samples[index:] = zip(*columns, strict=True)
            index = int(min(at, len(samples) - 1))
            rests = share == 0.0 and not block.velocities[-1].any()
            if index == at or rests or not remainder.left:
                break
        share = following
    return [np.array(column) for column in zip(*samples[: index + 1], strict=True)]


@pytest.mark.invariant(2)
@pytest.mark.parametrize('seed', one_in(8, range(24)))
def test_inv2_at_any_shares_it_keeps_the_limits_and_is_never_sooner_anywhere(seed):
    rng = np.random.default_rng([seed, 33])
    period = 0.004
    smoothing = Smoothing(period, time_optimal=bool(rng.integers(2)))
    way = long_way(str(rng.choice(['dense', 'planned'])), 2.0)
    changes, sample = [], 0
    for _ in range(rng.integers(1, 5)):
        sample += int(rng.integers(0, 150))
        changes.append((sample, float(rng.choice([0.0, rng.uniform(0.05, 1.0)]))))
    at_one = smoothed_trajectory(way.trajectory, HOME, LIMITS, smoothing)
    positions, velocities, accelerations = executed(way, smoothing, changes)
    assert np.abs(positions[-1] - way.trajectory.positions[-1]).max() < 1e-6
    assert not velocities[-1].any()
    bend = LIMITS.jerk * period**3
    assert np.all(np.abs(velocities) <= LIMITS.velocity * (1.0 + 1e-6))
    assert np.all(np.abs(accelerations) <= LIMITS.acceleration * (1.0 + 1e-6))
    assert np.all(np.abs(np.diff(accelerations, axis=0)) <= LIMITS.jerk * period * (1.0 + 1e-6))
    moved = (velocities[:-1] + velocities[1:]) * (period / 2.0)
    assert np.all(np.abs(np.diff(positions, axis=0) - moved) <= bend)
    times = period * np.arange(len(positions))
    scaled = Trajectory(LIMITS.names, times, positions, velocities)
    off, when = passed(at_one.positions[::5], scaled)
    assert off.max() < 1e-3  # it is on the same path
    assert np.all(when[:-1] >= at_one.times[::5][:-1] - 2.0 * period)


@pytest.mark.invariant(2)
@pytest.mark.parametrize('seed', one_in(20, range(20)))
async def test_inv2_a_lower_share_acts_behind_what_the_arm_needs_alone(motions, seed):
    """The controller would take points for a second, and yet the arm is slower much sooner."""
    share, times, places = await slowed_on_the_way(resampling_cell(), [seed, 34])
    assert pace(times, places, REACTION_S, max(times[-1], REACTION_S + 0.3)) <= share * 1.03
    assert motions[0].closed


@pytest.mark.invariant(2)
@pytest.mark.slow
@pytest.mark.parametrize('seed', range(18))
async def test_inv2_no_place_is_reached_sooner_than_at_full_speed(motions, seed):
    rng = np.random.default_rng([seed, 35])
    way = long_way(str(rng.choice(['dense', 'planned'])), 2.0)
    changes = [
        (float(rng.uniform(0.0, 1.0)), float(rng.choice([0.0, rng.uniform(0.1, 1.0)])))
        for _ in range(rng.integers(1, 4))
    ]
    seen = []
    for shares in ([], changes):
        async with resampling_cell() as (harness, _):
            since = now()
            first = submit(harness, way)
            for wait, share in shares:
                await asyncio.sleep(wait)
                scale(harness, share)
            await asyncio.sleep(1.0)
            scale(harness, 1.0)
            assert (await first.end()).end is End.SUCCEEDED, first.outcome
            seen.append(progress(harness, way.trajectory, since))
    (times, full), (slow_times, slow) = seen
    assert np.all(slow <= np.interp(slow_times, times, full) + 0.02), changes


@pytest.mark.slow
@pytest.mark.parametrize('delay', [0.06, 0.0, 0.4])
@pytest.mark.parametrize('shares', [(0.3,), (0.0, 1.0), (0.2, 0.0, 0.6), (0.5, 0.1, 1.0)])
async def test_the_goals_clock_goes_with_the_arm_and_its_tolerances_hold(
    monkeypatch, shares, delay
):
    smooth_on_the_spot(monkeypatch, delay)
    way = long_way('dense', 3.0)
    limit = Tolerances(np.full(JOINTS, 0.05), np.full(JOINTS, np.inf))
    async with resampling_cell() as (harness, _):
        first = submit(harness, replace(way, path_tolerance=limit, goal_time=0.3))
        await harness.until_moving()
        await asyncio.sleep(0.5)
        begun = now()
        for share in shares:
            scale(harness, share)
            await asyncio.sleep(1.2)
        outcome = await first.end()
        assert outcome.end is End.SUCCEEDED, outcome
        assert 'another speed' not in outcome.text
        left = (3.0 - 0.5 - 1.2 * sum(shares[:-1])) / shares[-1]
        assert first.ended_at - begun == pytest.approx(left + 1.2 * (len(shares) - 1), rel=0.25)


@pytest.mark.slow
async def test_a_pause_rests_on_the_way_and_a_stop_ends_it(motions):
    way = long_way('dense', 3.0)
    async with resampling_cell() as (harness, controller):
        first = submit(harness, way)
        await harness.until_moving()
        await asyncio.sleep(0.8)
        scale(harness, 0.0)
        await asyncio.sleep(REACTION_S)
        assert await harness.rests()
        assert not first.outcomes
        assert not controller.in_motion
        execution = first.handle.execution
        time, planned, speed = execution.desired
        assert not speed.any()
        assert np.abs(planned - harness.at).max() < 1e-3
        asked = len(motions[0].asked)
        await asyncio.sleep(10.0)
        assert execution.desired[0] == time
        assert len(motions[0].asked) == asked
        harness.driver.goal_queue.cancel(first.handle)
        assert (await first.end()).end is End.CANCELED
        scale(harness, 1.0)
        assert await harness.rests()
        assert motions[0].closed
        second = submit(harness, goal([0.8], pose(0.2)))
        assert (await second.end()).end is End.SUCCEEDED


@pytest.mark.parametrize('before', one_in(5, [0.1, 0.5, 0.25, 0.03, -0.03]))
@pytest.mark.parametrize('share', [0.0, 0.05])
async def test_a_share_set_just_before_the_end_is_no_trap(motions, share, before):
    way = long_way('dense', 1.5)
    async with resampling_cell() as (harness, _):
        first = submit(harness, way)
        await until(lambda: (first.handle.execution.desired or [0.0])[0] > 0.0)
        await asyncio.sleep(1.5 - before)
        scale(harness, share)
        await asyncio.sleep(8.0)
        scale(harness, 1.0)
        assert (await first.end()).end is End.SUCCEEDED, first.outcome
        assert abs(harness.at - way.trajectory.positions[-1]).max() < 1e-3


@pytest.mark.slow
async def test_a_goal_begins_at_the_share_of_the_moment_and_in_a_pause_later(motions):
    way = goal([0.0, 1.0], [HOME, pose(0.5)])
    async with resampling_cell() as (harness, _):
        scale(harness, 0.25)
        await asyncio.sleep(1.0)
        since = now()
        assert (await submit(harness, way).end()).end is End.SUCCEEDED
        assert 4.0 <= now() - since < 4.8
        speeds = [abs(each.velocities[0]) for at, each in harness.events.samples if at >= since]
        assert max(speeds) < 0.25 * 0.5 * 2.2
        scale(harness, 0.0)
        await asyncio.sleep(1.0)
        back = submit(harness, goal([0.0, 1.0], [pose(0.5), HOME]))
        await asyncio.sleep(3.0)
        assert await harness.rests()
        assert abs(harness.at - pose(0.5)).max() < 1e-3
        scale(harness, 1.0)
        assert (await back.end()).end is End.SUCCEEDED


@pytest.mark.parametrize(
    ('profile', 'smooth'),
    one_in(3, [('rc620', True), ('rc620', False), ('motoman', True)], several=True),
)
async def test_it_acts_with_every_kind_of_streamed_point(motions, profile, smooth):
    way = goal([0.0, 1.0, 2.0], [HOME, pose(0.3, 0.1), pose(0.6)])
    kind = {'profile': profile, **options_of(profile)}
    async with cell(smooth=smooth, smoothing=RESAMPLE, **kind) as (harness, _):
        first = submit(harness, way)
        await harness.until_moving()
        for share in (0.4, 0.0, 1.0):
            scale(harness, share)
            await asyncio.sleep(2.0)
        assert (await first.end()).end is End.SUCCEEDED, first.outcome
        assert np.abs(harness.at - pose(0.6)).max() < 1e-3


@pytest.mark.invariant(9)
@pytest.mark.parametrize('error', [SmoothingError('the smoother was ended'), KeyError('defect')])
async def test_inv9_a_smoother_that_is_gone_stops_the_goal_at_another_share(monkeypatch, error):
    smooth_on_the_spot(monkeypatch, error)
    async with resampling_cell() as (harness, _):
        first = submit(harness, long_way('dense', 3.0))
        await harness.until_moving()
        scale(harness, 0.5)
        outcome = await first.end()
        assert outcome.end is End.ABORTED
        assert 'the speed could not be changed any more' in outcome.text
        await asyncio.sleep(1.0)
        assert await harness.rests()


@pytest.mark.invariant(5)
async def test_inv5_a_smoother_that_is_gone_changes_nothing_in_how_a_canceled_goal_ends(motions):
    async def gone(index, share):
        await asyncio.sleep(0.05)
        raise SmoothingError('the smoother was ended')

    async with resampling_cell() as (harness, _):
        first = submit(harness, long_way('dense', 3.0))
        await harness.until_moving()
        motions[0].after = gone
        scale(harness, 0.5)
        await asyncio.sleep(0.02)
        harness.driver.goal_queue.cancel(first.handle)
        assert (await first.end()).end is End.CANCELED
        assert await harness.rests()


@pytest.mark.parametrize(
    ('smoothing', 'rules', 'scales'),
    [
        (RESAMPLE, DeliveryRules(), True),
        (Smoothing(0.05, time_optimal=True), DeliveryRules(), True),
        (Smoothing(0.15, thin=True), DeliveryRules(), False),
        (Smoothing(time_optimal=True), DeliveryRules(), False),
        (RESAMPLE, DeliveryRules(interface='download'), False),
        (RESAMPLE, DeliveryRules(scales_speed=True), False),
    ],
)
async def test_it_is_for_points_that_are_resampled_and_streamed(motions, smoothing, rules, scales):
    async with cell(enabled=False, smoothing=smoothing, delivery=rules) as (harness, _):
        assert harness.driver.goal_queue.smoother.scales is scales
        assert harness.driver.goal_queue.scaling.in_smoother is scales
