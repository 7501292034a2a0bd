# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Recorded motions: what is measured, kept in files, and replayed on the way and in the time."""

import asyncio

import numpy as np
import pytest
from support.api_harness import robot_cell
from support.event_loop import run
from support.examples import one_in

from epson_driver.aio import ArgumentError, Recording, Robot, RobotError
from epson_driver.motion import Trajectory
from epson_driver.robots import load_robot_model
from epson_driver.trajectory_file import write_trajectory

HOME = [0.0, 0.2, 0.2, 0.0, -1.9, 0.0]
AWAY = [0.5, 0.3, 0.0, 0.2, -1.5, 0.4]
LIMITS = load_robot_model('c3_a601s').limits


async def recorded(robot):
    """Record a move, a line, a rest of half a second, and the way back."""
    await robot.move_joints(HOME)
    recording = robot.record()
    await asyncio.sleep(0.5)
    await robot.move_joints(AWAY, speed=0.5)
    pose = robot.pose
    pose[:3, 3] += [0.0, -0.1, 0.05]
    await robot.move_line(pose, speed=0.3)
    await asyncio.sleep(0.5)
    await robot.move_joints(HOME, speed=0.4)
    recording.stop()
    return recording


def apart(rows, others):
    """Return how far rows of joints are from the way of others at most, rad."""
    fine = np.linspace(0, len(others) - 1, 20 * len(others))
    way = np.array([np.interp(fine, np.arange(len(others)), column) for column in others.T]).T
    return max(np.abs(way - row).max(axis=1).min() for row in rows)


@pytest.mark.parametrize('profile', one_in(3, ['generic', 'simulated', 'motoman']))
def test_a_replay_goes_the_recorded_way_in_its_time_and_rests_where_it_rested(profile):
    async def scenario():
        async with robot_cell(profile=profile, smooth=profile != 'generic') as (robot, _):
            recording = await recorded(robot)
            again = robot.record()
            motion = await robot.replay(recording)
            again.stop()
            assert motion.duration == pytest.approx(recording.duration - 0.5, abs=0.2)
            assert apart(again.positions, recording.positions) < 0.005
            assert apart(recording.positions, again.positions) < 0.005
            assert again.duration == pytest.approx(motion.duration, abs=0.5)
            slow = await robot.replay(recording, speed=0.5)
            assert slow.duration == pytest.approx(2.0 * motion.duration, abs=0.05)
            assert len(recording) > 50

    run(scenario())


@pytest.mark.slow
def test_from_elsewhere_the_arm_goes_to_the_begin_first_and_a_file_does_as_well(tmp_path):
    async def scenario():
        async with robot_cell(smooth=True) as (robot, _):
            recording = await recorded(robot)
            recording.save(tmp_path / 'demo.yaml')
            await robot.move_joints([-0.3, *HOME[1:]])
            again = robot.record()
            motion = await robot.replay(tmp_path / 'demo.yaml')
            assert robot.joints == pytest.approx(HOME, abs=1e-3)
            way = again.positions
            begin = np.abs(way - HOME).max(axis=1).argmin()
            assert apart(way[begin:], recording.positions) < 0.005
            assert motion.duration > recording.duration - 0.5
            read = Recording.load(tmp_path / 'demo.yaml')
            assert read.positions == pytest.approx(recording.positions, abs=1e-8)
            assert read.times == pytest.approx(recording.times, abs=1e-8)

    run(scenario())


def test_the_rate_is_what_was_asked_for_and_the_end_is_that_of_the_connection():
    async def scenario():
        async with robot_cell() as (robot, _):
            at_100, all_there_are = robot.record(rate=100.0), robot.record()
            await asyncio.sleep(2.0)
            at_100.stop()
            await asyncio.sleep(1.0)
        assert len(at_100) == pytest.approx(200, abs=6)
        assert len(all_there_are) == pytest.approx(546, abs=12)  # and STATUSes between
        assert np.diff(at_100.times).min() > 0.0
        count = len(all_there_are)
        async with robot_cell():
            await asyncio.sleep(0.2)
        assert len(all_there_are) == count
        assert repr(at_100).startswith('<Recording: ')

    run(scenario())


def test_a_hand_that_moves_the_arm_is_recorded_too():
    async def scenario():
        async with robot_cell(enabled=False) as (robot, _):
            recording = robot.record()
            await asyncio.sleep(0.1)
            assert len(recording) > 5

    run(scenario())


def made(times, positions, names=LIMITS.names):
    recording = Recording(names)
    recording._rows = list(zip(times, np.array(positions, dtype=float), strict=True))
    return recording


STEP = np.array([0.1, 0, 0, 0, 0, 0])


@pytest.mark.parametrize(
    ('recording', 'speed', 'why'),
    [
        (made([], []), 1.0, 'the recording is empty'),
        (made([0.0, 0.8], [STEP, 2 * STEP]), 1.0, r'0\.8 s between two samples, 0 s from'),
        (made([0.0, 0.0], [STEP, 2 * STEP]), 1.0, 'between two samples'),
        (made([0.0, 0.1], [[0.1] * 4] * 2, ('a', 'b', 'c', 'd')), 1.0, 'is of a, b, c, d'),
        (made([0.0, 0.1], [STEP, 2 * STEP]), 0.0, 'speed = 0'),
        (made([0.0, 0.1], [STEP, 2 * STEP]), 1.5, r'speed = 1\.5'),
        (made([0.0, 0.1], [STEP, 2 * STEP]), float('nan'), 'speed = nan'),
        (made([0.0, 0.1], [STEP, 100 * STEP]), 1.0, r'recording: .*joint_1: position 10 rad'),
        (made([0.0, 0.1], [STEP, 20 * STEP]), 1.0, r'recording: .*joint_1'),
    ],
)
def test_what_cannot_be_replayed_is_one_sentence_and_nothing_moves(recording, speed, why):
    async def scenario():
        async with robot_cell() as (robot, _):
            before = robot.joints
            with pytest.raises(RobotError, match=why):
                await robot.replay(recording, speed=speed)
            assert robot.joints == pytest.approx(before, abs=1e-6)

    run(scenario())


def test_a_file_that_is_none_and_a_robot_without_a_connection_are_said(tmp_path):
    (tmp_path / 'bad.yaml').write_text('points: 3\n')
    with pytest.raises(ArgumentError, match=r'bad\.yaml: joint_names is missing'):
        Recording.load(tmp_path / 'bad.yaml')
    with pytest.raises(RobotError, match='there is no connection'):
        Robot().record()
    with pytest.raises(ArgumentError, match='rate = 0'):
        Robot().record(rate=0)
    with pytest.raises(RobotError, match='is empty'):
        Recording(LIMITS.names).save(tmp_path / 'out.yaml')


def test_another_trajectory_is_one_too(tmp_path):
    times, rows = np.linspace(0.0, 1.0, 11), np.linspace(HOME, AWAY, 11)
    write_trajectory(tmp_path / 'plan.yaml', Trajectory(LIMITS.names, times, rows), 'a plan')
    plan = Recording.load(tmp_path / 'plan.yaml').plan(LIMITS, 1.0)
    assert plan.positions[-1] == pytest.approx(AWAY)
    assert plan.duration == pytest.approx(1.0)
