# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Old, implausible or missing joints inhibit motion (invariants 6 and 8)."""

import asyncio
import re
import struct

import pytest
from support.driver_harness import (
    LIMITS,
    Harness,
    ScriptedController,
    answer,
    cell,
    frame,
    pose,
    scripted_cell,
)
from support.event_loop import now, run, stand_still, until

from epson_driver.driver.arm_commands import CommandError
from epson_driver.driver.outcome import End, ErrorCode
from epson_driver.driver.state.robot_state import DISTRUST_TIME_S, MAX_POSE_AGE_S
from epson_driver.processes import processes

pytestmark = pytest.mark.invariant(6, 8)


def position(*values):
    return frame(10, 1, 0, struct.pack('<i10f', 0, *values, *[0.0] * (10 - len(values))))


def feedback(*values, valid=2):
    ten = [*values, *[0.0] * (10 - len(values))]
    return frame(15, 1, 0, struct.pack('<iif30f', 0, valid, 1.0, *ten, *[0.0] * 20))


async def more(harness, count):
    """Wait for `count` more samples."""
    seen = len(harness.events.samples)
    await until(lambda: len(harness.events.samples) >= seen + count)


async def test_inv6_single_joint_feedback_does_not_suppress_joint_positions():
    async with scripted_cell(enabled=False) as (harness, scripted):
        for _ in range(3):
            seen = len(harness.events.samples)
            received = harness.driver.state_link.statistics.frames_received
            scripted.extra = feedback(0.001)
            await more(harness, 20)
            arrived = harness.driver.state_link.statistics.frames_received - received
            assert len(harness.events.samples) - seen >= arrived / 2 - 4  # the others are STATUS
            assert any(s.positions[0] > 0.0 for _, s in harness.events.samples[seen:])


async def test_joint_feedback_sent_with_each_joint_position_replaces_it():
    async with scripted_cell(enabled=False) as (harness, scripted):
        for _ in range(20):
            scripted.extra = feedback(0.001, valid=6)
            await until(lambda: not scripted.extra)
        harness.events.samples.clear()
        for _ in range(20):
            scripted.extra = feedback(0.001, valid=6)
            await until(lambda: not scripted.extra)
        assert {float(s.positions[0]) for _, s in harness.events.samples} <= {
            struct.unpack('<f', struct.pack('<f', 0.001))[0]
        }
        scripted.extra = b''  # positions are used again without feedback
        await until(lambda: harness.events.samples[-1][1].positions[0] == 0.0)


@pytest.mark.parametrize(
    ('message', 'text'),
    [
        (position(1e10), r'joint_1 is reported at 1e\+10 rad, outside its range with margin,'),
        (position(0.0, 0.0, 3.75), 'joint_3 is reported to have jumped by 3.75 rad in'),
        (position(0.0, float('nan')), 'joint 2: position nan is not finite'),
        (feedback(0.0, 1e10), r'joint_2 is reported at 1e\+10 rad'),
    ],
    ids=['out of range', 'jump', 'nan', 'feedback'],
)
async def test_inv6_implausible_joints_stop_the_goal_and_are_not_published(message, text, caplog):
    def reply(sequence):
        return answer(1, sequence) if sequence < 0 else b''

    async with scripted_cell(reply) as (harness, scripted):
        goal = harness.submit(pose(0.5))
        scripted.extra = message
        outcome = await goal.end()
        assert outcome.end is End.ABORTED
        assert 'implausible joint state: ' in outcome.text
        assert 'implausible joint state: ' in harness.gate
        assert harness.driver.state_link.statistics.bad_frames['joints'] == 1
        start = now()
        await harness.commands.enable()
        assert now() - start > 0.5 * DISTRUST_TIME_S
        assert not any(sample.positions.any() for _, sample in harness.events.samples)
        assert harness.driver.state_link.connected
    assert 'joint state dropped: ' in caplog.text
    assert re.search(text, caplog.text)


async def test_inv6_enable_is_refused_with_implausible_joints():
    async with ScriptedController() as scripted, Harness(scripted.ports) as harness:
        scripted.shows_joints = False

        async def impossible():
            while True:
                scripted.extra = position(LIMITS.position_max[0] + 0.2)
                await asyncio.sleep(0.005)

        task = asyncio.create_task(impossible())
        await until(lambda: harness.driver.motion_link.connected and harness.driver.robot.status)
        await until(lambda: harness.driver.state_link.statistics.bad_frames['joints'])
        with pytest.raises(CommandError, match=r'implausible joint state: joint_1 is re'):
            await harness.commands.enable()
        assert harness.gate is not None
        assert not harness.events.samples
        task.cancel()


async def test_inv6_goal_is_refused_if_the_pose_is_old():
    """The STATUS continues, and the link has a long timeout."""
    async with scripted_cell(state_timeout=60.0) as (harness, scripted):
        scripted.shows_joints = False
        await more_statuses(harness, 3)
        stopped = now()
        await until(lambda: now() > stopped + 1.1 * MAX_POSE_AGE_S)
        goal = harness.submit(pose(0.5))
        outcome = await goal.end()
        assert outcome.code is ErrorCode.INVALID_GOAL
        assert 'the newest joint state is ' in outcome.text
        assert scripted.received == []
        with pytest.raises(CommandError, match='the newest joint state is'):
            await harness.commands.enable()


@pytest.mark.invariant(6)
@pytest.mark.parametrize(
    ('timeout', 'age', 'starts'),
    [(1.0, 0.28, True), (1.0, 0.32, False), (0.1, 0.08, True), (0.1, 0.12, False)],
)
async def test_inv6_goal_starts_only_if_the_last_joints_are_recent(timeout, age, starts):
    """The controller sends STATUS and no more joints."""
    async with scripted_cell(state_timeout=timeout) as (harness, scripted):
        scripted.shows_joints = False
        await more_statuses(harness, 1)
        last = harness.driver.robot.sample
        await until(lambda: now() > last.measured + age)
        harness.submit(pose(0.5))
        await until(lambda: harness.gate is not None)
        assert bool(scripted.received) is starts
        # the gate closes 1 s after the last joints, also during a goal
        assert now() - last.time == pytest.approx(1.0, abs=0.001)


async def more_statuses(harness, count):
    seen = len(harness.events.statuses)
    await until(lambda: len(harness.events.statuses) >= seen + count)


@pytest.mark.slow
def test_stalled_event_loop_reads_messages_before_it_checks_their_age(tmp_path):
    """A false alarm stops a robot in production."""

    async def scenario():
        controller = await asyncio.to_thread(processes.sim_controller, tmp_path / 'log')
        try:
            ports = await asyncio.to_thread(controller.ports)
            async with Harness(ports, state_timeout=0.3) as harness:
                await harness.ready()
                await harness.commands.enable()
                for at in (0.1, 0.0):
                    stand_still(1.5)
                    goal = harness.submit(pose(at), start=harness.at)
                    assert not goal.outcomes
                    outcome = await goal.end()
                    assert outcome.end is End.SUCCEEDED, outcome
                stand_still(1.5)
                await more(harness, 400)
                assert harness.gate is None
                assert harness.driver.state_link.statistics.connections == 1
                assert harness.driver.robot.status is not None
                ages = [s.time - s.measured for _, s in harness.events.samples[-400:]]
                assert max(ages) > 1.0  # delayed samples have their true age
        finally:
            await asyncio.to_thread(controller.end)

    run(scenario(), real_time=True)


async def test_stalled_process_uses_one_time_for_all_checks_of_a_goal():
    """A pose that is fresh at the first check is not too old at the second."""
    async with cell() as (harness, _):
        robot = harness.driver.robot
        judge = robot.stale

        def stalled(now):
            stale = judge(now)
            asyncio.get_running_loop().now += 2 * MAX_POSE_AGE_S
            return stale

        robot.stale = stalled
        goal = harness.submit(pose(0.1))
        robot.stale = judge
        assert not goal.outcomes
        assert (await goal.end()).end is End.SUCCEEDED


@pytest.mark.invariant(5)
@pytest.mark.parametrize('end', ['cancel', 'newer', 'fault'])
async def test_inv5_goal_that_waits_for_a_fresh_state_ends_once(end):
    async with scripted_cell() as (harness, scripted):
        stand_still(2 * MAX_POSE_AGE_S)
        goal = harness.submit(pose(0.1))
        assert not goal.outcomes
        if end == 'cancel':
            harness.driver.goal_queue.cancel(goal.handle)
            assert goal.outcome.text == 'canceled before it could start'
        elif end == 'newer':
            newer = harness.submit(pose(0.2))
            assert goal.outcome.text == 'replaced by a newer goal before it could start'
            await until(lambda: scripted.received)
            assert not newer.outcomes
        else:
            harness.driver.fault('for the test')
            assert goal.outcome.text.startswith('for the test')
        await more(harness, 50)
        assert len(goal.outcomes) == 1
        assert bool(scripted.received) == (end == 'newer')
