# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A driver with the simulated controller of each profile: streaming, download and Motoman."""

import asyncio
import contextlib
import itertools
import re
from dataclasses import replace

import numpy as np
import pytest
from support.driver_harness import (
    HOME,
    JOINTS,
    LIMITS,
    Harness,
    ScriptedController,
    cell,
    options_of,
    pose,
    scripted_cell,
)
from support.event_loop import until
from support.examples import one_in, quickly

from epson_driver.driver.delivery.delivery import DeliveryRules, delivery_rules
from epson_driver.driver.delivery.reply_rejection import RESULTS, SUBCODES, reply_rejection
from epson_driver.driver.delivery.streaming import MIN_DURATION_S
from epson_driver.driver.goal.goal import GoalSettings, cause_timeout
from epson_driver.driver.goal.goal_states import GoalState
from epson_driver.driver.outcome import End, ErrorCode
from epson_driver.driver.state.joint_mapping import joint_mapping
from epson_driver.motion import Trajectory
from epson_driver.profiles import load_controller_profile
from epson_driver.sim_controller.condition.states import Event
from epson_driver.simple_message import (
    ByteOrder,
    CommType,
    JointPosition,
    JointTrajPt,
    JointTrajPtFull,
    MotionCtrl,
    MotionReply,
    Opaque,
    ReplyCode,
    decode,
    reply,
)
from epson_driver.simple_message.motoman import Command, Invalid, NotReady, Result

PROFILES = ('simulated', 'generic', 'fanuc', 'abb', 'motoman')


@contextlib.asynccontextmanager
async def cell_of(profile, interface=None, **options):
    """Run a driver with the controller of a profile; yield both and all packets received."""
    if isinstance(profile, str):
        profile = load_controller_profile(profile)
    options.setdefault(
        'settings',
        GoalSettings(cause_timeout=cause_timeout(profile.state), require_planned_speed=False),
    )
    options = options_of(profile, interface) | options
    async with cell(profile=profile, **options) as (harness, controller):
        yield harness, controller, watch(controller)


def watch(controller):
    """Return a list that collects the packets received by the motion program."""
    packets = []
    take = controller.program.receive

    def receive(frame, *rest):
        packets.append(decode(frame))
        return take(frame, *rest)

    controller.program.receive = receive
    return packets


def where(controller):
    """Return the controller's joint positions, rad."""
    return np.array(controller.joint_position().joints[:JOINTS])


def plan(times, positions, velocities=None):
    return Trajectory(
        LIMITS.names, np.array(times, dtype=float), np.array(positions, dtype=float), velocities
    )


A = pose(0.2, 0.05, 0.1)
B = pose(0.1, -0.1, 0.0, 0.2)


def line():
    return plan([0.0, 0.3], [HOME, A])


def there_and_back():
    return plan([0.0, 0.3, 0.6], [HOME, A, HOME])


def dense():
    """Return 20 points with velocities along a straight line with a smooth start and end."""
    fraction = np.linspace(0.0, 1.0, 20)
    smooth, rate = 3 * fraction**2 - 2 * fraction**3, 6 * fraction - 6 * fraction**2
    return plan(fraction, np.outer(smooth, B), np.outer(rate, B))


# ---- the same plans on every controller


@pytest.mark.parametrize('name', quickly(['motoman', 'fanuc'], PROFILES, several=False))
async def test_three_plans_succeed_on_every_controller(name):
    async with cell_of(name) as (harness, controller, _):
        for goal in (line(), there_and_back(), dense()):
            start = plan([0.0, 0.5], [where(controller), HOME])
            assert (await harness.execute(start).end()).end is End.SUCCEEDED
            outcome = await harness.execute(goal).end()
            assert outcome.end is End.SUCCEEDED, outcome
            assert not controller.in_motion
            end = goal.positions[-1]
            assert np.abs(where(controller) - end).max() < 1e-4


@pytest.mark.parametrize('name', one_in(2, ['simulated', 'generic', 'abb']))
@pytest.mark.parametrize('interface', ['streaming', 'download'])
async def test_both_interfaces_execute_a_plan(name, interface):
    async with cell_of(name, interface) as (harness, controller, received):
        outcome = await harness.execute(there_and_back()).end()
        assert outcome.end is End.SUCCEEDED, outcome
        expected = {
            'streaming': [(CommType.SERVICE_REQUEST, sequence) for sequence in (0, 1, 2)],
            'download': [(CommType.TOPIC, sequence) for sequence in (-1, 1, -3)],
        }
        assert [(p.comm_type, p.message.sequence) for p in received] == expected[interface]
        assert not controller.in_motion


@pytest.mark.parametrize(
    ('name', 'interface', 'message', 'text'),
    [
        (
            'simulated',
            'download',
            'joint_traj_pt_full',
            'points are downloaded as joint_traj_pt only',
        ),
        ('motoman', 'streaming', 'joint_traj_pt', 'supports joint_traj_pt_full only'),
    ],
)
def test_contradictory_delivery_parameters_are_refused(name, interface, message, text):
    with pytest.raises(ValueError, match=text):
        delivery_rules(load_controller_profile(name), interface, message)


# ---- download


async def test_too_long_download_is_refused_before_sending():
    async with cell_of('abb') as (harness, _, received):
        times = np.arange(101) * 0.05
        shares = np.linspace(0.0, 1.0, 101)
        outcome = await harness.execute(plan(times, np.outer(shares, A))).end()
        assert outcome.end is End.ABORTED
        assert outcome.code is ErrorCode.INVALID_GOAL
        assert re.search(r'101 points, .* keeps 100 ', outcome.text), outcome.text
        assert received == []
        allowed = plan(times[:100], np.outer(shares, A)[:100])
        assert (await harness.execute(allowed).end()).end is End.SUCCEEDED


async def test_download_sends_a_single_point_twice():
    async with cell_of('simulated', 'download') as (harness, controller, received):
        outcome = await harness.execute(plan([0.5], [A])).end()
        assert outcome.end is End.SUCCEEDED, outcome
        first, last = (packet.message for packet in received)
        assert (first.sequence, last.sequence) == (-1, -3)
        assert last == replace(first, sequence=-3, duration=last.duration)
        assert last.duration == pytest.approx(MIN_DURATION_S)  # the arm is already there
        assert np.abs(where(controller) - A).max() < 1e-4


async def test_download_goal_waits_for_the_dead_time_of_all_points():
    """The arm rests for seconds after the last point is sent, and the goal must not end then.

    The plan ends where it starts, and the arm never leaves the goal tolerance.
    """
    usual = load_controller_profile('simulated')
    download = replace(usual.program.download, dead_time=0.15)
    slow = replace(usual, program=replace(usual.program, download=download))
    async with cell_of(slow, 'download') as (harness, controller, received):
        shares = np.concatenate([np.linspace(0, 1, 6), np.linspace(1, 0, 6)])
        goal = plan(np.arange(12) * 0.1, np.outer(shares, pose(0.005)))
        submitted = harness.execute(goal)
        await until(lambda: len(received) == 12)
        moved = False
        while not submitted.outcomes:
            moved |= controller.in_motion
            await asyncio.sleep(0.005)
        assert submitted.outcome.end is End.SUCCEEDED
        assert moved
        assert not controller.in_motion


async def test_cancel_of_a_download_sends_stop_as_a_request():
    async with cell_of('abb') as (harness, controller, received):
        goal = harness.execute(plan([0.0, 3.0], [HOME, pose(1.5)]))
        await harness.until_moving()
        harness.driver.goal_queue.cancel(goal.handle)
        outcome = await goal.end()
        assert outcome.end is End.CANCELED
        assert (received[-1].comm_type, received[-1].message.sequence) == (
            CommType.SERVICE_REQUEST,
            -4,
        )
        assert not controller.in_motion
        assert where(controller)[0] < 1.4


async def test_download_refused_by_the_controller_ends_with_its_error():
    """A joint offset lets the goal exceed a limit that only the controller knows."""
    mapping = joint_mapping(JOINTS, [1], [-2.0, 0.0, 0.0, 0.0, 0.0, 0.0], 0)
    async with cell_of('simulated', 'download', mapping=mapping) as (harness, controller, _):
        goal = harness.execute(plan([0.0, 1.0], [harness.at, harness.at + pose(3.5)]))
        outcome = await goal.end()
        assert outcome.end is End.ABORTED
        assert '4001' in outcome.text
        assert not controller.in_motion


@pytest.mark.slow
@pytest.mark.invariant(7)
async def test_inv7_long_download_queues_a_bounded_number_of_bytes():
    """Points wait while the controller does not read."""
    usual = load_controller_profile('simulated')
    download = replace(usual.program.download, buffer=10_000, dead_time=0.0)
    profile = replace(usual, program=replace(usual.program, download=download))
    async with cell_of(profile, 'download') as (harness, _, received):
        count = 5000
        shares = np.linspace(0.0, 1.0, count)
        goal = harness.execute(plan(np.arange(count) * 0.01, np.outer(shares, A)))
        max_unsent = 0
        while len(received) < count:
            max_unsent = max(max_unsent, harness.driver.motion_link.unsent)
            assert not goal.outcomes, goal.outcome
            await asyncio.sleep(0)
        assert max_unsent < 32768
        assert [packet.message.sequence for packet in received[1:-1]] == [*range(1, count - 1)]
        harness.driver.goal_queue.cancel(goal.handle)
        assert (await goal.end()).end is End.CANCELED


# ---- Motoman


async def test_motoman_receives_start_traj_mode_and_then_full_points():
    async with cell_of('motoman') as (harness, _, received):
        goal = dense()
        outcome = await harness.execute(goal).end()
        assert outcome.end is End.SUCCEEDED, outcome
        mode, *points = (packet.message for packet in received)
        assert isinstance(mode, MotionCtrl)
        assert mode.command == Command.START_TRAJ_MODE
        assert all(isinstance(point, JointTrajPtFull) for point in points)
        # a point is repeated after BUSY
        points = [point for point, _ in itertools.groupby(points)]
        assert [point.sequence for point in points] == [*range(20)]
        assert {point.valid_fields for point in points} == {7}
        times = [point.time for point in points]
        np.testing.assert_allclose(times, goal.times, atol=1e-6)
        velocities = [point.velocities[:JOINTS] for point in points]
        np.testing.assert_allclose(velocities, goal.velocities, atol=1e-6)


async def test_point_is_repeated_while_motoman_is_busy():
    motoman = load_controller_profile('motoman')
    small = replace(motoman, motion=replace(motoman.motion, pending_limit=2))
    async with cell_of(small) as (harness, controller, received):
        outcome = await harness.execute(dense()).end()
        assert outcome.end is End.SUCCEEDED, outcome
        sequences = [
            packet.message.sequence
            for packet in received
            if isinstance(packet.message, JointTrajPtFull)
        ]
        assert len(sequences) > 20  # some are repeated
        assert sequences == sorted(sequences)
        assert set(sequences) == set(range(20))
        assert np.abs(where(controller) - B).max() < 1e-4


async def test_busy_point_is_not_repeated_after_stop():
    motoman = load_controller_profile('motoman')
    small = replace(motoman, motion=replace(motoman.motion, pending_limit=1))
    async with cell_of(small) as (harness, controller, received):
        goal = harness.execute(plan(np.arange(9) * 1.0, np.outer(np.arange(9.0), pose(0.2))))
        await harness.until_moving()
        harness.driver.goal_queue.cancel(goal.handle)
        assert (await goal.end()).end is End.CANCELED
        stop = next(
            index
            for index, packet in enumerate(received)
            if isinstance(packet.message, MotionCtrl)
            and packet.message.command == Command.STOP_MOTION
        )
        assert await harness.rests()
        assert received[stop + 1 :] == []
        assert not controller.in_motion


async def test_refused_goal_reports_the_reason_of_motoman():
    async with cell_of('motoman') as (harness, controller, _):
        controller.apply(Event.PAUSE)
        outcome = await harness.execute(line()).end()
        assert outcome.end is End.ABORTED
        assert 'NOT_READY' in outcome.text
        assert '5007: the controller is on hold' in outcome.text


async def test_stop_of_an_idle_motoman_sends_stop_motion():
    async with cell_of('motoman') as (harness, _, received):
        assert 'acknowledged STOP' in await harness.commands.stop()
        assert received[-1].message.command == Command.STOP_MOTION


@pytest.mark.parametrize('factor', [0.5, 0.1])
async def test_speed_scaling_changes_motoman_times_and_velocities(factor):
    async with cell_of('motoman') as (harness, _, received):
        harness.driver.goal_queue.set_speed(factor)
        goal = plan([0.0, 0.1, 0.2], [HOME, pose(0.02), pose(0.04)])
        outcome = await harness.execute(goal).end()
        assert outcome.end is End.SUCCEEDED, outcome
        points = [p.message for p in received if isinstance(p.message, JointTrajPtFull)]
        times = np.diff([point.time for point in points])
        np.testing.assert_allclose(times, 0.1 / factor, rtol=0.02)
        assert points[1].velocities[0] == pytest.approx(0.2 * factor, rel=1e-5)


# ---- the state


async def test_joint_mapping_applies_to_state_and_points():
    mapping = joint_mapping(JOINTS, [1, -1, 1, 1, 1, -1], [0.1, 0.0, 0, 0, 0, 0], 1)
    async with cell_of('generic', mapping=mapping) as (harness, controller, received):
        start = mapping.positions_to_ros(where(controller))
        np.testing.assert_allclose(harness.at, start, atol=1e-6)
        target = start + pose(0.2, 0.15, -0.1, 0.0, 0.0, 0.3)
        goal = harness.execute(plan([0.0, 0.5], [start, target]))
        assert (await goal.end()).end is End.SUCCEEDED
        expected = mapping.positions_to_controller(target)
        assert np.abs(where(controller) - expected).max() < 1e-4
        np.testing.assert_allclose(harness.at, target, atol=1e-6)
        sent = received[-1].message
        assert isinstance(sent, JointTrajPt)
        speeds = np.abs(mapping.velocities_to_controller(target - start)) / 0.5
        assert sent.velocity == pytest.approx(max(speeds / LIMITS.velocity), rel=1e-6)


@pytest.mark.parametrize('name', ['simulated', 'abb', 'motoman'])
async def test_nothing_is_sent_after_disable_has_ended_a_goal(name):
    async with cell_of(name) as (harness, _, received):
        goal = harness.execute(dense())
        await until(lambda: len(received) >= 2)
        await harness.commands.disable()
        assert goal.handle.execution.state is GoalState.ABORTED
        count = len(received)
        await asyncio.sleep(0.1)
        assert len(received) == count


# ---- without state messages


async def test_byte_order_of_the_profile_is_used_until_a_state_arrives():
    async with ScriptedController() as controller:
        fanuc = load_controller_profile('fanuc').byte_order
        harness = Harness(controller.ports, usual_byte_order=fanuc)
        assert harness.driver.motion_link.dialect.byte_order is fanuc
        async with harness:
            await harness.ready()
            assert harness.driver.motion_link.dialect.byte_order is ByteOrder.LITTLE


async def test_full_points_are_sent_without_motoman_commands():
    """Like Staubli's server, the controller answers each point with a JOINT_POSITION."""
    rules = DeliveryRules(point_message='joint_traj_pt_full')
    async with scripted_cell(delivery=rules) as (harness, controller):
        outcome = await harness.execute(line()).end()
        await until(lambda: controller.received == [0, 0, -4])  # group 0 twice, then STOP
        assert 'joint_1 is 0.2 rad from the goal' in outcome.text


OK, NO = ReplyCode.SUCCESS, ReplyCode.FAILURE


@pytest.mark.parametrize(
    ('packet', 'text'),
    [
        (reply(JointPosition(), OK), None),
        (reply(Opaque(11), OK), None),
        (reply(MotionReply(0, 3, 14, 0), OK), None),
        (reply(JointPosition(), NO), 'FAILURE reply'),
        (reply(MotionReply(0, 3, 14, 0), NO), 'FAILURE reply'),
        (reply(MotionReply(0, 3, 14, 1), OK), 'BUSY: its queue is full'),
        (
            reply(MotionReply(0, 3, 14, 3, 3011), OK),
            'INVALID: the message is wrong, 3011: the trajectory does not start at the '
            'position of the arm',
        ),
        (
            reply(MotionReply(0, 3, 14, 5, 5006), OK),
            'NOT_READY: it cannot move now, 5006: the servos are off',
        ),
        (reply(MotionReply(0, 3, 14, 9, 77), OK), 'result 9, 77: unknown subcode'),
    ],
)
def test_rejecting_reply_is_described_with_its_reason(packet, text):
    assert reply_rejection(packet) == text


def test_every_motoman_result_and_subcode_is_described():
    assert RESULTS.keys() == set(Result) - {Result.SUCCESS}
    assert SUBCODES.keys() == {*Invalid, *NotReady}
