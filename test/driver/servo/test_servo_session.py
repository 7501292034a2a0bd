# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Streams of setpoints: when they are followed, when they are refused, and how they end."""

import asyncio
import logging

import numpy as np
import pytest
from support.driver_harness import HOME, LIMITS, answer, cell, pose, scripted_cell
from support.event_loop import hanging, now, stand_still, until
from support.examples import one_in
from support.streams import JOG, PERIOD, SERVO, positions, send, sending, velocities, window

from epson_driver.driver.delivery.delivery import delivery_rules
from epson_driver.driver.outcome import End
from epson_driver.driver.servo.restart_interlock import RELEASE_S
from epson_driver.driver.servo.setpoint import Mode, ServoSettings
from epson_driver.profiles import load_controller_profile
from epson_driver.sim_controller.condition.states import Event

EITHER = [False, pytest.param(True, marks=pytest.mark.slow)]

SPEED = 0.4
"""Joint speed of these streams, rad/s."""


def ramp(limit=np.inf, speed=SPEED, start=0.0):
    """Return positions of joint 1 that move at `speed` up to a limit."""
    return lambda time: positions(pose(min(start + speed * time, limit)))


def jog(speed=SPEED):
    return lambda _time: velocities(pose(speed))


@pytest.fixture
def logged(caplog):
    """Return a function that takes the log lines about streams since its last call."""
    caplog.set_level(logging.INFO, 'epson_driver.driver.servo.servo')

    def take():
        lines = [record.getMessage() for record in caplog.records if 'servo' in record.name]
        caplog.clear()
        return lines

    return take


async def stays(harness, seconds=1.5):
    """Return whether no joint moves during that time."""
    since = len(harness.events.samples)
    await asyncio.sleep(seconds)
    measured = [sample.positions for _, sample in harness.events.samples[since:]]
    return len(measured) > 20 and np.ptp(measured, axis=0).max() < 1e-4


async def over(harness):
    await until(lambda: not harness.driver.servo.active)


# --- following --------------------------------------------------------------------------------


@pytest.mark.parametrize('smooth', EITHER, ids=['point to point', 'smooth'])
async def test_position_stream_is_followed_to_its_end_and_then_a_goal_runs(smooth, logged):
    async with cell(smooth=smooth) as (harness, _):
        await send(harness, ramp(0.3), 1.5)
        assert harness.driver.servo.mode is Mode.POSITION
        assert harness.driver.servo.source == SERVO
        await over(harness)
        assert np.abs(harness.at - pose(0.3)).max() < 1e-4
        assert await harness.rests()
        assert not harness.driver.stopper.ours
        assert (await harness.submit(pose(0.1)).end()).end is End.SUCCEEDED
    first, last = logged()
    assert 'following the position stream on ~/servo' in first
    assert 'has ended, and the arm is at rest' in last


@pytest.mark.invariant(4)
async def test_inv4_setpoints_delayed_beyond_the_timeout_start_no_motion(logged):
    async with cell(smooth=True) as (harness, _):
        servo = harness.driver.servo
        for age in (5.0, 4.9, servo.settings.timeout + 0.01):
            servo.take(velocities(pose(SPEED), source=JOG), now() - age)
            assert not servo.active
        assert await stays(harness)
    assert any('was delayed by' in line for line in logged())


@pytest.mark.invariant(3)
async def test_inv3_delayed_setpoints_do_not_extend_a_silent_stream():
    async with cell(smooth=True) as (harness, _):
        await send(harness, jog(), 0.5)
        ended = now()
        while harness.driver.servo.active:
            assert now() - ended < 2.0
            harness.driver.servo.take(velocities(pose(SPEED), source=JOG), ended)
            await asyncio.sleep(PERIOD)


@pytest.mark.invariant(3)
async def test_inv3_stream_that_falls_silent_in_motion_stops_the_arm():
    async with cell(smooth=True) as (harness, _):
        harness.driver.servo.take(positions(pose(0.04)))
        await send(harness, lambda _: positions(pose(1.5)), 0.6)  # far, once it is followed
        await over(harness)
        assert 0.1 < harness.at[0] < 1.3
        assert await harness.rests()
        assert harness.gate is None
        assert harness.driver.servo.counts.late == 0


ENDING = {
    'positions': lambda time, speed: positions(pose(speed * time)),
    'with velocities': lambda time, speed: positions(pose(speed * time), pose(speed)),
    'windows': lambda time, speed: window(
        lambda ahead: (pose(speed * (time + ahead)), pose(speed))
    ),
}


@pytest.mark.invariant(3)
@pytest.mark.parametrize('speed', one_in(4, [0.9, 0.05, 0.15, 0.4]))
@pytest.mark.parametrize('kind', one_in(3, ENDING))
async def test_inv3_silent_position_stream_ends_at_its_last_position(kind, speed):
    """The distance that the setpoint tracker is ahead at that moment makes no difference."""
    async with cell(smooth=True) as (harness, _):
        await send(harness, lambda time: ENDING[kind](time, speed), 0.8, 1.0 / 30.0)
        ended, last = now(), ENDING[kind](23.0 / 30.0, speed).positions
        await until(lambda: harness.driver.servo.active_user() is None)
        assert now() - ended < 0.8
        assert harness.at == pytest.approx(last, abs=1e-6)
        assert await harness.rests()


@pytest.mark.slow
async def test_gap_in_a_stream_is_recorded_and_the_stream_continues():
    async with cell(smooth=True) as (harness, _):
        await send(harness, ramp(), 1.0)
        await asyncio.sleep(0.25)
        await send(harness, ramp(0.8, start=0.5), 1.5)
        assert harness.driver.servo.counts.late == 1
        await over(harness)
        assert np.abs(harness.at - pose(0.8)).max() < 1e-3


@pytest.mark.slow
async def test_position_outside_the_range_is_followed_to_the_limit(logged):
    far = LIMITS.position_max[0]
    async with cell(smooth=True) as (harness, _):
        harness.driver.servo.settings = ServoSettings(scale=0.5)
        await send(harness, ramp(far + 0.4, speed=2.0), 3.5)
        await over(harness)
        assert harness.at[0] == pytest.approx(far, abs=1e-4)
        assert harness.driver.servo.counts.clipped > 10
    lines = [line for line in logged() if 'clipped to the joint limit' in line]
    assert 1 <= len(lines) <= 4  # once a second
    assert 'joint_1: position' in lines[0]


@pytest.mark.slow
async def test_stalled_event_loop_does_not_make_the_arm_jump():
    async with cell(smooth=True) as (harness, _):
        await send(harness, ramp(), 0.6)
        stand_still(0.6)
        await send(harness, ramp(0.6, start=0.48), 1.5)
        await over(harness)
        fastest = max(np.abs(s.velocities).max() for _, s in harness.events.samples)
        assert fastest < 0.3 * LIMITS.velocity[0]
        assert harness.gate is None


@pytest.mark.invariant(4)
async def test_inv4_long_stall_does_not_move_an_arm_at_rest():
    async with cell(smooth=True) as (harness, controller):
        await send(harness, ramp(0.6), 0.3)
        with hanging():
            await asyncio.sleep(2.0 * RELEASE_S)
            stood = controller.arm.commanded.copy()
        await asyncio.sleep(1.5)
        assert np.abs(controller.arm.commanded - stood).max() < 1e-4


# --- not following ----------------------------------------------------------------------------


@pytest.mark.invariant(4)
async def test_inv4_stream_before_enable_is_refused_and_logged_once(logged):
    async with cell(enabled=False) as (harness, controller):
        controller.apply(Event.MOTORS_ON)
        await send(harness, lambda _: positions(pose(0.03)), 1.0)
        assert harness.driver.motion_link.statistics.frames_sent == 0
        (line,) = logged()
        assert 'is refused: the arm is not enabled' in line
        assert harness.driver.servo.counts.refused == 50
        async with sending(harness, lambda _: positions(pose(0.03))):
            await harness.commands.enable()
            assert await stays(harness)
            assert 'it holds a position' in logged()[-1]
        await asyncio.sleep(1.1 * RELEASE_S)
        await send(harness, lambda _: positions(pose(0.03)), 1.0)
        assert harness.at[0] > 0.02


@pytest.mark.invariant(4)
async def test_inv4_distant_position_is_refused_until_the_stream_is_near_the_arm(logged):
    """ros2_control first sends a joint's initial value, independent of the arm's position."""
    async with cell() as (harness, _):
        await send(harness, lambda _: positions(pose(0.8)), 1.0)
        assert await stays(harness, 0.5)
        assert harness.driver.motion_link.statistics.frames_sent == 0
        (line,) = logged()
        assert 'joint_1: it starts at 0.8 rad, the joint is at 0 rad' in line
        await send(harness, ramp(0.2), 1.5)
        await over(harness)
        assert harness.at[0] == pytest.approx(0.2, abs=1e-3)


@pytest.mark.invariant(4)
@pytest.mark.parametrize('smooth', EITHER, ids=['point to point', 'smooth'])
async def test_inv4_continuing_stream_after_estop_and_enable_moves_nothing(smooth, logged):
    """It moves the arm only after a pause."""
    async with cell(smooth=smooth) as (harness, controller):
        async with sending(harness, ramp(0.6)):
            await until(lambda: harness.at[0] > 0.2)
            controller.apply(Event.ESTOP_PRESS)
            await until(lambda: harness.gate is not None)
            await asyncio.sleep(1.0)
            sent = harness.driver.motion_link.statistics.frames_sent
            controller.apply(Event.ESTOP_RELEASE)
            controller.apply(Event.RESET)
            controller.apply(Event.MOTORS_ON)
            await until(lambda: harness.driver.robot.status.drives_powered == 1)
            assert await stays(harness)
            assert harness.driver.motion_link.statistics.frames_sent == sent
            logged()
            await harness.commands.enable()
            assert await stays(harness)
            assert [line for line in logged() if 'it holds a position: it must move' in line]
        await asyncio.sleep(1.1 * RELEASE_S)
        there = harness.at
        await send(harness, lambda _: positions(there + pose(0.03)), 0.5)
        await over(harness)
        assert np.abs(harness.at - there - pose(0.03)).max() < 1e-3


@pytest.mark.invariant(4)
async def test_inv4_key_held_during_enable_moves_nothing(logged):
    async with cell(enabled=False) as (harness, controller):
        controller.apply(Event.MOTORS_ON)
        async with sending(harness, jog()):
            await asyncio.sleep(0.2)
            await harness.commands.enable()
            assert await stays(harness)
            assert harness.driver.motion_link.statistics.frames_sent == 0
            assert 'it must be released first: 1 s without a message' in logged()[-1]
        await asyncio.sleep(1.1 * RELEASE_S)
        await send(harness, jog(), 0.5)
        assert harness.at[0] > 0.05
        await over(harness)


@pytest.mark.invariant(4)
async def test_inv4_released_joystick_counts_as_silence_and_does_not_block_goals():
    async with cell(enabled=False) as (harness, controller):
        controller.apply(Event.MOTORS_ON)
        async with sending(harness, lambda _: velocities(HOME)):
            await harness.commands.enable()
            assert (await harness.submit(pose(0.1)).end()).end is End.SUCCEEDED
        await send(harness, jog(), 0.5)
        assert harness.at[0] > 0.15
        async with sending(harness, lambda _: velocities(HOME)):
            await over(harness)


async def test_stop_of_a_goal_does_not_start_a_waiting_stream():
    async with cell() as (harness, _):
        goal = harness.submit(pose(1.0))
        await harness.until_moving()
        async with sending(harness, lambda _: positions(harness.at + pose(0.02))):
            await asyncio.sleep(0.1)
            await harness.commands.stop()
            assert goal.outcome.end is End.ABORTED
            assert await stays(harness)


async def test_goal_and_stream_exclude_each_other(logged):
    async with cell() as (harness, _):
        goal = harness.submit(pose(0.3))
        await harness.until_moving()
        await send(harness, lambda _: positions(harness.at), 0.2)
        assert not goal.outcomes
        assert 'is refused: another motion runs' in logged()[-1]
        assert (await goal.end()).end is End.SUCCEEDED
        await asyncio.sleep(RELEASE_S)
        async with sending(harness, ramp(start=0.3)):
            await until(lambda: harness.driver.servo.active)
            refused = harness.submit(pose(0.5))
            assert refused.outcome.end is End.ABORTED
            assert 'follows a stream of setpoints on ~/servo' in refused.outcome.text
            assert 'hold still for a second' in refused.outcome.remedy.value
            assert harness.driver.servo.active
        await asyncio.sleep(0.15)
        await until(lambda: not harness.driver.robot.sample.velocities.any())
        await over(harness)
        assert (await harness.submit(pose(0.2)).end()).end is End.SUCCEEDED


async def test_stream_that_holds_its_position_for_a_second_is_over():
    async with (
        cell(smooth=True) as (harness, _),
        sending(harness, lambda time: positions(pose(min(0.2 * time, 0.1)))),
    ):
        await until(lambda: harness.driver.servo.active)
        await until(lambda: not harness.driver.servo.active)
        assert harness.at == pytest.approx(pose(0.1), abs=1e-4)
        assert (await harness.submit(pose(0.3)).end()).end is End.SUCCEEDED
        assert await stays(harness)


async def test_first_of_two_streams_is_followed(logged):
    async with cell(smooth=True) as (harness, _):
        async with sending(harness, ramp(0.4)), sending(harness, jog(-1.0)):
            await until(lambda: harness.at[0] > 0.39)
        assert harness.driver.servo.counts.refused > 10
        (line,) = [line for line in logged() if 'is refused' in line]
        assert '~/joint_jog is refused: the arm follows the position stream' in line


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
async def test_invalid_setpoints_are_dropped_and_the_stream_continues(setpoint, text, logged):
    async with cell(smooth=True) as (harness, _):
        async with sending(harness, ramp(0.3)), sending(harness, lambda _: setpoint, 0.05):
            await until(lambda: harness.at[0] > 0.29)
        await over(harness)
        lines = [line for line in logged() if 'dropped' in line]
        assert text in lines[0]
        assert len(lines) < 6  # once a second
        assert harness.gate is None


async def test_invalid_setpoints_are_logged_once_before_a_stream_and_each_second_after(
    logged, caplog
):
    """joint_trajectory_controller sends NaN if it is activated before the first joint state."""
    async with cell(smooth=True) as (harness, _):
        await send(harness, lambda _: positions([np.nan] * 6), 5.0)
        assert [record.levelname for record in caplog.records if 'servo' in record.name] == [
            'INFO'
        ]
        (line,) = logged()
        assert 'its sender has no state yet' in line
        assert harness.driver.servo.counts.refused == 250
        await send(harness, lambda _: positions(harness.at), 0.1)
        logged()
        await send(harness, lambda _: positions(pose(np.nan)), 3.0)
        assert len([line for line in logged() if 'dropped' in line]) > 1


# --- when something fails ---------------------------------------------------------------------


@pytest.mark.invariant(3)
@pytest.mark.parametrize('how', one_in(2, ['disable', 'lost link', 'pause', 'fault']))
async def test_inv3_fault_in_a_stream_stops_the_arm(how):
    async with cell(smooth=True) as (harness, controller):
        async with sending(harness, ramp()):
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


@pytest.mark.invariant(9)
@pytest.mark.parametrize('pressed', [True, False])
async def test_inv9_refused_setpoint_stops_and_disables_and_the_log_has_the_cause(pressed, caplog):
    """The refusal may arrive before the STATUS of the E-stop that caused it."""

    def reply(sequence):
        return answer(2 if sequence == 2 else 1, sequence)

    async with scripted_cell(reply) as (harness, scripted):
        async with sending(harness, lambda _: positions(pose(0.04))):
            await until(lambda: harness.gate is not None)
            assert 'the controller refused setpoint 2' in harness.gate
            assert not harness.driver.servo.active
            assert 'arm disabled' not in caplog.text
            await asyncio.sleep(0.05)
            if pressed:
                scripted.status = (0, 1, 0, 0, 0, 2, 0)
            await until(lambda: 'arm disabled' in caplog.text)
        (line,) = [message for message in caplog.messages if 'arm disabled' in message]
        assert 'the controller refused setpoint 2' in line
        assert ('the E-stop was pressed' in line) == pressed
        assert scripted.received[:3] == [0, 1, 2]
        assert set(scripted.received[3:]) == {-4}


@pytest.mark.invariant(9)
async def test_inv9_unanswered_setpoint_stops_and_disables():
    def reply(sequence):
        return b'' if sequence == 1 else answer(1, sequence)

    async with scripted_cell(reply) as (harness, scripted):
        harness.driver.servo.settings = ServoSettings(reply_timeout=0.5)
        start = now()
        async with sending(harness, lambda _: positions(pose(0.04))):
            await until(lambda: harness.gate is not None)
        assert 0.4 < now() - start < 1.5
        assert 'no reply to setpoint 1' in harness.gate
        assert scripted.received[:2] == [0, 1]  # one pending at a time


@pytest.mark.invariant(3)
async def test_inv3_long_setpoint_period_does_not_delay_the_stop_after_silence():
    async with cell(smooth=True) as (harness, _):
        harness.driver.servo.settings = ServoSettings(period=0.2)
        await send(harness, jog(), 1.0)
        sent = harness.at[0]
        await over(harness)
        # silence timeout, time to the next point, points already sent, stopping distance
        assert harness.at[0] - sent < SPEED * (0.1 + 0.2 + 0.3 + 0.1)
        assert harness.at[0] - sent > 0.0
        assert harness.gate is None


@pytest.mark.invariant(4)
async def test_inv4_no_point_is_sent_after_stop():
    async with scripted_cell() as (harness, scripted):
        async with sending(harness, lambda _: positions(pose(0.045))):
            await until(lambda: len(scripted.received) > 3)
            harness.driver.disable('for the test')
            await asyncio.sleep(1.0)
        points = scripted.received[: scripted.received.index(-4)]
        assert points == list(range(len(points)))
        assert set(scripted.received[len(points) :]) == {-4}


async def test_stream_ends_when_the_arm_does_not_follow():
    """The controller accepts every point and moves nothing."""
    async with scripted_cell() as (harness, scripted):
        harness.driver.servo.settings = ServoSettings(reply_timeout=1.0)
        async with sending(harness, ramp()):
            await until(lambda: harness.gate is not None)
        assert 'the arm has not followed setpoints for' in harness.gate
        assert len(scripted.received) < 1.0 / PERIOD


@pytest.mark.invariant(9)
async def test_inv9_withdrawn_acknowledgement_ends_the_stream_and_disables():
    async with cell(smooth=True) as (harness, _):
        await send(harness, jog(), 0.5)
        harness.driver.servo.withdraw()
        assert not harness.driver.servo.active
        assert 'the controller reported a failure of an accepted setpoint' in harness.gate
        await asyncio.sleep(1.0)
        assert await harness.rests()


@pytest.mark.parametrize(
    ('interface', 'message', 'reason'),
    [
        ('download', 'joint_traj_pt', 'interface: download'),
        ('streaming', 'joint_traj_pt_full', 'point_message: joint_traj_pt_full'),
    ],
)
async def test_stream_is_refused_for_downloads_and_full_points(interface, message, reason, logged):
    rules = delivery_rules(load_controller_profile('generic'), interface, message)
    async with cell(smooth=False, delivery=rules) as (harness, _):
        harness.driver.servo.take(positions(pose(0.04)))
        await asyncio.sleep(0.1)
        assert not harness.driver.servo.active
        assert harness.gate is None
        assert harness.at[0] == pytest.approx(0.0, abs=1e-6)
    text = f'with {reason} the arm follows no setpoint streams'
    assert any(text in line for line in logged())
