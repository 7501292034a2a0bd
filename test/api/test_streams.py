# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Setpoint streams of the Python API, samples, and waiting for conditions."""

import asyncio
import contextlib

import numpy as np
import pytest
from support.api_harness import robot_cell
from support.event_loop import now
from support.examples import one_in
from support.policy_lag import behind, policy

from benchmark.exact_extrema import exact_extrema
from epson_driver.aio import ArgumentError, MotionError, PathError, RobotError
from epson_driver.motion.setpoint_tracker import SetpointTracker
from epson_driver.sim_controller.arm import setpoint_follower
from epson_driver.sim_controller.condition.states import Event
from epson_driver.simple_message import IoType

BENT = [0.0, 0.2, 0.2, 0.0, -1.2, 0.0]


def sine(time):
    """Return joints on a sine of 0.2 rad at 0.25 Hz that starts at rest."""
    joints = np.zeros(6)
    joints[0] = 0.1 * (1.0 - np.cos(2.0 * np.pi * 0.25 * time))
    return joints


async def streamed(send, seconds, rate=30.0):
    """Call `send` with the elapsed time at `rate` Hz for `seconds`."""
    for number in range(int(seconds * rate)):
        send(number / rate)
        await asyncio.sleep(1.0 / rate)


def refused(robot, joints):
    """Assert that a stopped or disabled arm rejects a setpoint with a remedy."""
    with pytest.raises(RobotError, match=r'call |is being stopped'):
        robot.servo(joints)


async def at_rest(robot):
    """Wait for the arm to stop, assert that it stays at rest, and return its position."""
    await robot.servo_end()
    here = robot.joints
    await asyncio.sleep(0.5)
    assert robot.joints == pytest.approx(here, abs=1e-3)
    return here


@pytest.mark.invariant(2)
@pytest.mark.slow
@pytest.mark.parametrize('rate', [30.0, 15.0, 500.0])
async def test_setpoints_at_any_rate_are_followed_to_the_last_one(rate):
    async with robot_cell(smooth=True) as (robot, _):
        seen = []
        robot.on_joints(seen.append)
        await streamed(lambda time: robot.servo(sine(time)), 4.0, rate)
        counts = robot._connection.driver.servo.counts
        assert (counts.refused, counts.late, counts.received) == (0, 0, 4.0 * rate)
        assert await at_rest(robot) == pytest.approx(sine(4.0 - 1.0 / rate), abs=2e-3)
        speed = max(np.abs(sample.velocities[0]) for sample in seen)
        assert 0.12 < speed < 0.25 * robot.model.limits.velocity[0]
        assert max(sample.positions[0] for sample in seen) == pytest.approx(0.2, abs=0.02)
        await robot.move_joints(np.zeros(6))


@pytest.mark.invariant(2)
@pytest.mark.slow
async def test_setpoints_of_a_30_hz_policy_are_followed_within_limits(monkeypatch):
    """Limits are checked on the executed polynomials, which miss no peak between samples."""
    trackers = []

    class Recorded(SetpointTracker):
        def __init__(self, limits, position):
            self.executed, self.now, self.start = [], 0.0, position
            trackers.append(self)
            super().__init__(limits, position)

        def _execute(self, motion, *, final):
            if started := super()._execute(motion, final=final):
                self.executed.append((self.now, motion))
            return started

        def step(self, dt):
            self.now += dt
            return super().step(dt)

    monkeypatch.setattr(setpoint_follower, 'SetpointTracker', Recorded)
    async with robot_cell(smooth=True) as (robot, _):
        rows = []
        robot.on_joints(lambda sample: rows.append((now(), sample.positions[0])))
        start = now()
        await streamed(lambda time: robot.servo([policy(time), 0, 0, 0, 0, 0]), 8.0)
        times, positions = np.array(rows).T
        counts = robot._connection.driver.servo.counts
        assert (counts.received, counts.refused, counts.late) == (240, 0, 0)
        await robot.servo_end()
    lag, rms = behind(times - start, positions, policy)
    assert 0.05 < lag < 0.13
    assert rms < 2e-3
    result = [exact_extrema(tracker, tracker.start) for tracker in trackers]
    assert max(item.worst for item in result) < 1.001
    assert 0.04 < max(item.velocity for item in result) < 0.1
    assert max(item.acceleration_jump for item in result) < 1e-9


async def test_arm_follows_a_velocity_stream_and_stops_at_its_end():
    async with robot_cell(smooth=True) as (robot, _):
        velocity = [0.2, 0, 0, 0, 0, 0]
        await streamed(lambda _: robot.servo_velocity(velocity), 2.0)
        there = await at_rest(robot)
        assert 0.3 < there[0] < 0.5
        assert np.abs(there[1:]).max() < 1e-3


@pytest.mark.parametrize('frame', one_in(2, ['tool', 'base_link']))
async def test_constant_tool_velocity_moves_the_tool_on_a_straight_line(frame):
    async with robot_cell(smooth=True) as (robot, _):
        await robot.move_joints(BENT)
        before = robot.tool_pose
        twist = [0.0, 0.05, 0.0, 0.0, 0.0, 0.0]
        await streamed(lambda _: robot.servo_speed(twist, frame=frame), 1.5)
        await at_rest(robot)
        moved = robot.tool_pose[:3, 3] - before[:3, 3]
        along = before[:3, 1] if frame == 'tool' else np.array([0.0, 1.0, 0.0])
        assert 0.05 < moved @ along < 0.1
        assert np.linalg.norm(moved - (moved @ along) * along) < 2e-3
        assert robot.tool_pose[:3, :3] == pytest.approx(before[:3, :3], abs=5e-3)


async def test_pose_setpoints_are_followed_and_a_jump_is_rejected():
    async with robot_cell(smooth=True) as (robot, _):
        await robot.move_joints(BENT)
        start = robot.tool_pose

        def send(time):
            pose = start.copy()
            pose[2, 3] -= 0.03 * time
            robot.servo_pose(pose)

        await streamed(send, 1.0)
        await at_rest(robot)
        assert start[2, 3] - robot.tool_pose[2, 3] == pytest.approx(0.029, abs=1e-3)
        with pytest.raises(PathError, match='out of reach'):
            robot.servo_pose(start + np.diag([0, 0, 0, 0.0]) + 3.0 * np.eye(4, k=3))
        away = start.copy()
        away[:3, :3] = away[:3, :3] @ np.diag([-1.0, -1.0, 1.0])
        with pytest.raises(PathError, match='would have to jump'):
            robot.servo_pose(away)


async def test_impossible_tool_velocity_is_rejected():
    async with robot_cell(smooth=True) as (robot, _):
        with pytest.raises(PathError, match='cannot move in this direction'):
            robot.servo_speed([0.0, 0.05, 0.0, 0.0, 0.0, 0.0])
    async with robot_cell(smooth=True, model='gx4_c251s') as (robot, _):
        with pytest.raises(PathError, match='cannot move in this direction'):
            robot.servo_speed([0.0, 0.0, 0.0, 0.1, 0.0, 0.0])


@pytest.mark.invariant(3, 4)
@pytest.mark.parametrize('how', one_in(3, ['E-stop', 'stop', 'disable']))
async def test_continued_stream_is_rejected_after_a_stop_until_released(how):
    async with robot_cell(smooth=True) as (robot, controller):
        await streamed(lambda time: robot.servo(sine(time)), 1.0)
        if how == 'stop':
            await robot.stop()
        elif how == 'disable':
            await robot.disable()
        else:
            controller.apply(Event.ESTOP_PRESS)
            await robot.wait_until(lambda sample: bool(sample.status.e_stopped), timeout=2.0)
            controller.apply(Event.ESTOP_RELEASE)
            await streamed(lambda time: refused(robot, sine(time)), 1.5)
            await robot.reset()
        rate, seconds = 30.0, 2.0
        if how != 'stop':
            await robot.enable()
        await robot.wait_until(lambda sample: np.abs(sample.velocities).max() < 1e-3)
        here = robot.joints
        for number in range(int(seconds * rate)):
            with pytest.raises(RobotError, match='must be released first'):
                robot.servo(here + 0.002 * (number % 2 + 1))
            await asyncio.sleep(1.0 / rate)
        assert robot.joints == pytest.approx(here, abs=1e-3)
        await asyncio.sleep(1.1)
        robot.servo(here + 0.01)
        assert await at_rest(robot) == pytest.approx(here + 0.01, abs=2e-3)


@pytest.mark.invariant(4)
async def test_stream_before_enable_is_rejected_and_never_moves():
    async with robot_cell(enabled=False, smooth=True) as (robot, _):
        for number in range(30):
            with pytest.raises(MotionError, match=r'not enabled .*call enable\(\)'):
                robot.servo(np.full(6, 0.02 * (number % 2)))
            await asyncio.sleep(0.03)
        await robot.enable()
        with pytest.raises(RobotError, match='must be released first'):
            robot.servo(np.full(6, 0.01))
        await asyncio.sleep(1.0)
        assert not robot.joints.any()


@pytest.mark.invariant(1, 2)
@pytest.mark.parametrize(
    ('method', 'value', 'expected'),
    [
        ('servo', [float('nan')] * 6, r'target: joint_1 = nan: must be a finite number'),
        ('servo', [0.0] * 5, r'target has shape \(5,\): must be \(6,\)'),
        ('servo', ['0.1'] * 6, 'target: must be numbers'),
        ('servo_velocity', [100.0] + [0.0] * 5, 'velocities: joint_1 = 100 rad/s is above'),
        ('servo_velocity', [0.0] * 5 + [float('inf')], 'velocities: joint_6 = inf'),
        ('servo_speed', [0.1] * 5, r'velocity has shape \(5,\): must be \(6,\)'),
        ('servo_speed', [float('nan')] * 6, 'velocity'),
        ('servo_pose', np.eye(3), r'pose has shape \(3, 3\)'),
        ('servo_pose', 1e3 * np.array([1, 1, 1, 0, 0, 0, 1e-3]), 'positions are in m'),
    ],
)
async def test_invalid_setpoint_is_rejected_and_nothing_moves(method, value, expected):
    async with robot_cell(smooth=True) as (robot, _):
        with pytest.raises(ArgumentError, match=expected) as caught:
            getattr(robot, method)(value)
        assert '\n' not in str(caught.value)
        await asyncio.sleep(0.5)
        assert not robot.joints.any()
    with pytest.raises(RobotError, match=r'call connect\(\)'):
        getattr(robot, method)(value)


@pytest.mark.slow
@pytest.mark.invariant(2)
async def test_hostile_setpoints_exceed_no_limit_and_the_arm_stops():
    async with robot_cell(smooth=True) as (robot, _):
        random = np.random.default_rng(31)
        fastest = 0.0
        await streamed(lambda time: robot.servo(sine(time)), 0.5)
        for _ in range(60):
            action = random.uniform(-3.0, 3.0, 6)
            action[random.integers(6)] = random.choice([np.nan, 3.0, -3.0])
            with contextlib.suppress(ArgumentError):
                robot.servo(action)
            await asyncio.sleep(random.choice([0.01, 0.03, 0.12]))
            fraction = np.abs(robot.joint_velocities) / robot.model.limits.velocity
            fastest = max(fastest, float(fraction.max()))
        assert 0.05 < fastest < 0.3
        await asyncio.sleep(1.5)
        here = robot.joints
        await asyncio.sleep(0.5)
        assert robot.joints == pytest.approx(here, abs=1e-3)


async def test_samples_have_time_stamps_and_wait_until_awaits_one():
    async with robot_cell() as (robot, controller):
        first = robot.sample()
        assert first.positions == pytest.approx(robot.joints)
        assert first.status.enabled
        motion = await robot.move_joints([0.4, 0, 0, 0, 0, 0], wait=False)
        passed = await robot.wait_until(lambda sample: sample.positions[0] > 0.2, timeout=9.0)
        assert not motion.done
        assert passed.time > first.time
        await motion.wait()
        with pytest.raises(TimeoutError, match=r'not met within 0\.3 s'):
            await robot.wait_until(lambda sample: sample.positions[0] > 1.0, timeout=0.3)
        waiting = asyncio.create_task(robot.wait_for_input(3))
        await asyncio.sleep(0.3)
        assert not waiting.done()
        controller.io.set_input(IoType.DIGITAL_INPUT, 3, 1)
        await waiting
        with pytest.raises(TimeoutError, match=r'DI 3 was not 0 within 0\.2 s'):
            await robot.wait_for_input(3, 0, timeout=0.2)
        with pytest.raises(ValueError, match='must be DI or DO'):
            await robot.wait_for_input(3, kind='door')
