# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Streams of setpoints: which are followed, when they are not, and how each one ends."""

import asyncio
import logging

import numpy as np
import pytest
from support.driver_harness import (
    HOME,
    LIMITS,
    Harness,
    ScriptedController,
    answer,
    cell,
    pose,
)
from support.event_loop import hanging, now, run, stand_still, until
from support.examples import one_in
from support.streams import JOG, PERIOD, SERVO, going_on, positions, send, velocities, window

from epson_driver.driver.delivery.delivery_factory import delivery_rules
from epson_driver.driver.outcome import End
from epson_driver.driver.servo.restart_interlock import RELEASE_S
from epson_driver.driver.servo.setpoint import Mode, ServoSettings
from epson_driver.driver.servo.stream import PASSED
from epson_driver.profiles import load_controller_profile
from epson_driver.sim_controller.condition.states import Event

EITHER = [False, pytest.param(True, marks=pytest.mark.slow)]

SPEED = 0.4
"""rad/s, of the streams here."""


def ramp(limit=np.inf, speed=SPEED, start=0.0):
    """Return positions of joint 1 that go on at a speed, and rest at a limit."""
    return lambda time: positions(pose(min(start + speed * time, limit)))


def jog(speed=SPEED):
    return lambda _time: velocities(pose(speed))


@pytest.fixture
def said(caplog):
    """Return what the log said of streams since the last call."""
    caplog.set_level(logging.INFO, 'epson_driver.driver.servo.servo')

    def take():
        lines = [record.getMessage() for record in caplog.records if 'servo' in record.name]
        caplog.clear()
        return lines

    return take


def still(harness, since):
    """Return whether no joint has moved since an index of the samples."""
    at = [sample.positions for _, sample in harness.events.samples[since:]]
    return len(at) > 20 and max(np.abs(each - at[0]).max() for each in at) < 1e-4


async def stays(harness, seconds=1.5):
    """Return whether the arm stays where it is."""
    since = len(harness.events.samples)
    await asyncio.sleep(seconds)
    return still(harness, since)


async def over(harness):
    await until(lambda: not harness.driver.servo.active)


# --- following --------------------------------------------------------------------------------


@pytest.mark.parametrize('smooth', EITHER, ids=['point to point', 'smooth'])
def test_a_stream_of_positions_is_followed_to_its_last_one_and_then_a_goal_runs(smooth, said):
    async def check():
        async with cell(smooth=smooth) as (harness, _):
            await send(harness, ramp(0.3), 2.5)
            assert harness.driver.servo.mode is Mode.POSITION
            assert harness.driver.servo.source == SERVO
            await over(harness)
            assert np.abs(harness.at - pose(0.3)).max() < 1e-4
            assert await harness.rests()
            assert not harness.driver.stopper.ours
            assert (await harness.submit(pose(0.1)).end()).end is End.SUCCEEDED
        first, last = said()
        assert 'following the stream of positions on ~/servo' in first
        assert 'has ended, and the arm stands' in last

    run(check())


def test_a_jog_moves_a_joint_and_letting_go_stops_it():
    async def check():
        async with cell(smooth=True) as (harness, _):
            await send(harness, jog(), 1.0)
            moved = harness.at[0]
            assert 0.2 < moved < 0.4
            harness.driver.servo.take(velocities(HOME, source=JOG))  # released
            await over(harness)
            assert moved < harness.at[0] < moved + 0.15
            assert await harness.rests()
            await send(harness, jog(-SPEED), 0.5)
            await over(harness)
            assert harness.at[0] < moved

    run(check())


@pytest.mark.invariant(4)
def test_inv4_setpoints_that_waited_longer_than_the_time_out_begin_nothing(said):
    async def check():
        async with cell(smooth=True) as (harness, _):
            servo = harness.driver.servo
            for age in (5.0, 4.9, servo.settings.timeout + 0.01):
                servo.take(velocities(pose(SPEED), source=JOG), now() - age)
                assert not servo.active
            assert await stays(harness)
        assert any('was held up for' in line for line in said())

    run(check())


@pytest.mark.invariant(3)
def test_inv3_setpoints_that_waited_do_not_keep_a_silent_stream_alive():
    async def check():
        async with cell(smooth=True) as (harness, _):
            await send(harness, jog(), 0.5)
            ended = now()
            while harness.driver.servo.active:
                assert now() - ended < 2.0
                harness.driver.servo.take(velocities(pose(SPEED), source=JOG), ended)
                await asyncio.sleep(PERIOD)

    run(check())


@pytest.mark.invariant(3)
def test_inv3_a_stream_that_falls_silent_on_its_way_brakes_there():
    async def check():
        async with cell(smooth=True) as (harness, _):
            harness.driver.servo.take(positions(pose(0.04)))
            await send(harness, lambda _: positions(pose(1.5)), 0.6)  # far, once it is followed
            await over(harness)
            assert 0.1 < harness.at[0] < 1.3
            assert await harness.rests()
            assert harness.gate is None
            assert harness.driver.servo.counts.late == 0

    run(check())


ENDING = {
    'positions': lambda time, speed: positions(pose(speed * time)),
    'with velocities': lambda time, speed: positions(pose(speed * time), pose(speed)),
    'windows': lambda time, speed: window(
        lambda ahead: (pose(speed * (time + ahead)), pose(speed))
    ),
}


@pytest.mark.invariant(3)
@pytest.mark.parametrize('speed', one_in(2, [0.05, 0.15, 0.9, 0.4]))
@pytest.mark.parametrize('kind', ENDING)
def test_inv3_positions_that_fall_silent_end_at_the_last_one(kind, speed):
    """However far the arm led over it by then."""

    async def check():
        async with cell(smooth=True) as (harness, _):
            await send(harness, lambda time: ENDING[kind](time, speed), 0.8, 1.0 / 30.0)
            ended, last = now(), ENDING[kind](23.0 / 30.0, speed).positions
            await until(lambda: harness.driver.servo.occupation() is None)
            assert now() - ended < 0.8
            assert harness.at == pytest.approx(last, abs=1e-6)
            assert await harness.rests()

    run(check())


@pytest.mark.invariant(3)
def test_inv3_positions_that_fall_silent_are_not_passed():
    """A stream that began at once may end at once: the arm keeps the way of a stop behind it."""

    async def check():
        async with cell(smooth=True) as (harness, _):
            await send(harness, ramp(), 1.0)
            last = SPEED * (1.0 - PERIOD)
            await over(harness)
            ways = [sample.positions[0] for _, sample in harness.events.samples]
            assert max(ways) < last + SPEED * PERIOD + PASSED + 0.01
            assert harness.at[0] == pytest.approx(last, abs=1e-6)
            assert await harness.rests()

    run(check())


@pytest.mark.slow
def test_a_gap_in_a_stream_is_counted_and_the_stream_goes_on():
    async def check():
        async with cell(smooth=True) as (harness, _):
            await send(harness, ramp(), 1.0)
            await asyncio.sleep(0.25)
            await send(harness, ramp(0.8, start=0.5), 1.5)
            assert harness.driver.servo.counts.late == 1
            await over(harness)
            assert np.abs(harness.at - pose(0.8)).max() < 1e-3

    run(check())


@pytest.mark.slow
def test_a_position_outside_the_range_is_followed_to_its_end(said):
    async def check():
        far = LIMITS.position_max[0]
        async with cell(smooth=True) as (harness, _):
            harness.driver.servo.settings = ServoSettings(share=0.5)
            await send(harness, ramp(far + 0.4, speed=2.0), 3.5)
            await over(harness)
            assert harness.at[0] == pytest.approx(far, abs=1e-4)
            assert harness.driver.servo.counts.clipped > 10
        lines = [line for line in said() if 'goes as far as it may' in line]
        assert 1 <= len(lines) <= 4  # once a second
        assert 'joint_1: position' in lines[0]

    run(check())


def test_speed_scaling_holds_for_streams():
    async def check():
        async with cell(smooth=True) as (harness, _):
            harness.driver.goal_queue.set_speed(0.0)
            await asyncio.sleep(1.0)
            await send(harness, lambda _: positions(pose(0.04)), 0.5)
            assert abs(harness.at[0]) < 1e-4
            harness.driver.goal_queue.set_speed(1.0)
            await send(harness, lambda _: positions(pose(0.04)), 1.5)
            assert harness.at[0] == pytest.approx(0.04, abs=1e-3)

    run(check())


@pytest.mark.slow
def test_a_loop_that_was_held_up_does_not_make_the_arm_jump():
    async def check():
        async with cell(smooth=True) as (harness, _):
            await send(harness, ramp(), 0.6)
            stand_still(0.6)
            await send(harness, ramp(0.6, start=0.48), 1.5)
            await over(harness)
            fastest = max(np.abs(s.velocities).max() for _, s in harness.events.samples)
            assert fastest < 0.3 * LIMITS.velocity[0]
            assert harness.gate is None

    run(check())


@pytest.mark.invariant(4)
def test_inv4_a_loop_that_was_held_up_for_long_does_not_have_an_arm_that_stands_brake():
    async def check():
        async with cell(smooth=True) as (harness, controller):
            await send(harness, ramp(0.6), 0.3)
            with hanging():
                await asyncio.sleep(2.0 * RELEASE_S)
                stood = controller.commanded.copy()
            await asyncio.sleep(1.5)
            assert np.abs(controller.commanded - stood).max() < 1e-4

    run(check())


# --- not following ----------------------------------------------------------------------------


@pytest.mark.invariant(4)
def test_inv4_a_stream_before_enable_is_refused_and_the_log_says_so_once(said):
    async def check():
        async with cell(enabled=False) as (harness, controller):
            controller.apply(Event.MOTORS_ON)
            await send(harness, lambda _: positions(pose(0.03)), 1.0)
            assert harness.driver.motion_link.statistics.frames_sent == 0
            (line,) = said()
            assert 'is not followed: the arm is not enabled' in line
            assert harness.driver.servo.counts.refused == 50
            async with going_on(harness, lambda _: positions(pose(0.03))):
                await harness.commands.enable()
                assert await stays(harness)
                assert 'it holds still' in said()[-1]
            await asyncio.sleep(1.1 * RELEASE_S)
            await send(harness, lambda _: positions(pose(0.03)), 1.0)
            assert harness.at[0] > 0.02

    run(check())


@pytest.mark.invariant(4)
def test_inv4_a_position_far_from_the_arm_is_not_followed_until_it_is_near(said):
    """What ros2_control sends at first: the initial value of a joint, whatever the arm does."""

    async def check():
        async with cell() as (harness, _):
            await send(harness, lambda _: positions(pose(0.8)), 1.0)
            assert await stays(harness, 0.5)
            assert harness.driver.motion_link.statistics.frames_sent == 0
            (line,) = said()
            assert 'joint_1: it begins at 0.8 rad, the joint is at 0 rad' in line
            await send(harness, ramp(0.2), 1.5)
            await over(harness)
            assert harness.at[0] == pytest.approx(0.2, abs=1e-3)

    run(check())


@pytest.mark.invariant(4)
@pytest.mark.parametrize('smooth', EITHER, ids=['point to point', 'smooth'])
def test_inv4_after_an_estop_a_stream_that_goes_on_moves_nothing(smooth, said):
    """Not before it is enabled, and not then, until it has been let go of."""

    async def check():
        async with cell(smooth=smooth) as (harness, controller):
            async with going_on(harness, ramp(0.6)):
                await until(lambda: harness.at[0] > 0.2)
                controller.apply(Event.ESTOP_PRESS)
                await until(lambda: harness.gate is not None)
                await asyncio.sleep(1.0)  # it has braked
                sent = harness.driver.motion_link.statistics.frames_sent
                controller.apply(Event.ESTOP_RELEASE)
                controller.apply(Event.RESET)
                controller.apply(Event.MOTORS_ON)
                await until(lambda: harness.driver.robot.status.drives_powered == 1)
                assert await stays(harness)
                assert harness.driver.motion_link.statistics.frames_sent == sent
                said()
                await harness.commands.enable()
                assert await stays(harness)
                assert [line for line in said() if 'it holds still: it must move on' in line]
            await asyncio.sleep(1.1 * RELEASE_S)
            there = harness.at
            await send(harness, lambda _: positions(there + pose(0.03)), 0.5)
            await over(harness)
            assert np.abs(harness.at - there - pose(0.03)).max() < 1e-3

    run(check())


@pytest.mark.invariant(4)
def test_inv4_a_key_that_is_held_while_the_arm_is_enabled_moves_nothing(said):
    async def check():
        async with cell(enabled=False) as (harness, controller):
            controller.apply(Event.MOTORS_ON)
            async with going_on(harness, jog()):
                await asyncio.sleep(0.2)
                await harness.commands.enable()
                assert await stays(harness)
                assert harness.driver.motion_link.statistics.frames_sent == 0
                assert 'it must be let go of first: 1 s without a message' in said()[-1]
            await asyncio.sleep(1.1 * RELEASE_S)
            await send(harness, jog(), 0.5)
            assert harness.at[0] > 0.05
            await over(harness)

    run(check())


@pytest.mark.invariant(4)
def test_inv4_a_stick_that_was_let_go_counts_as_silent_and_occupies_nothing():
    async def check():
        async with cell(enabled=False) as (harness, controller):
            controller.apply(Event.MOTORS_ON)
            async with going_on(harness, lambda _: velocities(HOME)):
                await harness.commands.enable()
                assert (await harness.submit(pose(0.1)).end()).end is End.SUCCEEDED
            await send(harness, jog(), 0.5)
            assert harness.at[0] > 0.15
            async with going_on(harness, lambda _: velocities(HOME)):
                await over(harness)

    run(check())


@pytest.mark.invariant(3)
@pytest.mark.parametrize(
    'stream',
    [pytest.param(ramp(), marks=pytest.mark.slow), jog()],
    ids=['positions', 'velocities'],
)
def test_inv3_after_stop_a_stream_that_goes_on_moves_nothing(stream):
    async def check():
        async with cell(smooth=True) as (harness, _):
            async with going_on(harness, stream):
                await until(lambda: harness.at[0] > 0.1)
                assert 'the stream of setpoints on ~/' in await harness.commands.stop()
                assert await stays(harness)
                assert harness.gate is None
            await asyncio.sleep(1.1 * RELEASE_S)
            there = harness.at[0]
            begins = stream(0.0).positions is not None
            await send(harness, ramp(start=there) if begins else stream, 0.5)
            await over(harness)
            assert harness.at[0] > there + 0.1

    run(check())


def test_stop_while_a_goal_runs_does_not_let_a_waiting_stream_begin():
    async def check():
        async with cell() as (harness, _):
            goal = harness.submit(pose(1.0))
            await harness.until_moving()
            async with going_on(harness, lambda _: positions(harness.at + pose(0.02))):
                await asyncio.sleep(0.1)
                await harness.commands.stop()
                assert goal.outcome.end is End.ABORTED
                assert await stays(harness)

    run(check())


def test_a_goal_and_a_stream_exclude_each_other(said):
    async def check():
        async with cell() as (harness, _):
            goal = harness.submit(pose(0.3))
            await harness.until_moving()
            await send(harness, lambda _: positions(harness.at), 0.2)
            assert not goal.outcomes
            assert 'is not followed: another motion runs' in said()[-1]
            assert (await goal.end()).end is End.SUCCEEDED
            await asyncio.sleep(RELEASE_S)
            async with going_on(harness, ramp(start=0.3)):
                await until(lambda: harness.driver.servo.active)
                refused = harness.submit(pose(0.5))
                assert refused.outcome.end is End.ABORTED
                assert 'follows a stream of setpoints on ~/servo' in refused.outcome.text
                assert harness.driver.servo.active
            await asyncio.sleep(0.15)
            await until(lambda: not harness.driver.robot.sample.velocities.any())
            await over(harness)
            assert (await harness.submit(pose(0.2)).end()).end is End.SUCCEEDED

    run(check())


def test_of_two_sources_the_first_is_followed(said):
    async def check():
        async with cell(smooth=True) as (harness, _):
            async with going_on(harness, ramp(0.4)), going_on(harness, jog(-1.0)):
                await until(lambda: harness.at[0] > 0.39)
            assert harness.driver.servo.counts.refused > 10
            (line,) = [line for line in said() if 'not followed' in line]
            assert '~/joint_jog is not followed: the arm follows the position stream' in line

    run(check())


@pytest.mark.parametrize(
    ('setpoint', 'text'),
    one_in(
        4,
        [
            (positions(pose(np.nan)), 'joint_1: positions = nan is not finite'),
            (positions(pose(0.0), pose(0.0, np.inf)), 'joint_2: velocities = inf is not finite'),
            (positions([0.0, 0.1]), '2 positions for 6 joints'),
            (velocities([0.0] * 7, source=SERVO), '7 velocities for 6 joints'),
        ],
        several=True,
    ),
)
def test_bad_setpoints_are_dropped_and_the_stream_goes_on(setpoint, text, said):
    async def check():
        async with cell(smooth=True) as (harness, _):
            async with going_on(harness, ramp(0.3)), going_on(harness, lambda _: setpoint, 0.05):
                await until(lambda: harness.at[0] > 0.29)
            await over(harness)
            lines = [line for line in said() if 'dropped' in line]
            assert text in lines[0]
            assert len(lines) < 6  # once a second
            assert harness.gate is None

    run(check())


def test_nothing_but_nan_before_the_first_setpoint_is_one_line_and_later_one_each_second(said):
    """So joint_trajectory_controller sends it when it became active before a joint state."""

    async def check():
        async with cell(smooth=True) as (harness, _):
            await send(harness, lambda _: positions(pose(np.nan)), 5.0)
            (line,) = said()
            assert 'joint_1: positions = nan is not finite' in line
            assert harness.driver.servo.counts.refused == 250
            await send(harness, lambda _: positions(harness.at), 0.1)
            said()
            await send(harness, lambda _: positions(pose(np.nan)), 3.0)
            assert len([line for line in said() if 'dropped' in line]) > 1

    run(check())


# --- when something fails ---------------------------------------------------------------------


@pytest.mark.invariant(3)
@pytest.mark.parametrize('how', one_in(2, ['disable', 'lost link', 'pause', 'fault']))
def test_inv3_whatever_ends_a_stream_stops_the_arm(how):
    async def check():
        async with cell(smooth=True) as (harness, controller):
            async with going_on(harness, ramp()):
                await until(lambda: harness.at[0] > 0.1)
                if how == 'disable':
                    await harness.commands.disable()
                elif how == 'lost link':
                    harness.driver.motion_link.reconnect('for the test')
                elif how == 'pause':
                    controller.apply(Event.PAUSE)
                else:
                    harness.driver.fault('for the test')
                await until(lambda: not harness.driver.servo.active)
                await until(lambda: not harness.driver.robot.sample.velocities.any())
                assert await stays(harness)
            assert (harness.gate is None) == (how == 'pause')

    run(check())


@pytest.mark.invariant(9)
def test_inv9_a_refused_setpoint_stops_and_disables():
    async def check():
        def reply(sequence):
            return answer(2 if sequence == 2 else 1, sequence)

        async with ScriptedController(reply) as scripted, Harness(scripted.ports) as harness:
            await harness.ready()
            await harness.commands.enable()
            async with going_on(harness, lambda _: positions(pose(0.04))):
                await until(lambda: harness.gate is not None)
            assert 'the controller refused setpoint 2' in harness.gate
            assert not harness.driver.servo.active
            assert scripted.received[:3] == [0, 1, 2]
            assert set(scripted.received[3:]) == {-4}

    run(check())


@pytest.mark.parametrize('pressed', [True, False])
def test_a_refused_setpoint_is_told_with_the_status_that_explains_it(pressed, caplog):
    """An E-stop may be seen first as a refusal: its status comes a little later."""

    async def check():
        def reply(sequence):
            return answer(2 if sequence == 2 else 1, sequence)

        async with ScriptedController(reply) as scripted, Harness(scripted.ports) as harness:
            await harness.ready()
            await harness.commands.enable()
            async with going_on(harness, lambda _: positions(pose(0.04))):
                await until(lambda: harness.gate is not None)
                assert not [each for each in caplog.messages if 'arm disabled' in each]
                await asyncio.sleep(0.05)
                if pressed:
                    scripted.status = (0, 1, 0, 0, 0, 2, 0)
                await until(lambda: any('arm disabled' in each for each in caplog.messages))
        (line,) = [each for each in caplog.messages if 'arm disabled' in each]
        assert 'the controller refused setpoint 2' in line
        assert ('the E-stop is pressed' in line) == pressed

    run(check())


@pytest.mark.invariant(9)
def test_inv9_a_setpoint_that_is_not_answered_stops_and_disables():
    async def check():
        def reply(sequence):
            return b'' if sequence == 1 else answer(1, sequence)

        async with ScriptedController(reply) as scripted, Harness(scripted.ports) as harness:
            harness.driver.servo.settings = ServoSettings(reply_timeout=0.5)
            await harness.ready()
            await harness.commands.enable()
            begin = now()
            async with going_on(harness, lambda _: positions(pose(0.04))):
                await until(lambda: harness.gate is not None)
            assert 0.4 < now() - begin < 1.5
            assert 'no reply to setpoint 1' in harness.gate
            assert scripted.received[:2] == [0, 1]  # one on its way at a time

    run(check())


@pytest.mark.parametrize(('period', 'points'), [(0.02, (18, 22)), (0.1, (4, 6))])
def test_points_are_as_far_apart_as_the_controller_needs(period, points):
    async def check():
        async with ScriptedController() as scripted, Harness(scripted.ports) as harness:
            harness.driver.servo.settings = ServoSettings(period=period)
            await harness.ready()
            await harness.commands.enable()
            await send(harness, ramp(), 0.4)
            assert points[0] <= len(scripted.received) <= points[1]

    run(check())


@pytest.mark.invariant(3)
def test_inv3_an_arm_that_gets_few_points_brakes_as_soon_as_its_stream_is_silent():
    async def check():
        async with cell(smooth=True) as (harness, _):
            harness.driver.servo.settings = ServoSettings(period=0.2)
            await send(harness, jog(), 1.0)
            sent = harness.at[0]
            await over(harness)
            # silence, until the next point, what the controller knew, and the way of a stop
            assert harness.at[0] - sent < SPEED * (0.1 + 0.2 + 0.3 + 0.1)
            assert harness.at[0] - sent > 0.0
            assert harness.gate is None

    run(check())


@pytest.mark.invariant(4)
def test_inv4_nothing_follows_a_stop_on_the_wire():
    async def check():
        async with ScriptedController() as scripted, Harness(scripted.ports) as harness:
            await harness.ready()
            await harness.commands.enable()
            async with going_on(harness, lambda _: positions(pose(0.045))):
                await until(lambda: len(scripted.received) > 3)
                harness.driver.disable('for the test')
                await asyncio.sleep(1.0)
            points = scripted.received[: scripted.received.index(-4)]
            assert points == list(range(len(points)))
            assert set(scripted.received[len(points) :]) == {-4}

    run(check())


def test_an_arm_that_does_not_follow_is_given_up():
    """Its controller takes every point, and moves nothing."""

    async def check():
        async with ScriptedController() as scripted, Harness(scripted.ports) as harness:
            harness.driver.servo.settings = ServoSettings(reply_timeout=1.0)
            await harness.ready()
            await harness.commands.enable()
            async with going_on(harness, ramp()):
                await until(lambda: harness.gate is not None)
            assert 'the arm has not followed setpoints for' in harness.gate
            assert len(scripted.received) < 1.0 / PERIOD

    run(check())


def test_a_message_that_is_no_setpoint_is_counted_and_told(said):
    async def check():
        async with cell() as (harness, _):
            harness.driver.servo.refuse(SERVO, 'joint_7 is not a joint of this robot')
            assert harness.driver.servo.counts.received == 1
            assert harness.driver.servo.counts.refused == 1
            assert not harness.driver.servo.active
        assert any('joint_7 is not a joint of this robot' in line for line in said())

    run(check())


@pytest.mark.invariant(9)
def test_inv9_a_withdrawn_acknowledgement_breaks_a_stream_off():
    async def check():
        async with cell(smooth=True) as (harness, _):
            await send(harness, jog(), 0.5)
            harness.driver.servo.withdraw()
            assert not harness.driver.servo.active
            assert 'the controller withdrew an acknowledgement' in harness.gate
            await asyncio.sleep(1.0)
            assert await harness.rests()

    run(check())


def test_no_stream_is_followed_where_all_of_a_trajectory_is_sent_before_it_moves(said):
    async def check():
        rules = delivery_rules(load_controller_profile('generic'), 'download', 'joint_traj_pt')
        async with cell(smooth=False, delivery=rules) as (harness, _):
            harness.driver.servo.take(positions(pose(0.04)))
            await asyncio.sleep(0.1)
            assert not harness.driver.servo.active
            assert harness.gate is None
            assert harness.at[0] == pytest.approx(0.0, abs=1e-6)
        text = 'with interface: download the arm follows no streams'
        assert any(text in line for line in said())

    run(check())
