# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Checks that the robot model fits the arm: signs and order of the joints, and tool0.

A person jogs each joint a little with the pendant, and types the X Y Z U V W that the pendant
displays. Nothing is sent to the controller.
"""

import asyncio
import math
from collections.abc import Awaitable, Callable

import numpy as np

from epson_driver.doctor.findings import Findings
from epson_driver.doctor.listening import Conversation
from epson_driver.doctor.state_facts import latest_joints
from epson_driver.motion import Array
from epson_driver.robots import RobotModel
from epson_driver.robots.kinematics import Kinematics

MIN_JOG = 0.004
"""Minimum motion of a jogged joint, rad or m: a quarter of a degree, 4 mm."""

MAX_OTHERS_FRACTION = 0.2
"""Maximum motion of the other joints, as a fraction of the jogged joint's motion. Some motion is
allowed, because axes may be coupled."""

POSITION_TOLERANCE_M = 0.001
ANGLE_TOLERANCE_RAD = math.radians(0.2)

Ask = Callable[[str], Awaitable[str]]

NEXT_STATE_TIMEOUT_S = 2.0

NO_JOINTS = 'no joint states with finite numbers received'


async def check_joints(
    state: Conversation, model: RobotModel, ask: Ask, findings: Findings
) -> None:
    names = model.joint_names
    for index, name in enumerate(names):
        before = await _standing(state, len(names))
        answer = await ask(
            f'Jog J{index + 1} a little in its + direction (a degree is enough), then press Enter '
            '(s: skip): '
        )
        after = await _standing(state, len(names))
        about = f'joint {index + 1}'
        if answer.strip().lower().startswith('s'):
            findings.skipped(about, 'not jogged')
        elif before is None or after is None:
            findings.wrong(about, NO_JOINTS, 'check the state port')
        else:
            _judge_jog(index, name, after - before, findings)


def _judge_jog(index: int, name: str, moved: Array, findings: Findings) -> None:
    about, largest = f'joint {index + 1}', int(np.argmax(np.abs(moved)))
    others = np.delete(np.abs(moved), index)
    if abs(moved[largest]) < MIN_JOG:
        text = f'no joint moved by more than {MIN_JOG:g} rad or m'
        findings.wrong(
            about, text, 'jog further. If it moved, check whether this is the state of another arm'
        )
    elif largest != index:
        text = f'{name} did not move, but number {largest + 1} did'
        findings.wrong(about, text, 'put joint_names into the order of the controller')
    elif others.max(initial=0.0) > MAX_OTHERS_FRACTION * abs(moved[index]):
        number = int(np.argmax(np.where(np.arange(len(moved)) == index, 0.0, np.abs(moved)))) + 1
        text = f'number {number} moved too'
        remedy = 'jog one joint in joint mode. If you did, axes are coupled: set joint_coupling'
        findings.wrong(about, text, remedy)
    elif moved[index] < 0.0:
        text = f'{name} decreased: it has the opposite sign'
        findings.wrong(about, text, f'joint_signs: -1 for {name}')
    else:
        findings.ok(about, f'{name} moves in the right direction')


async def check_tool(state: Conversation, model: RobotModel, ask: Ask, findings: Findings) -> None:
    message = await ask(
        'X Y Z U V W on the pendant for Tool 0, Local 0, in mm and degrees (Enter: skip): '
    )
    if not message.strip():
        findings.skipped('tool0', 'no input')
        return
    try:
        numbers = [float(word) for word in message.replace(',', ' ').split()]
        if len(numbers) != 6 or not all(map(math.isfinite, numbers)):
            raise ValueError
    except ValueError:
        findings.wrong(
            'tool0', f'{message.strip()[:80]!r}: must be six numbers', 'enter X Y Z U V W'
        )
        return
    joints = await _standing(state, len(model.joint_names))
    if joints is None:
        findings.wrong('tool0', NO_JOINTS, 'check the state port')
        return
    position, angles = Kinematics(model).epson_point(joints)
    off = np.abs(np.array(numbers[:3]) / 1000.0 - position)
    turned = np.abs(_wrapped(np.radians(numbers[3:]) - angles))
    shown = ' '.join(f'{v:.2f}' for v in (*(position * 1000.0), *np.degrees(angles)))
    if off.max() > POSITION_TOLERANCE_M or turned.max() > ANGLE_TOLERANCE_RAD:
        text = (
            f'{off.max() * 1000.0:.1f} mm and {math.degrees(turned.max()):.2f} degrees off, '
            f'expected {shown}'
        )
        remedy = 'check robot_model, Tool 0 and Local 0 on the pendant, joint_offsets, joint_signs'
        findings.wrong('tool0', text, remedy)
    else:
        findings.ok('tool0', f'matches the pendant: {shown}')


def _wrapped(angles: Array) -> Array:
    return np.asarray((angles + np.pi) % (2.0 * np.pi) - np.pi)


async def _standing(state: Conversation, joints: int) -> Array | None:
    if not await state.another_packet(NEXT_STATE_TIMEOUT_S):
        return None
    await asyncio.sleep(0.2)  # a joint state, not only a STATUS, has arrived by this time
    result = latest_joints(state.traffic)
    if result is None or not np.all(np.isfinite(result[:joints])):
        return None
    return np.array(result[:joints])
