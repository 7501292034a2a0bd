# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Drivers as programs use them, with one client and with two."""

import asyncio
import contextlib
import logging
import struct
import threading
from itertools import pairwise

import numpy as np
import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.task import Future
from support.driver_harness import (
    JOINTS,
    LIMITS,
    Harness,
    ScriptedController,
    Submitted,
    cell,
    frame,
    pose,
    scripted_cell,
    simulated,
)
from support.event_loop import now, run, until

from epson_driver.driver.goal.goal import GoalSettings
from epson_driver.driver.outcome import End, ErrorCode
from epson_driver.driver.remedy import Remedy
from epson_driver.node.node import ClientNode
from epson_driver.node.ros_log import RosLogHandler
from epson_driver.processes import processes
from epson_driver.processes.processes import free_ros_domain
from epson_driver.sim_controller.condition.states import Event
from epson_driver.simple_message import ByteOrder, Dialect, Real, Status

# --- goals ------------------------------------------------------------------------------------


async def test_a_goal_is_executed():
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
        assert set(targets) >= {1, 2}  # it is at point 0 already
        assert len(goal.feedback) > 20  # every sample is one call


@pytest.mark.invariant(4)
async def test_inv4_a_goal_before_enable_is_refused_and_nothing_is_sent():
    """docs/invariants.md, 4."""
    async with cell(enabled=False) as (harness, controller):
        controller.apply(Event.MOTORS_ON)
        await until(lambda: harness.driver.robot.status.drives_powered == 1)
        outcome = harness.submit(pose(0.5)).outcome
        assert outcome.end is End.ABORTED
        assert outcome.code is ErrorCode.INVALID_GOAL
        assert outcome.remedy is Remedy.ENABLE
        assert harness.driver.motion_link.statistics.frames_sent == 0


@pytest.mark.invariant(2)
async def test_inv2_a_goal_is_refused_while_the_arm_still_moves():
    """docs/invariants.md, 2: a motion begins at rest. Here the arm brakes after a lost goal."""
    async with cell() as (harness, _):
        lost = harness.submit(pose(0.8))
        await until(lambda: harness.driver.robot.sample.velocities[0] > 0.3)
        harness.driver.goal_queue.execution.fault('lost for the test')
        early = harness.submit(start=harness.at)
        assert lost.outcome.end is End.ABORTED
        assert early.outcome.code is ErrorCode.INVALID_GOAL
        assert 'the arm moves (joint_1 at' in early.outcome.text
        await until(lambda: not harness.driver.robot.sample.velocities.any())
        assert (await harness.submit(pose(0.1), start=harness.at).end()).end is End.SUCCEEDED


@pytest.mark.invariant(3)
async def test_inv3_a_replaced_goal_ends_after_the_arm_rests():
    """docs/invariants.md, 3."""
    async with cell() as (harness, controller):
        first = harness.submit(pose(1.0))
        await harness.until_moving()
        second = harness.submit(pose(0.0))
        assert not first.outcomes
        assert not second.outcomes
        await until(lambda: first.outcomes)
        assert not controller.moving or second.handle.execution is not None
        assert first.outcome.end is End.ABORTED
        assert first.outcome.text == 'replaced by a new goal; the arm stands'
        await second.end()
        assert first.ended_at <= second.ended_at
        assert await harness.rests()


async def test_a_replacement_that_fits_where_the_arm_stops_is_executed():
    async with cell() as (harness, _):
        harness.driver.goal_queue.start_tolerance = 1.0
        first = harness.submit(pose(1.0))
        await harness.until_moving()
        second = harness.submit(pose(0.2))
        assert (await second.end()).end is End.SUCCEEDED
        assert first.outcome.end is End.ABORTED
        assert first.ended_at < second.ended_at
        assert abs(harness.at[0] - 0.2) < 1e-6


async def test_a_replacement_that_does_not_fit_is_refused_with_its_reason():
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


async def test_the_newest_of_several_goals_is_executed():
    async with cell() as (harness, _):
        harness.driver.goal_queue.start_tolerance = 1.0
        first = harness.submit(pose(1.0))
        await harness.until_moving()
        second = harness.submit(pose(0.9))
        third = harness.submit(pose(0.1))
        assert 'replaced by a newer goal before it could start' in second.outcome.text
        assert (await third.end()).end is End.SUCCEEDED
        assert first.outcome.end is End.ABORTED


async def test_a_replacement_does_not_start_when_the_arm_was_not_brought_to_rest():
    """The controller answers no STOP: nobody knows whether the arm stands."""
    async with ScriptedController(lambda _: b'') as scripted:
        settings = GoalSettings(reply_timeout=0.2)
        async with Harness(scripted.ports, settings=settings) as harness:
            await harness.ready()
            await harness.commands.enable()
            first = harness.submit(pose(0.5))
            second = harness.submit(pose(0.2))
            await first.end()
            assert 'standstill' in first.outcome.text
            assert second.outcome.end is End.ABORTED
            assert 'did not bring the arm to rest' in second.outcome.text
            await harness.commands.disable()
            assert set(scripted.received) == {0, -4}
            assert scripted.received.count(0) == 1


async def test_after_a_missing_reply_the_motion_link_starts_anew():
    """Late replies without a number would be taken for the answers to whatever was asked last."""
    async with ScriptedController(lambda _: b'') as scripted:
        settings = GoalSettings(reply_timeout=0.2)
        async with Harness(scripted.ports, settings=settings) as harness:
            await harness.ready()
            await harness.commands.enable()
            statistics = harness.driver.motion_link.statistics
            assert statistics.connections == 1
            outcome = await harness.submit(pose(0.5)).end()
            assert 'no reply to point 0 of 2' in outcome.text
            await until(lambda: statistics.connections == 2)
            await until(lambda: harness.driver.motion_link.connected)
            # once before the link was closed, and first on the new one
            await until(lambda: scripted.received == [0, -4, -4])
            assert 'no reply to point 0 of 2' in harness.gate


async def test_cancel_of_a_goal_that_waits_leaves_the_running_one_its_end():
    async with cell() as (harness, _):
        first = harness.submit(pose(1.0))
        await harness.until_moving()
        second = harness.submit(pose(0.5))
        harness.driver.goal_queue.cancel(second.handle)
        assert second.outcome.end is End.CANCELED
        assert second.outcome.text == 'canceled before it could start'
        assert (await first.end()).text.startswith('replaced by a new goal')


@pytest.mark.invariant(5)
async def test_inv5_a_goal_that_is_to_be_alone_replaces_none():
    async with cell() as (harness, _):
        first = harness.submit(pose(0.5))
        plan = harness.driver.goal_queue.plans.begin()
        second = Submitted(first.handle.goal)
        second.handle.alone = True
        harness.driver.goal_queue.submit(second.handle)
        assert second.outcome.text.startswith('another motion runs or waits')
        assert plan.why is None
        assert (await first.end()).end is End.SUCCEEDED


@pytest.mark.invariant(8)
async def test_inv8_what_was_read_at_once_arrived_at_once_however_slowly_it_is_gone_through():
    """docs/invariants.md, 8: a process held up within a burst must not take that for a pause."""
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
async def test_inv4_an_estop_ends_the_goal_at_once_and_the_gate_stays_closed():
    """docs/invariants.md, 4."""
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


async def test_motors_off_end_the_goal_and_a_waiting_one():
    async with cell() as (harness, controller):
        first = harness.submit(pose(1.0))
        await harness.until_moving()
        controller.apply(Event.MOTORS_OFF)
        await first.end()
        await until(lambda: harness.gate is not None)
        assert 'motors are off' in harness.gate
        assert first.outcome.end is End.ABORTED


async def test_a_fault_ends_the_goal_that_waits_with_the_same_reason():
    async with cell() as (harness, _):
        first = harness.submit(pose(1.0))
        await harness.until_moving()
        second = harness.submit(pose(0.5))
        harness.driver.fault('somebody pulled the plug')
        assert 'somebody pulled the plug' in first.outcome.text
        assert second.outcome.text == 'somebody pulled the plug'
        assert harness.gate == 'somebody pulled the plug'


async def test_a_lost_motion_link_ends_the_goal_and_does_not_blur_the_status():
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
        assert Status() not in later  # the state link told all the time


@pytest.mark.invariant(4, 6)
@pytest.mark.slow
def test_inv4_inv6_a_killed_controller_that_comes_back_moves_nothing(tmp_path):
    """docs/invariants.md, 4 and 6."""

    async def scenario():
        start = await asyncio.to_thread(_started, tmp_path / 'first.log')
        process, ports = start
        again = None
        try:
            async with Harness(ports) as harness:
                await harness.ready()
                await harness.commands.enable()
                goal = harness.submit(pose(1.0))
                await harness.until_moving()
                killed = now()
                process.kill()
                outcome = await goal.end()
                assert goal.ended_at - killed < 0.5
                assert 'link was lost' in outcome.text
                assert 'link was lost' in harness.gate
                await until(lambda: harness.driver.robot.sample is None)
                assert harness.driver.robot.status is None
                assert 'not enabled' in harness.submit(pose(0.5), start=pose()).outcome.text
                await until(lambda: not harness.driver.motion_link.connected)
                down = now()
                samples = len(harness.events.samples)
                await asyncio.sleep(2.3)
                assert len(harness.events.samples) == samples
                statuses = [each for each in harness.events.statuses if each[0] >= down]
                assert {status for _, status in statuses} == {Status()}
                times = [down, *(time for time, _ in statuses), now()]
                assert max(b - a for a, b in pairwise(times)) < 1.3
                again, _ = await asyncio.to_thread(_started, tmp_path / 'again.log', ports)
                back = now()
                await harness.ready()
                assert now() - back < 2.0
                assert 'link was lost' in harness.gate
                assert 'not enabled' in harness.submit(pose(0.5)).outcome.text
                assert await harness.rests()
                await harness.commands.enable()
                assert (await harness.submit(pose(0.2)).end()).end is End.SUCCEEDED
        finally:
            for each in (process, again):
                if each is not None:
                    await asyncio.to_thread(each.end)

    run(scenario(), real_time=True)  # another process


def _started(log, ports=None):
    process = processes.sim_controller(log, ports=ports)
    return process, process.ports()


@pytest.mark.invariant(6)
async def test_inv6_joints_that_stop_while_the_status_goes_on_are_not_taken_for_fresh():
    """docs/invariants.md, 6."""
    async with scripted_cell(lambda _: b'') as (harness, scripted):
        goal = harness.submit(pose(0.5))
        scripted.shows_joints = False
        outcome = await goal.end()
        assert outcome.end is End.ABORTED
        assert 'no joint state' in outcome.text
        assert 'no joint state' in harness.gate
        assert harness.driver.robot.sample is None
        assert harness.driver.state_link.connected


async def test_a_status_that_stops_closes_the_gate_and_is_said_to_be_unknown():
    async with scripted_cell() as (harness, scripted):
        scripted.shows_status = False
        await until(lambda: harness.gate is not None)
        assert 'no STATUS' in harness.gate
        assert harness.driver.robot.status is None
        await until(lambda: harness.events.status == Status())
        scripted.shows_status = True
        await until(lambda: harness.events.status != Status())
        assert 'no STATUS' in harness.gate


async def test_a_silent_state_link_is_lost_after_its_timeout():
    async with (
        ScriptedController() as scripted,
        Harness(scripted.ports, state_timeout=0.2) as harness,
    ):
        await harness.ready()
        await harness.commands.enable()
        scripted.shows_joints = scripted.shows_status = False
        silent = now()
        await until(lambda: harness.gate is not None)
        assert 0.15 < now() - silent < 0.6
        assert 'silent for 0.2 s' in harness.gate
        assert harness.driver.robot.sample is None


# --- the state road ---------------------------------------------------------------------------


@pytest.mark.invariant(8)
async def test_inv8_a_reply_on_the_state_port_is_no_state():
    """docs/invariants.md, 8; REP-I0006: the body of a FAILURE means nothing."""
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


async def test_feedback_messages_are_joints_too():
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


async def test_every_state_message_is_one_event():
    async with cell(enabled=False) as (harness, _):
        link = harness.driver.state_link
        await until(lambda: len(harness.events.samples) >= 100)
        known = [each for each in harness.events.statuses if each[1] != Status()]
        # the first joints have no velocity yet
        assert len(harness.events.samples) + 1 + len(known) == link.statistics.frames_received
        assert abs(len(harness.events.samples) / len(known) - 10.0) < 2.0


@pytest.mark.parametrize('real', Real)
@pytest.mark.parametrize('order', ByteOrder)
async def test_points_are_written_in_byte_order_and_real_width_of_the_state(order, real):
    dialect = Dialect(order, real)

    async with simulated(dialect) as (_, ports), Harness(ports) as harness:
        await harness.ready()
        await harness.commands.enable()
        assert (await harness.submit(pose(0.1)).end()).end is End.SUCCEEDED
        assert harness.driver.motion_link.dialect == dialect


async def test_the_link_state_is_the_worse_of_both():
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


# --- the end ----------------------------------------------------------------------------------


@pytest.mark.invariant(3)
async def test_inv3_shut_down_brings_the_arm_to_rest_and_ends_the_goal():
    """docs/invariants.md, 3."""
    async with cell() as (harness, controller):
        goal = harness.submit(pose(0.5), step=8.0)  # slow enough to stop at once
        await harness.until_moving()
        await harness.driver.shut_down()
        assert goal.outcome.text == 'the driver was shut down; the arm stands'
        assert not controller.moving
        assert 'shut' in harness.gate
        assert 'shut' in harness.submit(pose(0.1)).outcome.text


async def test_a_driver_that_is_cancelled_ends_its_goal():
    async with cell() as (harness, controller):
        goal = harness.submit(pose(1.0))
        await harness.until_moving()
        await harness.stop()
        assert goal.outcome.end is End.ABORTED
        assert 'the driver ended' in goal.outcome.text
        await until(lambda: not controller.moving)  # the controller stops for a lost client


@pytest.mark.invariant(2)
async def test_inv2_nothing_outside_the_limits_arrives_at_the_controller():
    """docs/invariants.md, 2: a plan at the very limit is executed, and the arm stays inside."""
    async with cell() as (harness, _):
        top = np.array(harness.at)
        top[4] = LIMITS.position_max[4]
        assert (await harness.submit(top).end()).end is End.SUCCEEDED
        positions = np.array([sample.positions for _, sample in harness.events.samples])
        assert np.all(positions <= LIMITS.position_max.astype(np.float32) + 1e-6)
        assert abs(harness.at[4] - LIMITS.position_max[4]) < 1e-6


PORTS = ('motion', 'state', 'io', 'remote')


@pytest.fixture
def make_node(monkeypatch):
    """Return a function that makes a served node of a namespace for a controller's ports."""
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    context, served = rclpy.Context(), Future()
    rclpy.init(context=context, domain_id=free_ros_domain())
    executor = SingleThreadedExecutor(context=context)
    nodes = []

    def make(namespace, ports):
        overrides = [Parameter(f'{port}_port', value=getattr(ports, port)) for port in PORTS]
        node = Node('arm', namespace=namespace, context=context, parameter_overrides=overrides)
        nodes.append(node)
        executor.add_node(node)
        return node

    thread = threading.Thread(target=executor.spin_until_future_complete, args=(served,))
    thread.start()
    yield make
    served.set_result(None)
    thread.join()
    executor.shutdown()
    for node in nodes:
        node.destroy_node()
    context.shutdown()


@contextlib.asynccontextmanager
async def driven(node):
    """Make a client of a node and run it."""
    client = ClientNode(node)
    task = asyncio.create_task(client.run())
    yield client
    await client.shut_down()
    task.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await task


async def test_each_drives_its_own_arm_and_stays_when_the_other_is_shut_down(make_node):
    async with (
        simulated() as (_, its),
        simulated() as (_, others),
        driven(make_node('left', its)) as first,
    ):
        async with driven(make_node('right', others)) as second:
            clients = (first, second)
            await until(lambda: all(c.driver.robot.status for c in clients))
            await until(lambda: all(c.driver.motion_link.connected for c in clients))
            await second.commands.enable()
            assert second.driver.gate.reason is None
            assert first.driver.gate.reason is not None
            await first.commands.enable()
        seen = len(first.driver.robot.arrivals)
        await until(lambda: len(first.driver.robot.arrivals) > seen + 20)
        assert first.driver.gate.reason is None
        assert not second.driver.state_link.connected


def test_what_a_driver_says_is_said_by_its_node(make_node, capfd):
    log = logging.getLogger('epson_driver')

    async def scenario():
        async with simulated() as (_, its), simulated() as (_, others):
            left, right = make_node('left', its), make_node('right', others)
            handler = RosLogHandler(left.get_logger())
            log.addHandler(handler)
            try:
                async with driven(left), driven(right) as second:
                    await until(lambda: second.driver.motion_link.connected)
            finally:
                log.removeHandler(handler)

    level = log.level
    log.setLevel(logging.INFO)
    try:
        run(scenario())
    finally:
        log.setLevel(level)
    said = capfd.readouterr().err
    assert '[right.arm]: motion link connected' in said
    assert '[right.arm]: arm disabled' not in said  # nobody had enabled it
