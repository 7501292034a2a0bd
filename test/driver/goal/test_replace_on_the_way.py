# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Goals that replace each other without a stop: driver and smooth controller, in virtual time."""

import asyncio

import numpy as np
import pytest
from support.driver_harness import (
    Harness,
    ScriptedController,
    SlowPlanner,
    Submitted,
    answer,
    cell,
    pose,
)
from support.event_loop import until
from support.examples import one_in
from support.replacement_runs import goal, long_way, replacement

from epson_driver.driver.configuration import check_on_the_way
from epson_driver.driver.delivery.delivery_factory import delivery_rules
from epson_driver.driver.goal.goal import GoalSettings
from epson_driver.driver.outcome import End, ErrorCode
from epson_driver.driver.smoothing import Smoothing, usual_smoothing
from epson_driver.profiles import load_controller_profile

MOMENTS = 50
"""Random moments of a motion at which it is replaced."""

QUICK = 1
"""Of those, in `make test`."""


def submit(harness, some_goal):
    submitted = Submitted(some_goal)
    harness.driver.goal_queue.submit(submitted.handle)
    return submitted


def elsewhere(*joints, seconds=0.8):
    """Return a goal of one point."""
    return goal([seconds], pose(*joints))


async def on_its_way(harness, seconds=0.4):
    """Return a long goal that has run for so long, s."""
    first = submit(harness, long_way('planned'))
    await harness.until_moving()
    await asyncio.sleep(seconds)
    return first


@pytest.mark.invariant(2)
@pytest.mark.parametrize(
    'seed',
    [
        *range(QUICK),
        *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(QUICK, MOMENTS)),
    ],
)
async def test_inv2_replaced_at_a_random_moment_the_arm_keeps_all_limits_and_never_rests(
    seed, monkeypatch
):
    """By the exact extrema of what the arm commanded. A rest is 1 ms in which nothing moves."""
    judge(await replacement(monkeypatch, seed, on_the_way=True))


@pytest.mark.invariant(2)
@pytest.mark.parametrize('delays', one_in(4, [(0.06,), (0.015,), (0.12,), (*[0.015] * 9, 0.08)]))
@pytest.mark.parametrize('seed', one_in(8, range(8)))
async def test_inv2_a_controller_that_plans_slowly_keeps_all_limits_and_never_rests(
    seed, delays, monkeypatch
):
    planner = SlowPlanner(*delays)
    judge(await replacement(monkeypatch, seed, on_the_way=True, planner=planner))


async def test_the_arm_goes_on_before_a_third_of_a_second_is_over():
    """What is left of the old goal is short: the arm does not follow it to where it had to."""
    async with cell(smooth=True, on_the_way=True) as (harness, _):
        first = await on_its_way(harness, 1.0)
        lead = harness.driver.goal_queue.execution.reach
        assert lead < 0.3
        submit(harness, elsewhere(0.1, 0.2))
        await until(lambda: first.outcomes)


def judge(result):
    assert result.new.startswith('succeeded'), result
    assert 'without a stop' in result.old, result
    assert result.joined == 1
    assert result.rests == 0, result
    assert result.worst <= 1.000001, result
    assert result.off < 1e-3, result


@pytest.mark.invariant(5)
async def test_inv5_the_goal_that_is_left_ends_as_aborted_at_once_and_no_stop_is_sent():
    async with cell(smooth=True, on_the_way=True) as (harness, _):
        first = await on_its_way(harness)
        sent = harness.driver.stopper.ours
        second = submit(harness, elsewhere(0.1, 0.2))
        await until(lambda: first.outcomes)
        assert first.outcome.end is End.ABORTED
        assert first.outcome.code is ErrorCode.INVALID_GOAL
        assert 'replaced by a new goal on the way to point' in first.outcome.text
        assert harness.driver.robot.sample.velocities.any()
        assert sent
        assert harness.driver.stopper.over
        assert (await second.end()).end is End.SUCCEEDED
        assert first.ended_at < second.ended_at
        assert harness.driver.goal_queue.joined == 1
        assert await harness.rests()


@pytest.mark.slow
async def test_the_newest_of_many_goals_is_where_the_arm_ends():
    async with cell(smooth=True, on_the_way=True) as (harness, _):
        goals = [await on_its_way(harness, 0.3)]
        for joint in (0.3, -0.2, 0.5, 0.1):
            goals.append(submit(harness, elsewhere(joint, 0.1)))
            await asyncio.sleep(0.25)
        both = [submit(harness, elsewhere(0.2)), submit(harness, elsewhere(0.35))]
        assert (await both[1].end()).end is End.SUCCEEDED
        assert all(each.outcome.end is End.ABORTED for each in (*goals, both[0]))
        assert harness.driver.goal_queue.joined in (len(goals), len(goals) + 1)
        assert abs(harness.at[0] - 0.35) < 1e-3


@pytest.mark.invariant(4)
@pytest.mark.parametrize('late', one_in(3, [0.05, 0.0, 0.4]))
async def test_inv4_an_estop_about_the_moment_ends_both_and_the_arm_stays_still(late):
    async with cell(smooth=True, on_the_way=True) as (harness, controller):
        first = await on_its_way(harness)
        second = submit(harness, elsewhere(-0.4, 0.2))
        await asyncio.sleep(late)
        controller.press_estop()
        await until(lambda: first.outcomes and second.outcomes)
        assert second.outcome.end is End.ABORTED
        assert 'E-stop' in second.outcome.text
        assert first.outcome.end is End.ABORTED
        assert 'E-stop' in harness.gate
        await until(lambda: not controller.moving)
        await until(lambda: not harness.driver.robot.sample.velocities.any())
        assert await harness.rests()
        assert submit(harness, elsewhere(0.0)).outcome.end is End.ABORTED


@pytest.mark.invariant(3)
async def test_inv3_cancel_after_the_change_brings_the_arm_to_rest():
    async with cell(smooth=True, on_the_way=True) as (harness, _):
        first = await on_its_way(harness)
        second = submit(harness, elsewhere(-0.4, 0.2))
        await until(lambda: first.outcomes)
        harness.driver.goal_queue.cancel(second.handle)
        assert (await second.end()).end is End.CANCELED
        assert await harness.rests()
        assert harness.gate is None
        assert abs(harness.at[0] + 0.4) > 0.05


async def replaced_and_unanswered(scripted, harness):
    """Return two goals: of the first a point is on its way, and the second waits for its reply."""
    await harness.ready()
    await harness.commands.enable()
    first = submit(harness, elsewhere(0.3))
    await until(lambda: 0 in scripted.received)
    second = submit(harness, elsewhere(0.2))
    assert not first.outcomes
    return first, second


def silent(sequence):
    return answer(1, sequence) if sequence == -4 else b''


@pytest.mark.invariant(3)
async def test_inv3_cancel_of_a_goal_that_waits_stops_the_arm_for_it():
    async with (
        ScriptedController(silent) as scripted,
        Harness(scripted.ports, on_the_way=True) as harness,
    ):
        first, second = await replaced_and_unanswered(scripted, harness)
        harness.driver.goal_queue.cancel(second.handle)
        assert second.outcome.end is End.CANCELED
        assert (await first.end()).text == 'replaced by a new goal; the arm stands'
        assert scripted.received == [0, -4]


@pytest.mark.invariant(3)
async def test_inv3_a_reply_that_does_not_come_in_time_has_the_arm_stopped_as_ever():
    async with (
        ScriptedController(silent) as scripted,
        Harness(scripted.ports, on_the_way=True) as harness,
    ):
        first, second = await replaced_and_unanswered(scripted, harness)
        assert (await first.end()).text == 'replaced by a new goal; the arm stands'
        assert not second.outcomes
        await until(lambda: scripted.received == [0, -4, 0])
        assert harness.driver.goal_queue.joined == 0


@pytest.mark.invariant(4)
async def test_inv4_a_gate_that_closes_meanwhile_is_looked_at_before_the_first_point():
    replies = []

    def reply(sequence):
        replies.append(sequence)
        return answer(1, sequence) if sequence == -4 else b''

    async with (
        ScriptedController(reply) as scripted,
        Harness(scripted.ports, on_the_way=True) as harness,
    ):
        first, second = await replaced_and_unanswered(scripted, harness)
        harness.driver.gate.close('closed for the test')
        scripted.motion.write(answer(1, 0))
        assert (await first.end()).text == 'replaced by a new goal; the arm stands'
        outcome = await second.end()
        assert 'closed for the test' in outcome.text
        assert scripted.received == [0, -4]


@pytest.mark.invariant(1)
async def test_inv1_a_goal_that_begins_elsewhere_stops_the_arm_and_is_refused_as_ever():
    async with cell(smooth=True, on_the_way=True) as (harness, _):
        first = await on_its_way(harness)
        wrong = submit(harness, goal([0.0, 1.0], [pose(2.0), pose(2.1)]))
        outcome = await wrong.end()
        assert outcome.code is ErrorCode.INVALID_GOAL
        assert 'joint_1: the trajectory starts at 2 rad' in outcome.text
        assert first.outcome.text == 'replaced by a new goal; the arm stands'
        assert await harness.rests()


@pytest.mark.slow
async def test_a_goal_is_replaced_in_a_pause_and_goes_on_with_the_speed_scaling():
    async with cell(smooth=True, on_the_way=True) as (harness, _):
        queue = harness.driver.goal_queue
        first = await on_its_way(harness)
        queue.scaling.set(0.0, asyncio.get_running_loop().time())
        await asyncio.sleep(2.0)
        still = harness.at
        second = submit(harness, elsewhere(0.1, 0.2))
        await until(lambda: first.outcomes)
        await asyncio.sleep(1.0)
        np.testing.assert_array_equal(harness.at, still)
        queue.scaling.set(0.5, asyncio.get_running_loop().time())
        assert (await second.end()).end is End.SUCCEEDED
        assert abs(harness.at[1] - 0.2) < 1e-3


async def test_without_the_parameter_goals_are_replaced_by_a_stop():
    async with cell(smooth=True) as (harness, _):
        first = await on_its_way(harness)
        second = submit(harness, elsewhere(0.1, 0.2))
        assert (await second.end()).end is End.SUCCEEDED
        assert first.outcome.text == 'replaced by a new goal; the arm stands'


@pytest.mark.invariant(3)
async def test_inv3_a_goal_on_a_link_that_is_lost_ends_with_the_one_that_waits():
    async with (
        ScriptedController(silent) as scripted,
        Harness(scripted.ports, on_the_way=True, settings=GoalSettings()) as harness,
    ):
        first, second = await replaced_and_unanswered(scripted, harness)
        scripted.motion.close()
        assert 'link was lost' in (await first.end()).text
        assert 'link was lost' in (await second.end()).text
        assert 'link was lost' in harness.gate


@pytest.mark.parametrize(
    ('name', 'interface', 'message', 'words'),
    [
        ('rc620', 'streaming', 'joint_traj_pt', None),
        ('rc700a', 'streaming', 'joint_traj_pt', None),
        ('generic', 'streaming', 'joint_traj_pt', None),
        ('rc620', 'download', 'joint_traj_pt', 'interface = download'),
        ('rc620', 'streaming', 'joint_traj_pt_full', 'point_message = joint_traj_pt_full'),
        ('motoman', 'streaming', 'joint_traj_pt_full', 'the controller motoman is not known'),
        ('thesis', 'streaming', 'joint_traj_pt', 'the controller thesis is not known'),
        ('fanuc', 'streaming', 'joint_traj_pt', 'the controller fanuc is not known'),
        ('spel', 'streaming', 'joint_traj_pt', 'the controller spel is not known'),
    ],
)
def test_where_it_cannot_be_it_is_refused_at_the_start(name, interface, message, words):
    profile = load_controller_profile(name)
    rules = delivery_rules(profile, interface, message)
    if words is None:
        check_on_the_way(profile, rules, usual_smoothing(profile.program))
        with pytest.raises(ValueError, match='begins at rest'):
            check_on_the_way(profile, rules, Smoothing(time_optimal=True))
    else:
        with pytest.raises(ValueError, match=words):
            check_on_the_way(profile, rules, Smoothing())
