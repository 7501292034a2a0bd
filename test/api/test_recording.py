# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Recordings of motions: sampling, files, and replay along the same path in the same time."""

import asyncio

import numpy as np
import pytest
from support.api_harness import robot_cell
from support.examples import one_in

from epson_driver.aio import ArgumentError, Recording, Robot, RobotError
from epson_driver.robots import load_robot_model

HOME = [0.0, 0.2, 0.2, 0.0, -1.9, 0.0]
AWAY = [0.5, 0.3, 0.0, 0.2, -1.5, 0.4]
LIMITS = load_robot_model('c3_a601s').limits


async def recorded(robot):
    """Record a move, a line, a rest of 0.5 s, and the move back."""
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


def max_distance(rows, others):
    """Return the maximum distance of joint rows from the path through others, rad."""
    fine = np.linspace(0, len(others) - 1, 20 * len(others))
    path = np.array([np.interp(fine, np.arange(len(others)), column) for column in others.T]).T
    return max(np.abs(path - row).max(axis=1).min() for row in rows)


@pytest.mark.parametrize('profile', one_in(3, ['generic', 'simulated', 'motoman']))
async def test_replay_follows_the_recorded_path_in_the_recorded_time(profile):
    async with robot_cell(profile=profile, smooth=profile != 'generic') as (robot, _):
        recording = await recorded(robot)
        again = robot.record()
        motion = await robot.replay(recording)
        again.stop()
        assert motion.duration == pytest.approx(recording.duration - 0.5, abs=0.2)
        assert max_distance(again.positions, recording.positions) < 0.005
        assert max_distance(recording.positions, again.positions) < 0.005
        assert again.duration == pytest.approx(motion.duration, abs=0.5)
        slow = await robot.replay(recording, speed=0.5)
        assert slow.duration == pytest.approx(2.0 * motion.duration, abs=0.05)
        assert len(recording) > 50


@pytest.mark.slow
async def test_replay_from_a_file_first_moves_to_the_start(tmp_path):
    async with robot_cell(smooth=True) as (robot, _):
        recording = await recorded(robot)
        recording.save(tmp_path / 'demo.yaml')
        await robot.move_joints([-0.3, *HOME[1:]])
        again = robot.record()
        motion = await robot.replay(tmp_path / 'demo.yaml')
        assert robot.joints == pytest.approx(HOME, abs=1e-3)
        path = again.positions
        start = np.abs(path - HOME).max(axis=1).argmin()
        assert max_distance(path[start:], recording.positions) < 0.005
        assert motion.duration > recording.duration - 0.5
        read = Recording.load(tmp_path / 'demo.yaml')
        assert read.positions == pytest.approx(recording.positions, abs=1e-8)
        assert read.times == pytest.approx(recording.times, abs=1e-8)


async def test_recording_has_the_requested_rate_and_ends_with_the_connection():
    async with robot_cell() as (robot, _):
        at_100, unthrottled = robot.record(rate=100.0), robot.record()
        await asyncio.sleep(2.0)
        at_100.stop()
        await asyncio.sleep(1.0)
    assert len(at_100) == pytest.approx(200, abs=6)
    assert len(unthrottled) == pytest.approx(546, abs=12)  # STATUS messages take some slots
    assert np.diff(at_100.times).min() > 0.0
    count = len(unthrottled)
    async with robot_cell():
        await asyncio.sleep(0.2)
    assert len(unthrottled) == count
    assert repr(at_100).startswith('<Recording: ')


def recording_of(times, positions, names=LIMITS.names):
    recording = Recording(names)
    recording._rows = list(zip(times, np.array(positions, dtype=float), strict=True))
    return recording


STEP = np.array([0.1, 0, 0, 0, 0, 0])


@pytest.mark.parametrize(
    ('recording', 'speed', 'expected'),
    [
        (recording_of([], []), 1.0, 'the recording is empty'),
        (
            recording_of([0.0, 0.8], [STEP, 2 * STEP]),
            1.0,
            r'^0 s after .*, two samples are 0\.8 s apart',
        ),
        (recording_of([0.0, 0.0], [STEP, 2 * STEP]), 1.0, 'two samples are 0 s apart'),
        (recording_of([0.0, 0.1], [[0.1] * 4] * 2, ('a', 'b', 'c', 'd')), 1.0, 'is of a, b, c, d'),
        (recording_of([0.0, 0.1], [STEP, 2 * STEP]), 0.0, 'speed = 0'),
        (recording_of([0.0, 0.1], [STEP, 2 * STEP]), 1.5, r'speed = 1\.5'),
        (recording_of([0.0, 0.1], [STEP, 2 * STEP]), float('nan'), 'speed = nan'),
        (
            recording_of([0.0, 0.1], [STEP, 100 * STEP]),
            1.0,
            r'recording: .*joint_1: position 10 rad',
        ),
        (recording_of([0.0, 0.1], [STEP, 20 * STEP]), 1.0, r'recording: .*joint_1'),
    ],
)
async def test_invalid_recording_is_rejected_and_nothing_moves(recording, speed, expected):
    async with robot_cell() as (robot, _):
        before = robot.joints
        with pytest.raises(RobotError, match=expected):
            await robot.replay(recording, speed=speed)
        assert robot.joints == pytest.approx(before, abs=1e-6)


def test_invalid_file_and_missing_connection_are_reported(tmp_path):
    (tmp_path / 'bad.yaml').write_text('points: 3\n')
    with pytest.raises(ArgumentError, match=r'bad\.yaml: joint_names is missing'):
        Recording.load(tmp_path / 'bad.yaml')
    with pytest.raises(RobotError, match='no connection'):
        Robot().record()
    with pytest.raises(ArgumentError, match='rate = 0'):
        Robot().record(rate=0)
    with pytest.raises(RobotError, match='is empty'):
        Recording(LIMITS.names).save(tmp_path / 'out.yaml')
