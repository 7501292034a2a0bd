# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Checks of joint signs and tool0 with a user who jogs: real TCP, a scripted arm."""

import asyncio

import numpy as np
import pytest
from support.event_loop import run

from epson_driver.doctor.findings import Findings, Level
from epson_driver.doctor.listening import conversation
from epson_driver.doctor.pose_checks import check_joints, check_tool
from epson_driver.robots import load_robot_model
from epson_driver.robots.kinematics import Kinematics
from epson_driver.simple_message import LITTLE_ENDIAN, JointPosition, encode, joint_data, topic

MODEL = load_robot_model('c3_a601s')
HERE = np.array([0.3, -0.4, 0.5, 0.2, -0.6, 0.1])


class Arm:
    """A scripted arm with a state port, and the user who jogs its joints one after another.

    moves: by number of the jog, the joint that moves and its step, or None for a skipped jog.
    """

    def __init__(self, moves=None, typed=''):
        self.joints = HERE.copy()
        self._moves = moves or {}
        self._typed = typed
        self._jogged = 0

    async def send(self, reader, writer):
        try:
            while self.joints is None:  # until the doctor leaves
                if not await reader.read(1):
                    raise ConnectionError
            while True:
                message = JointPosition(0, joint_data(self.joints.tolist()))
                writer.write(encode(topic(message), LITTLE_ENDIAN))
                await writer.drain()
                await asyncio.sleep(0.01)
        except ConnectionError:
            writer.close()

    async def person(self, sentence):
        if sentence.startswith('X Y Z'):
            return self._typed
        joint, self._jogged = self._jogged, self._jogged + 1
        move = self._moves.get(joint, (joint, 0.02))
        if move is None:
            return 's'
        if self.joints is not None:
            self.joints[move[0]] += move[1]
        return ''


def checked(arm, check):
    findings = Findings(lambda finding: None)

    async def scenario():
        server = await asyncio.start_server(arm.send, '127.0.0.1', 0)
        port = server.sockets[0].getsockname()[1]
        async with conversation('127.0.0.1', port) as state:
            await check(state, MODEL, arm.person, findings)
        server.close()
        await asyncio.sleep(0.1)

    run(scenario())
    return {item.about: item for item in findings.all}


def test_joints_that_follow_the_jog_are_ok():
    assert {item.level for item in checked(Arm(), check_joints).values()} == {Level.OK}


@pytest.mark.parametrize(
    ('moves', 'joint', 'message', 'remedy'),
    [
        ({2: (2, -0.02)}, 3, 'it has the opposite sign', 'joint_signs: -1 for joint_3'),
        ({1: (4, 0.02)}, 2, 'joint_2 did not move, but number 5 did', 'joint_names'),
        ({0: (0, 0.001)}, 1, 'no joint moved', 'jog further'),
        ({3: ([3, 5], 0.02)}, 4, 'number 6 moved too', 'one joint'),
    ],
)
def test_wrong_joint_is_reported_with_remedy(moves, joint, message, remedy):
    result = checked(Arm(moves), check_joints)
    assert result[f'joint {joint}'].level is Level.WRONG
    assert message in result[f'joint {joint}'].text
    assert remedy in result[f'joint {joint}'].remedy
    assert sum(item.level is Level.WRONG for item in result.values()) == 1


def test_jog_of_a_joint_can_be_skipped():
    assert checked(Arm({3: None}), check_joints)['joint 4'].level is Level.SKIPPED


def shown(off_mm=0.0, turned_deg=0.0):
    position, angles = Kinematics(MODEL).epson_point(HERE)
    off, turned = np.array([off_mm, 0, 0]), np.array([turned_deg, 0, 0])
    numbers = [*(position * 1000.0 + off), *(np.degrees(angles) + turned)]
    return ' '.join(f'{value:.3f}' for value in numbers)


@pytest.mark.parametrize(
    ('typed', 'level', 'message'),
    [
        (shown(), Level.OK, 'matches the pendant'),
        (shown(turned_deg=360.0), Level.OK, 'matches the pendant'),
        (shown(off_mm=5.0), Level.WRONG, '5.0 mm'),
        (shown(turned_deg=2.0), Level.WRONG, '2.00 degrees'),
        ('', Level.SKIPPED, 'no input'),
        ('1 2 3', Level.WRONG, 'must be six numbers'),
        ('1 2 3 4 5 nan', Level.WRONG, 'must be six numbers'),
    ],
)
def test_tool0_is_compared_with_the_pendant(typed, level, message):
    result = checked(Arm(typed=typed), check_tool)['tool0']
    assert result.level is level
    assert message in result.text


@pytest.mark.invariant(8)
@pytest.mark.parametrize('joints', [None, np.full(6, np.nan)], ids=['none', 'no numbers'])
def test_missing_or_non_finite_joints_are_errors(joints):
    """NaN differs from nothing, so a comparison alone would accept it."""
    arm = Arm(typed=shown())
    arm.joints = joints
    result = [*checked(arm, check_joints).values(), *checked(arm, check_tool).values()]
    assert len(result) == 7
    assert {item.level for item in result} == {Level.WRONG}
    assert {item.text for item in result} == {'no joint states with finite numbers received'}
