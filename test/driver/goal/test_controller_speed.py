# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Speed scaling in the controller's smoother: driver and smooth controller, in virtual time."""

import asyncio
from dataclasses import replace

import numpy as np
import pytest
from support.driver_harness import (
    LIMITS,
    Harness,
    ScriptedController,
    answer,
    cell,
    frame,
    pose,
    simulated,
)
from support.event_loop import now, until
from support.examples import one_in
from support.replacement_runs import goal, long_way
from support.speed_scaling import pace, progress, scale, slowed_on_the_way, submit
from support.streams import positions, send

from epson_driver.driver.arm_commands import CommandError
from epson_driver.driver.delivery.delivery import DeliveryRules
from epson_driver.driver.delivery.delivery_factory import delivery_rules
from epson_driver.driver.goal.controller_speed import ControllerSpeed
from epson_driver.driver.goal.goal import Tolerances
from epson_driver.driver.outcome import End
from epson_driver.profiles import load_controller_profile
from epson_driver.sim_controller.condition.states import Event
from epson_driver.simple_message import ReplyCode, reply

RC620 = load_controller_profile('rc620')
PROFILE = load_controller_profile('simulated')
RULES = DeliveryRules(scales_speed=True)
RAMP_S = 0.7
"""How long the arm may take to a lower share, s: it is on a plan that leaves room for that."""


def scaling_cell(**options):
    return cell(smooth=True, profile=PROFILE, delivery=RULES, **options)


@pytest.mark.invariant(2)
@pytest.mark.parametrize('seed', one_in(20, range(20)))
async def test_inv2_a_lower_share_acts_at_once_and_not_behind_the_points(seed):
    """The controller has points for a second, and yet the arm is slower after a ramp."""
    share, times, places = await slowed_on_the_way(scaling_cell(), [seed, 33])
    assert pace(times, places, RAMP_S, max(times[-1], RAMP_S + 0.3)) <= share * 1.02
    for begin in np.arange(RAMP_S, times[-1] - 0.4, 0.2):  # a delay is made up for, at the share
        assert pace(times, places, begin, begin + 0.4) <= share * 1.3, (share, begin)


async def test_without_it_the_arm_goes_on_as_fast_with_what_the_controller_has():
    way = long_way('dense', 3.0)
    async with cell(smooth=True) as (harness, _):
        first = submit(harness, way)
        await harness.until_moving()
        await asyncio.sleep(0.5)
        scale(harness, 0.2)
        since = now()
        await asyncio.sleep(1.0)
        harness.driver.goal_queue.cancel(first.handle)
        await first.end()
        times, places = progress(harness, way.trajectory, since)
    assert pace(times, places, 0.3, 0.8) > 0.9


@pytest.mark.parametrize(
    'shares', one_in(4, [(0.5, 0.1, 1.0), (0.3,), (0.0, 1.0), (0.2, 0.0, 0.6)])
)
async def test_the_goals_clock_goes_with_the_arm_and_its_path_tolerance_holds(shares):
    way = long_way('dense', 3.0)
    limit = Tolerances(np.full(len(LIMITS.names), 0.05), np.full(len(LIMITS.names), np.inf))
    async with scaling_cell() as (harness, _):
        first = submit(harness, replace(way, path_tolerance=limit, goal_time=0.3))
        await harness.until_moving()
        await asyncio.sleep(0.5)
        begun = now()
        for share in shares:
            scale(harness, share)
            await asyncio.sleep(0.8)
            assert first.handle.execution.speed(now()) == share
        outcome = await first.end()
        assert outcome.end is End.SUCCEEDED, outcome
        assert 'another speed' not in outcome.text
        left = (3.0 - 0.5 - 0.8 * sum(shares[:-1])) / shares[-1]
        assert first.ended_at - begun == pytest.approx(left + 0.8 * (len(shares) - 1), rel=0.2)


async def test_a_pause_rests_at_once_on_the_way_and_a_stop_ends_it():
    way = long_way('dense', 3.0)
    async with scaling_cell() as (harness, controller):
        first = submit(harness, way)
        await harness.until_moving()
        await asyncio.sleep(0.8)
        scale(harness, 0.0)
        await asyncio.sleep(0.5)
        assert await harness.rests()
        assert not first.outcomes
        assert not controller.in_motion
        harness.driver.goal_queue.cancel(first.handle)
        assert (await first.end()).end is End.CANCELED
        scale(harness, 1.0)
        assert await harness.rests()
        second = submit(harness, goal([0.8], pose(0.2)))
        assert (await second.end()).end is End.SUCCEEDED


@pytest.mark.slow
@pytest.mark.parametrize('before', [0.03, -0.03, 0.1, 0.25, 0.5])
@pytest.mark.parametrize('share', [0.0, 0.05])
async def test_a_share_set_just_before_the_end_is_waited_for(share, before):
    way = long_way('dense', 1.5)
    async with scaling_cell() as (harness, _):
        first = submit(harness, way)
        await until(lambda: (first.handle.execution.desired or [0.0])[0] > 0.0)
        await asyncio.sleep(1.5 - before)
        scale(harness, share)
        await asyncio.sleep(8.0)
        scale(harness, 1.0)
        assert (await first.end()).end is End.SUCCEEDED, first.outcome
        assert abs(harness.at - way.trajectory.positions[-1]).max() < 1e-3


@pytest.mark.invariant(4)
async def test_inv4_the_share_holds_after_an_estop_a_lost_link_and_for_the_next_goal():
    async with (
        simulated(smooth=True, profile=PROFILE) as (controller, ports),
        Harness(ports, delivery=RULES, state_timeout=1.0) as harness,
    ):
        await harness.ready()
        await harness.commands.enable()
        scale(harness, 0.3)
        for how in ('estop', 'cut', 'none'):
            way = goal([0.0, 1.0], [harness.at, harness.at + pose(0.3)])
            if how == 'none':
                since = now()
                assert (await submit(harness, way).end()).end is End.SUCCEEDED
                assert now() - since > 0.9 / 0.3
                break
            first = submit(harness, way)
            await harness.until_moving()
            if how == 'estop':
                controller.press_estop()
                await first.end()
                await until(lambda: not controller.moving)
                controller.apply(Event.ESTOP_RELEASE)
                await harness.commands.reset_error()
            else:
                harness.driver.motion_link.transport.abort()
                await first.end()
                await until(lambda: harness.driver.motion_link.connected)
            await asyncio.sleep(0.5)
            await harness.commands.enable()


async def test_a_client_that_says_nothing_gets_all_speeds():
    async with simulated(smooth=True, profile=PROFILE) as (_, ports):
        async with Harness(ports, delivery=RULES) as harness:
            await harness.ready()
            await harness.commands.enable()
            scale(harness, 0.2)
            assert (await submit(harness, goal([0.5], pose(0.1))).end()).end is End.SUCCEEDED
        async with Harness(ports) as plain:
            await plain.ready()
            await plain.commands.enable()
            since = now()
            assert (await submit(plain, goal([0.5], pose(0.3))).end()).end is End.SUCCEEDED
            assert now() - since < 1.0


@pytest.mark.slow
async def test_streams_are_scaled_by_the_driver_alone():
    async with scaling_cell() as (harness, controller):
        scale(harness, 0.5)
        assert (await submit(harness, goal([0.5], pose(0.1))).end()).end is End.SUCCEEDED
        arm = controller.program._arm
        assert arm._share == pytest.approx(0.5)
        begin = harness.at[0]
        await send(harness, lambda time: positions(pose(begin + 0.02 * time)), 1.0)
        assert harness.driver.servo.active
        assert arm._share == 1.0
        await until(lambda: not harness.driver.servo.active)
        assert (await submit(harness, goal([0.5], pose(0.2))).end()).end is End.SUCCEEDED
        assert arm._share == pytest.approx(0.5)


async def test_a_controller_that_cannot_is_told_so_and_moves_nothing():
    async with (
        simulated(profile=PROFILE) as (_, ports),
        Harness(ports, delivery=RULES) as harness,
    ):
        await harness.ready()
        with pytest.raises(CommandError, match='refused the speed scaling'):
            await harness.commands.enable()
        outcome = await submit(harness, goal([0.5], pose(0.3))).end()
        assert outcome.end is End.ABORTED
        assert 'the arm is not enabled' in outcome.text
        assert await harness.rests()


def share_reply(code, value=None):
    body = b'' if value is None else np.float32(value).tobytes()
    return frame(65210, 3, code, body)


@pytest.mark.parametrize(
    ('later', 'words'),
    [
        (b'', 'did not answer the speed scaling within 1 s'),
        (share_reply(1, 0.75), 'refused the speed scaling 0.5 (it confirms another one)'),
        (share_reply(2), 'refused the speed scaling 0.5'),
    ],
)
async def test_an_answer_that_does_not_come_or_is_another_one_stops_the_goal(later, words):
    shares = []

    def reply(sequence):
        if sequence > 1_000_000_000:  # the bits of the share
            shares.append(sequence)
            return share_reply(1, 1.0) if len(shares) == 1 else later
        return answer(1, sequence) if sequence == -4 else b''

    async with (
        ScriptedController(reply) as scripted,
        Harness(scripted.ports, delivery=RULES) as harness,
    ):
        await harness.ready()
        await harness.commands.enable()
        first = submit(harness, goal([0.0, 3.0], [pose(), pose(0.3)]))
        await until(lambda: 0 in scripted.received)
        scale(harness, 0.5)
        assert words in (await first.end()).text
        assert words in harness.gate
        await until(lambda: -4 in scripted.received)


async def test_a_controller_that_does_not_answer_at_all_gets_no_point():
    async with (
        ScriptedController(lambda _sequence: b'') as scripted,
        Harness(scripted.ports, delivery=RULES) as harness,
    ):
        await harness.ready()
        await harness.commands.enable()
        outcome = await submit(harness, goal([0.0, 3.0], [pose(), pose(0.3)])).end()
        assert 'has not confirmed that it scales the speed' in outcome.text
        assert 0 not in scripted.received


async def test_a_share_that_was_not_answered_is_told_again_by_an_enable():
    answers = [b'', share_reply(1, 1.0)]

    def reply(sequence):
        return answers.pop(0) if sequence > 1_000_000_000 else answer(1, sequence)

    async with (
        ScriptedController(reply) as scripted,
        Harness(scripted.ports, delivery=RULES) as harness,
    ):
        await harness.ready()
        await asyncio.sleep(2.0)  # it counts as refused by now
        await harness.commands.enable()
        submit(harness, goal([0.0, 3.0], [pose(), pose(0.3)]))
        await until(lambda: 0 in scripted.received)


class NotRead:
    """A link to a controller that reads no more; `connected` until somebody notices."""

    def __init__(self):
        self.connected = True
        self.sent = []
        self.reads = True

    def post(self, message, on_reply):
        if not self.reads:
            raise ConnectionError('the controller does not read')
        self.sent.append(message.share)
        on_reply(reply(message, ReplyCode.SUCCESS), 0.0)


@pytest.mark.parametrize('connected', [True, False])
async def test_a_share_that_cannot_be_sent_stops_what_runs_and_no_point_follows(connected):
    link, shares, faults = NotRead(), [1.0], []
    speed = ControllerSpeed(link, lambda: shares[-1], faults.append)
    speed.greet()
    speed.before_point()
    assert link.sent == [1.0]
    link.reads, link.connected = False, connected
    shares.append(0.3)
    speed.update()
    assert faults == (
        ['the speed scaling 0.3 could not be sent: the controller does not read'] * connected
    )
    with pytest.raises(ConnectionError):
        speed.before_point()
    link.reads = link.connected = True
    speed.greet()
    speed.before_point()
    assert link.sent == [1.0, 0.3]


def test_it_is_for_points_that_are_streamed():
    for profile, interface, message, expected in (
        (PROFILE, 'streaming', 'joint_traj_pt', True),
        (PROFILE, 'streaming', 'joint_traj_pt_full', False),
        (PROFILE, 'download', 'joint_traj_pt', False),
        (RC620, 'streaming', 'joint_traj_pt', False),
    ):
        assert delivery_rules(profile, interface, message).scales_speed is expected
    assert answer(1)
