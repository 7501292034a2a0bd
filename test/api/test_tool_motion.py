# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Lines and arcs through the API: how far the tool is from the path, by its joint states."""

import asyncio
import time

import numpy as np
import pytest
from support.api_harness import robot_cell
from support.api_patience import be_patient
from support.event_loop import run

from epson_driver import Robot
from epson_driver.motion.cartesian import arc, distance_from, line
from epson_driver.profiles import load_controller_profile
from epson_driver.robots.kinematics import Kinematics, rotation_of_uvw
from epson_driver.robots.opw import KinematicsError

pytest.importorskip('py_opw_kinematics')

READY = [0.0, 0.2, 0.2, 0.0, -1.9, 0.0]
ACCURACY = 1e-4
LAG_S = load_controller_profile('rc620').servo.lag


@pytest.fixture(scope='module')
def robot():
    """Yield an enabled robot with a simulated controller, which moves smoothly, as a process."""
    with pytest.MonkeyPatch.context() as patch:
        be_patient(patch.setattr)
        with Robot.simulated(start=READY) as robot:
            robot.enable()
            yield robot


def driven(robot, motion):
    """Return where the flange was seen on the way, shape (k, 3), m."""
    arm = Kinematics(robot.model)
    joints = []
    while not motion.done:
        joints.append(robot.joints)
        time.sleep(0.002)
    motion.wait()
    return np.array([arm.forward(each)[:3, 3] for each in joints])


def cut_by_the_servos(start, via, end, speed):
    """Return by how much servos that lag cut an arc, m: what is sent is not what they follow."""
    a, b, c = (
        np.linalg.norm(one - other) for one, other in ((via, end), (end, start), (start, via))
    )
    area = np.linalg.norm(np.cross(via - start, end - start)) / 2.0
    radius = a * b * c / (4.0 * area)
    return (speed * LAG_S) ** 2 / (2.0 * radius)


@pytest.mark.parametrize('count', [4, pytest.param(100, marks=pytest.mark.slow)])
def test_lines_and_arcs_are_driven_within_a_tenth_of_a_millimetre_and_the_servos_lag(robot, count):
    random = np.random.default_rng(count)
    worst: dict[str, float] = {'line': 0.0, 'arc': 0.0}
    number = 0
    while number < count:
        robot.move_joints(READY)
        start = robot.pose
        end = start.copy()
        end[:3, 3] += random.uniform(-0.08, 0.08, 3)
        end[:3, :3] = start[:3, :3] @ rotation_of_uvw(random.uniform(-0.3, 0.3, 3))
        via = (start[:3, 3] + end[:3, 3]) / 2 + random.uniform(-0.03, 0.03, 3)
        speed = random.uniform(0.1, 0.4)
        try:
            kind = 'arc' if number % 2 else 'line'
            if number % 2:
                path = arc(start, via, end)
                motion = robot.move_arc(via, end, speed=speed, wait=False)
            else:
                path = line(start, end)
                motion = robot.move_line(end, speed=speed, wait=False)
        except ValueError:
            continue
        number += 1
        seen = driven(robot, motion)
        places = np.array([path.pose(share)[:3, 3] for share in np.linspace(0.0, 1.0, 2001)])
        away = max(distance_from(place, places) for place in seen)
        cut = cut_by_the_servos(start[:3, 3], via, end[:3, 3], speed) if kind == 'arc' else 0.0
        assert away < ACCURACY + cut
        worst[kind] = max(worst[kind], away)
        assert np.abs(robot.pose - end).max() < 1e-5
    print(*(f'{kind}: at most {away * 1e3:.3f} mm away' for kind, away in worst.items()))


@pytest.mark.invariant(1, 2)
def test_what_cannot_be_driven_is_refused_before_anything_moves(robot):
    robot.move_joints(READY)
    before, pose = robot.joints, robot.pose
    far = pose.copy()
    far[0, 3] += 1.0
    for request, expected in (
        (lambda: robot.move_line(far), r'out of reach \d+ % of the way, at \('),
        (lambda: robot.move_line(pose), 'there already'),
        (lambda: robot.move_line(pose[:3]), r'pose has shape \(3, 4\): must be \(4, 4\)'),
        (lambda: robot.move_line(2.0 * pose), 'pose: must be a rotation and a place'),
        (lambda: robot.move_line(pose * np.nan), 'pose = .*: must be finite'),
        (lambda: robot.move_line('here'), 'pose: must be numbers'),
        (lambda: robot.move_line(far, speed=0.0), 'speed = 0.0: must be a number from'),
        (lambda: robot.move_line(far, accuracy=0.0), 'accuracy = 0.0'),
        (lambda: robot.move_arc([0.0, 0.0], far), r'via has shape \(2,\): must be \(3,\)'),
        (lambda: robot.move_arc(pose[:3, 3], far), 'no arc leads from'),
    ):
        with pytest.raises(ValueError, match=expected):
            request()
    assert np.array_equal(before, robot.joints)
    assert robot.status.enabled


def test_a_point_of_the_pendant_is_the_pose_it_shows(robot):
    robot.move_joints(READY)
    assert np.allclose(robot.frames['base'] @ robot.epson_point.pose, robot.pose)


@pytest.mark.invariant(3)
def test_a_line_that_is_cancelled_stops_on_the_line():
    async def scenario():
        async with robot_cell() as (robot, _):
            await robot.move_joints(READY)
            start = robot.pose
            end = start.copy()
            end[1, 3] += 0.1
            with pytest.raises(TimeoutError):
                async with asyncio.timeout(3.0):
                    await robot.move_line(end, speed=0.01)
            place = robot.pose[:3, 3]
            assert 0.0 < place[1] - start[1, 3] < 0.1
            assert distance_from(place, np.array([start[:3, 3], end[:3, 3]])) < ACCURACY

    run(scenario())


def test_a_scara_has_no_lines_yet_and_says_so():
    async def scenario():
        async with robot_cell(model='gx4_c251s') as (robot, _):
            end = robot.pose
            end[2, 3] += 0.01
            with pytest.raises(KinematicsError):
                await robot.move_line(end)

    run(scenario())
