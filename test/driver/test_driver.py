# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The driver: goals, faults, state and shutdown."""

import asyncio
import logging
import struct
from itertools import pairwise

import numpy as np
import pytest
from support.driver_harness import (
    JOINTS,
    Harness,
    Submitted,
    cell,
    frame,
    pose,
    scripted_cell,
    simulated,
)
from support.event_loop import now, until

from epson_driver.driver.goal.goal import GoalSettings
from epson_driver.driver.outcome import End, ErrorCode
from epson_driver.driver.remedy import Remedy
from epson_driver.sim_controller.condition.states import Event
from epson_driver.simple_message import Status

# --- goals ------------------------------------------------------------------------------------


async def test_goal_is_executed():
    async with cell() as (harness, _):
        goal = harness.submit(pose(0.2, 0.1), pose(0.3, -0.1, 0.2))
        assert harness.driver.goal_queue.busy
        outcome = await goal.end()
        assert outcome.end is End.SUCCEEDED
        assert outcome.code is ErrorCode.SUCCESSFUL
        assert np.abs(harness.at - pose(0.3, -0.1, 0.2)).max() < 1e-6
        assert not harness.driver.goal_queue.busy
        assert await harness.rests()
        targets = [target for target, _ in goal.feedback]
        assert targets == sorted(targets)
        assert set(targets) >= {1, 2}  # the arm starts at point 0
        assert len(goal.feedback) > 20  # one call per sample


@pytest.mark.invariant(4)
async def test_inv4_goal_before_enable_is_refused_and_nothing_is_sent():
    async with cell(enabled=False) as (harness, controller):
        controller.apply(Event.MOTORS_ON)
        await until(lambda: harness.driver.robot.status.drives_powered == 1)
        outcome = harness.submit(pose(0.5)).outcome
        assert outcome.end is End.ABORTED
        assert outcome.code is ErrorCode.INVALID_GOAL
        assert outcome.remedy is Remedy.ENABLE
        assert harness.driver.motion_link.statistics.frames_sent == 0


@pytest.mark.invariant(2)
async def test_inv2_goal_is_refused_while_the_arm_brakes():
    async with cell() as (harness, _):
        lost = harness.submit(pose(0.8))
        await until(lambda: harness.driver.robot.sample.velocities[0] > 0.3)
        harness.driver.goal_queue.execution.fault('lost for the test')
        early = harness.submit(start=harness.at)
        assert lost.outcome.end is End.ABORTED
        assert early.outcome.code is ErrorCode.INVALID_GOAL
        assert 'the arm is moving (joint_1 at' in early.outcome.text
        await until(lambda: not harness.driver.robot.sample.velocities.any())
        assert (await harness.submit(pose(0.1), start=harness.at).end()).end is End.SUCCEEDED


@pytest.mark.invariant(3)
async def test_inv3_replaced_goal_ends_after_the_arm_rests():
    async with cell() as (harness, controller):
        first = harness.submit(pose(1.0))
        await harness.until_moving()
        second = harness.submit(pose(0.0))
        assert not first.outcomes
        assert not second.outcomes
        await until(lambda: first.outcomes)
        assert not controller.moving or second.handle.execution is not None
        assert first.outcome.end is End.ABORTED
        assert first.outcome.text == 'replaced by a new goal, the arm is at rest'
        await second.end()
        assert first.ended_at <= second.ended_at
        assert await harness.rests()


async def test_replacement_that_starts_elsewhere_is_refused():
    async with cell() as (harness, _):
        harness.driver.goal_queue.start_tolerance = 1e-4
        harness.submit(pose(1.0))
        await harness.until_moving()
        second = harness.submit(pose(0.2))
        outcome = await second.end()
        assert outcome.end is End.ABORTED
        assert outcome.code is ErrorCode.INVALID_GOAL
        assert 'joint_1: the trajectory starts at' in outcome.text
        assert 'the limit is 0.0001 rad' in outcome.text
        assert await harness.rests()


async def test_newest_of_several_goals_is_executed():
    async with cell() as (harness, _):
        harness.driver.goal_queue.start_tolerance = 1.0
        first = harness.submit(pose(1.0))
        await harness.until_moving()
        second = harness.submit(pose(0.9))
        third = harness.submit(pose(0.1))
        assert 'replaced by a newer goal before it could start' in second.outcome.text
        assert (await third.end()).end is End.SUCCEEDED
        assert first.outcome.end is End.ABORTED


async def test_motion_link_reconnects_after_a_missing_reply():
    """A late reply has no number and would count as the reply to the newest request."""
    settings = GoalSettings(reply_timeout=0.2)
    async with scripted_cell(lambda _: b'', settings=settings) as (harness, scripted):
        statistics = harness.driver.motion_link.statistics
        assert statistics.connections == 1
        outcome = await harness.submit(pose(0.5)).end()
        assert 'no reply to point 0 of 2' in outcome.text
        await until(lambda: statistics.connections == 2)
        await until(lambda: harness.driver.motion_link.connected)
        # one STOP on each connection
        await until(lambda: scripted.received == [0, -4, -4])
        assert 'no reply to point 0 of 2' in harness.gate


async def test_cancel_of_a_waiting_goal_does_not_change_the_running_goals_end():
    async with cell() as (harness, _):
        first = harness.submit(pose(1.0))
        await harness.until_moving()
        second = harness.submit(pose(0.5))
        harness.driver.goal_queue.cancel(second.handle)
        assert second.outcome.end is End.CANCELED
        assert second.outcome.text == 'canceled before it could start'
        assert (await first.end()).text.startswith('replaced by a new goal')


@pytest.mark.invariant(3, 5)
async def test_inv3_inv5_planned_goal_replaces_no_other_and_does_not_start_after_a_stop():
    """A motion planned from the arm's position is rejected while another runs, and after STOP."""
    async with cell() as (harness, _):
        queue = harness.driver.goal_queue

        def submit_planned(plan):
            planned = Submitted(first.handle.goal)
            planned.handle.plan = plan
            queue.submit(planned.handle)
            return planned

        first = harness.submit(pose(0.5))
        plan = queue.plans.begin()
        assert submit_planned(plan).outcome.text.startswith('another motion runs or waits')
        assert plan.why is None
        assert (await first.end()).end is End.SUCCEEDED
        await harness.commands.stop()
        rejected = submit_planned(plan).outcome
        assert (rejected.end, rejected.code) == (End.ABORTED, ErrorCode.INVALID_GOAL)
        assert rejected.text == 'stopped on request before it could start'
        assert (await harness.submit(pose(0.6)).end()).end is End.SUCCEEDED


@pytest.mark.invariant(8)
async def test_inv8_messages_read_together_have_one_arrival_time():
    """A process that stalls while it handles a burst must not see a pause in it."""
    async with scripted_cell(enabled=False) as (harness, scripted):
        scripted.shows_joints = False
        take = harness.events.on_joints

        def slowly(sample):
            take(sample)
            asyncio.get_running_loop().now += 0.02

        harness.events.on_joints = slowly
        seen = len(harness.events.samples)
        scripted.extra = 30 * frame(10, 1, 0, bytes(44))
        await until(lambda: len(harness.events.samples) == seen + 30)
        assert len(set(list(harness.driver.robot.arrivals)[-29:])) == 1


# --- faults -----------------------------------------------------------------------------------


@pytest.mark.invariant(4)
async def test_inv4_estop_ends_the_goal_and_closes_the_gate():
    async with cell() as (harness, controller):
        goal = harness.submit(pose(1.0))
        await harness.until_moving()
        pressed = now()
        controller.apply(Event.ESTOP_PRESS)
        outcome = await goal.end()
        assert goal.ended_at - pressed < 0.2
        assert outcome.end is End.ABORTED
        assert harness.gate is not None
        await until(lambda: harness.driver.robot.status.e_stopped == 1)
        assert 'E-stop' in harness.gate
        assert 'E-stop' in harness.submit(pose(0.5)).outcome.text
        controller.apply(Event.ESTOP_RELEASE)
        await until(lambda: not controller.moving)
        controller.apply(Event.RESET)
        controller.apply(Event.MOTORS_ON)
        await until(lambda: harness.driver.robot.status.drives_powered == 1)
        assert 'E-stop' in harness.gate
        assert 'E-stop' in harness.submit(pose(0.5)).outcome.text
        assert await harness.rests()
        await harness.commands.enable()
        assert (await harness.submit(harness.at).end()).end is End.SUCCEEDED


async def test_fault_ends_a_waiting_goal_with_the_same_reason():
    async with cell() as (harness, _):
        first = harness.submit(pose(1.0))
        await harness.until_moving()
        second = harness.submit(pose(0.5))
        harness.driver.fault('for the test')
        assert 'for the test' in first.outcome.text
        assert second.outcome.text == 'for the test'
        assert harness.gate == 'for the test'


async def test_lost_motion_link_ends_the_goal_and_keeps_the_status():
    async with cell() as (harness, _):
        goal = harness.submit(pose(1.0))
        await harness.until_moving()
        transport = harness.driver.motion_link.transport
        before = len(harness.events.statuses)
        transport.abort()
        outcome = await goal.end()
        assert 'the motion link was lost' in outcome.text
        assert 'the motion link was lost' in harness.gate
        await until(lambda: harness.events.links[-1][0] == 'connected')
        assert 'the motion link was lost' in harness.gate
        later = [status for _, status in harness.events.statuses[before:]]
        assert Status() not in later  # the state link stays connected


@pytest.mark.invariant(6)
async def test_inv6_joints_become_unknown_while_the_status_continues():
    async with scripted_cell(lambda _: b'') as (harness, scripted):
        goal = harness.submit(pose(0.5))
        scripted.shows_joints = False
        outcome = await goal.end()
        assert outcome.end is End.ABORTED
        assert 'no joint state' in outcome.text
        assert 'no joint state' in harness.gate
        assert harness.driver.robot.sample is None
        assert harness.driver.state_link.connected


async def test_missing_status_closes_the_gate_and_is_reported_unknown():
    async with scripted_cell() as (harness, scripted):
        scripted.shows_status = False
        await until(lambda: harness.gate is not None)
        assert 'no STATUS' in harness.gate
        assert harness.driver.robot.status is None
        await until(lambda: harness.events.status == Status())
        scripted.shows_status = True
        await until(lambda: harness.events.status != Status())
        assert 'no STATUS' in harness.gate


# --- state ---------------------------------------------------------------------------


@pytest.mark.invariant(8)
async def test_inv8_reply_on_the_state_port_is_not_a_state():
    """The body of a FAILURE has no meaning (REP-I0006)."""
    async with scripted_cell(enabled=False) as (harness, scripted):
        garbage = struct.pack('<i10f', 0, *[7.0] * 10)
        seen = len(harness.events.samples)
        scripted.extra = frame(10, 3, 2, garbage) + frame(10, 3, 1, garbage)
        scripted.extra += frame(13, 3, 2, struct.pack('<7i', 0, 1, 99, 1, 1, 1, 0))
        await until(lambda: len(harness.events.samples) > seen + 5)
        for _, sample in harness.events.samples:
            assert not sample.positions.any()
        assert all(status.e_stopped == 0 for _, status in harness.events.statuses[-3:])
        assert harness.driver.state_link.statistics.unsolicited_replies == 3


async def test_feedback_messages_are_joint_states():
    async with scripted_cell(enabled=False) as (harness, scripted):
        scripted.shows_joints = False
        seen = len(harness.events.samples)
        positions, velocities = [0.03125] * 10, [0.25] * 10
        body = struct.pack('<iif30f', 0, 6, 1.0, *positions, *velocities, *[0.0] * 10)
        scripted.extra = frame(15, 1, 0, body)
        await until(lambda: len(harness.events.samples) > seen)
        sample = harness.events.samples[-1][1]
        assert sample.positions.tolist() == [0.03125] * JOINTS
        assert sample.velocities.tolist() == [0.25] * JOINTS
        no_position = struct.pack('<iif30f', 0, 4, 1.0, *[9.0] * 30)
        scripted.extra = frame(15, 1, 0, no_position)
        received = harness.driver.state_link.statistics.frames_received
        await until(lambda: harness.driver.state_link.statistics.frames_received > received + 5)
        assert harness.events.samples[-1][1] is sample


async def test_link_state_is_the_worse_of_both_links():
    async with simulated() as (_, ports):
        async with Harness(ports) as harness:
            await harness.ready()
            before = len(harness.events.links)
            harness.driver.motion_link.transport.abort()
            await until(lambda: len(harness.events.links) > before)
            await until(lambda: harness.events.links[-1][0] == 'connected')
            after = [name for name, _ in harness.events.links[before:]]
            assert after == ['backing_off', 'connecting', 'connected']
            assert harness.driver.state_link.statistics.connections == 1
        names = [name for name, _ in harness.events.links]
        assert names[0] in ('disconnected', 'connecting')
        assert names[-1] == 'disconnected'
        assert all(a != b for a, b in pairwise(names))  # on change only


# --- shutdown ----------------------------------------------------------------------------------


@pytest.mark.invariant(3)
async def test_inv3_shutdown_brings_the_arm_to_rest_and_ends_the_goal():
    async with cell() as (harness, controller):
        goal = harness.submit(pose(0.5), step=8.0)
        await harness.until_moving()
        await harness.driver.shut_down()
        assert goal.outcome.text == 'the driver was shut down, the arm is at rest'
        assert not controller.moving
        assert 'shut' in harness.gate
        assert 'shut' in harness.submit(pose(0.1)).outcome.text


async def test_cancelled_driver_ends_its_goal():
    async with cell() as (harness, controller):
        goal = harness.submit(pose(1.0))
        await harness.until_moving()
        await harness.stop()
        assert goal.outcome.end is End.ABORTED
        assert 'the driver ended' in goal.outcome.text
        await until(lambda: not controller.moving)


async def test_estop_door_and_reset_of_a_disabled_arm_are_logged_once(caplog):
    async with cell(enabled=False) as (harness, controller):
        controller.apply(Event.MOTORS_ON)
        await until(lambda: harness.driver.robot.status.motion_possible == 1)
        with caplog.at_level(logging.INFO, 'epson_driver.driver.driver'):
            controller.apply(Event.DOOR_OPEN)
            await until(lambda: harness.driver.robot.status.drives_powered == 0)
            controller.apply(Event.DOOR_CLOSE)
            controller.apply(Event.ESTOP_PRESS)
            await until(lambda: harness.driver.robot.status.e_stopped == 1)
            controller.apply(Event.ESTOP_RELEASE)
            controller.apply(Event.RESET)
            await until(lambda: harness.driver.robot.status.e_stopped == 0)
        lines = [
            record.getMessage() for record in caplog.records if record.name.endswith('driver')
        ]
    assert [line.partition(' is ')[0] for line in lines] == [
        'the motors are off',
        'the E-stop',
        'cleared: the E-stop',
    ]
