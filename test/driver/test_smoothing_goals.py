# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Goals planned in a separate process end exactly once, whatever happens during planning."""

import asyncio
import os
import signal

import numpy as np
import pytest
from support.driver_harness import (
    LIMITS,
    cell,
    plan_in_real_time,
    pose,
    smooth_in_process,
)
from support.event_loop import PATIENCE, run, stand_still, until

from epson_driver.driver import smoothing
from epson_driver.driver.goal.goal import untimed
from epson_driver.driver.outcome import End, ErrorCode
from epson_driver.driver.smoothing import Smoothing, SmoothingProcess
from epson_driver.motion import Trajectory, smooth
from epson_driver.motion import smoothed as smoothed_module
from epson_driver.sim_controller.condition.states import Event

RESAMPLE = Smoothing(0.1)

REAL_TIME = True
"""The smoother is a separate process."""


def process_of(harness):
    return harness.driver.goal_queue.smoother


@pytest.fixture
def slow(monkeypatch):
    """Suppress every reply of the smoother's process; return the processes with a request."""
    requested = []
    result_of = smoothing.result_of

    async def seen(process, *arguments):
        process.send_signal(signal.SIGSTOP)  # so it cannot end before it is killed
        requested.append(process)
        return await result_of(process, *arguments)

    async def never(stream, kinds):
        await asyncio.sleep(PATIENCE)

    monkeypatch.setattr(smoothing, 'result_of', seen)
    monkeypatch.setattr(smoothing, 'next_value', never)
    return requested


def nothing_sent(harness):
    return harness.driver.motion_link.statistics.frames_sent == 0


async def test_goal_is_resampled_and_executed():
    async with cell(smoothing=RESAMPLE) as (harness, _):
        goal = harness.submit(pose(0.2, 0.1), pose(0.3, -0.1, 0.2))
        assert goal.handle.execution.state.value == 'preparing'
        outcome = await goal.end()
        assert outcome.end is End.SUCCEEDED
        assert np.abs(harness.at - pose(0.3, -0.1, 0.2)).max() < 1e-6
        sent = goal.handle.execution.goal.trajectory
        assert len(sent.times) > 10
        assert np.diff(sent.times) == pytest.approx(0.1)
        assert max(target for target, _ in goal.feedback) == len(sent.times) - 1
        assert (await harness.submit(pose(0.1)).end()).end is End.SUCCEEDED


async def test_goal_without_times_is_retimed_and_executed():
    async with cell(smoothing=Smoothing(None, True)) as (harness, _):
        positions = np.stack([harness.at, pose(0.2), pose(0.2, 0.3)])
        plan = untimed(Trajectory(LIMITS.names, np.zeros(3), positions), LIMITS)
        goal = harness.execute(plan)
        assert (await goal.end()).end is End.SUCCEEDED
        assert np.abs(harness.at - pose(0.2, 0.3)).max() < 1e-6
        sent = goal.handle.execution.goal.trajectory
        assert sent.duration < 1.06 * smooth(positions, LIMITS).duration


async def test_result_reports_that_no_faster_motion_was_found(monkeypatch):
    smooth_in_process(monkeypatch)
    monkeypatch.setattr(smoothed_module, 'fastest', lambda *_, **__: None)
    async with cell(smoothing=Smoothing(None, True)) as (harness, _):
        positions = np.stack([harness.at, pose(0.2), pose(0.2, 0.3)])
        plan = untimed(Trajectory(LIMITS.names, np.zeros(3), positions), LIMITS)
        outcome = await harness.execute(plan).end()
        assert outcome.text.endswith('it followed the spline, because no faster motion was found')


@pytest.mark.invariant(10)
async def test_inv10_time_optimal_goal_keeps_the_scaling_of_its_plan():
    async with cell(smoothing=Smoothing(None, True)) as (harness, _):
        times = np.linspace(0.0, 3.0, 31)
        share = 0.5 - 0.5 * np.cos(np.pi * times / times[-1])
        plan = Trajectory(LIMITS.names, times, harness.at + share[:, None] * pose(0.5, 0.3))
        goal = harness.execute(untimed(plan, LIMITS), planned=plan)
        assert (await goal.end()).end is End.SUCCEEDED
        sent = goal.handle.execution.goal.trajectory
        assert 0.7 * times[-1] < sent.duration < 1.02 * times[-1]
        peak = np.pi / 2 * 0.5 / times[-1]
        assert np.abs(sent.velocities).max() < 1.001 * peak


@pytest.mark.invariant(5)
async def test_inv5_cancel_while_planning_ends_the_goal_as_canceled(slow):
    async with cell(smoothing=RESAMPLE) as (harness, _):
        goal = harness.submit(pose(0.5))
        await until(lambda: slow)
        harness.driver.goal_queue.cancel(goal.handle)
        outcome = await goal.end()
        assert (outcome.end, outcome.text) == (End.CANCELED, 'canceled, the arm is at rest')
        assert not harness.at.any()
        await until(lambda: slow[0].returncode is not None)
        assert slow[0].returncode == -signal.SIGKILL
        assert harness.gate is None


@pytest.mark.invariant(5)
async def test_inv5_stop_while_planning_ends_the_goal_as_aborted(slow):
    async with cell(smoothing=RESAMPLE) as (harness, _):
        goal = harness.submit(pose(0.5))
        await until(lambda: slow)
        text = await harness.commands.stop()
        assert goal.outcome.end is End.ABORTED
        assert goal.outcome.text == 'stopped on request, the arm is at rest'
        assert goal.outcome.text in text


@pytest.mark.invariant(4, 5)
async def test_inv4_inv5_estop_while_planning_ends_the_goal_and_nothing_is_sent(slow):
    async with cell(smoothing=RESAMPLE) as (harness, controller):
        goal = harness.submit(pose(0.5))
        await until(lambda: slow)
        controller.apply(Event.ESTOP_PRESS)
        outcome = await goal.end()
        assert outcome.end is End.ABORTED
        assert 'E-stop' in outcome.text
        assert 'before its first point' in outcome.text
        assert nothing_sent(harness)
        assert 'E-stop' in harness.gate


@pytest.mark.invariant(5)
async def test_inv5_lost_link_while_planning_ends_the_goal(slow):
    async with cell(smoothing=RESAMPLE) as (harness, _):
        goal = harness.submit(pose(0.5))
        await until(lambda: slow)
        harness.driver.motion_link.transport.abort()
        assert 'the motion link was lost' in (await goal.end()).text
        assert 'the motion link was lost' in harness.gate
        assert nothing_sent(harness)


@pytest.mark.invariant(5)
async def test_inv5_new_goal_while_planning_replaces_the_first():
    async with cell(smoothing=RESAMPLE) as (harness, _):
        first = harness.submit(pose(2.0), pose(-2.0), step=3.0)
        second = harness.submit(pose(0.1))
        assert first.handle.execution.state.value == 'stopping'
        assert (await second.end()).end is End.SUCCEEDED
        assert first.outcome.text == 'replaced by a new goal, the arm is at rest'
        assert np.abs(harness.at - pose(0.1)).max() < 1e-6


@pytest.mark.invariant(5)
async def test_inv5_end_of_the_driver_ends_the_goal_and_the_smoothing_process(slow):
    async with cell(smoothing=RESAMPLE) as (harness, _):
        goal = harness.submit(pose(0.5))
        await until(lambda: slow)
        await harness.stop()
        assert goal.outcome.end is End.ABORTED
        assert slow[0].returncode == -signal.SIGKILL


async def test_repeatedly_cancelled_driver_leaves_no_smoothing_process(slow):
    async with cell(smoothing=RESAMPLE) as (harness, _):
        harness.submit(pose(0.5))
        await until(lambda: slow)
        process_of(harness).make_ready()
        waiting = await process_of(harness)._next
        while harness.running:
            harness._task.cancel()
            await asyncio.sleep(0)
        assert slow[0].returncode == waiting.returncode == -signal.SIGKILL
        process_of(harness).make_ready()
        assert process_of(harness)._next is None


async def test_killed_smoothing_process_ends_its_goal_and_the_next_goal_succeeds():
    async with cell(smoothing=RESAMPLE) as (harness, _):
        ready = await process_of(harness)._next
        os.kill(ready.pid, signal.SIGKILL)
        await ready.wait()
        outcome = await harness.submit(pose(0.2)).end()
        assert outcome.code is ErrorCode.INVALID_GOAL
        assert outcome.text == 'the smoother was ended by SIGKILL'
        assert harness.driver.goal_queue.unsmoothed == 1
        assert nothing_sent(harness)
        assert harness.gate is None
        assert (await harness.submit(pose(0.2)).end()).end is End.SUCCEEDED


async def test_planning_ends_at_its_timeout(slow, monkeypatch):
    monkeypatch.setattr(smoothing, 'TIMEOUT_S', 0.05)

    async with cell(smoothing=RESAMPLE) as (harness, _):
        outcome = await harness.submit(pose(0.5)).end()
        assert outcome.code is ErrorCode.INVALID_GOAL
        assert outcome.text == 'no smooth motion was found within 0.05 s'
        assert nothing_sent(harness)


async def test_plan_is_refused_if_the_arm_moved_during_planning(monkeypatch):
    async with cell(smoothing=RESAMPLE) as (harness, _):
        prepared = SmoothingProcess.prepared

        async def moved(process, trajectory, start, share):
            plan, remark = await prepared(process, trajectory, start + 0.5, share)
            return Trajectory(plan.joint_names, plan.times, plan.positions + 0.5), remark

        monkeypatch.setattr(SmoothingProcess, 'prepared', moved)
        outcome = await harness.submit(pose(0.5)).end()
        assert outcome.code is ErrorCode.INVALID_GOAL
        assert 'the trajectory starts at 0.5 rad' in outcome.text
        assert nothing_sent(harness)


@pytest.mark.slow
def test_stalled_event_loop_reads_new_joints_before_it_starts_a_goal(monkeypatch):
    plan_in_real_time(monkeypatch)
    prepared = SmoothingProcess.prepared

    async def stalled(process, trajectory, start, share):
        motion = await prepared(process, trajectory, start, share)
        stand_still(1.0)
        return motion

    monkeypatch.setattr(SmoothingProcess, 'prepared', stalled)

    async def scenario():
        async with cell(smoothing=RESAMPLE) as (harness, _):
            outcome = await harness.submit(pose(0.2)).end()
            assert outcome.end is End.SUCCEEDED, outcome.text

    run(scenario(), patience=3600.0)


async def test_smoothing_process_exists_only_if_needed_and_ends_with_the_driver():
    async with cell() as (harness, _):
        assert process_of(harness)._next is None
    async with cell(smoothing=RESAMPLE) as (harness, _):
        ready = await process_of(harness)._next
        assert ready.returncode is None
    assert ready.returncode is not None


@pytest.mark.slow
def test_joint_states_continue_during_long_planning(monkeypatch):
    plan_in_real_time(monkeypatch)  # independent of the machine's speed

    async def scenario():
        async with cell(smoothing=RESAMPLE) as (harness, _):
            angles = 0.5 * np.sin(np.linspace(0.0, 60.0, 1500))
            goal = harness.submit(*(pose(angle) for angle in angles[1:]), step=0.02)
            samples = len(harness.events.samples)
            await until(lambda: goal.handle.execution.state.value != 'preparing')
            assert len(harness.events.samples) - samples > 20
            harness.driver.goal_queue.cancel(goal.handle)
            outcome = await goal.end()
            assert outcome.end is End.CANCELED, outcome.text

    run(scenario(), patience=3600.0)
