# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Lines and arcs through the API: path accuracy, by the joint states."""

import asyncio
import time

import numpy as np
import pytest
from support.api_harness import robot_cell
from support.api_patience import be_patient
from support.examples import one_in

from epson_driver import ArgumentError, EpsonPoint, PathError, Robot, RobotError
from epson_driver.api.moves import PathPoint, path_runs
from epson_driver.api.poses import Target
from epson_driver.motion import JointLimits, go
from epson_driver.profiles import load_controller_profile
from epson_driver.robots.kinematics import Kinematics, rotation_of_uvw
from epson_driver.tool_motion.pose_path import arc, distance_from, line
from epson_driver.tool_motion.tool_pose import homogeneous

READY = [0.0, 0.2, 0.2, 0.0, -1.9, 0.0]
ACCURACY = 1e-4
LAG_S = load_controller_profile('simulated').servo.lag


SCARA_READY = [0.3, 1.2, -0.05, 0.0]


def simulated(**arguments):
    """Yield an enabled robot with a simulated controller in a separate process."""
    with pytest.MonkeyPatch.context() as patch:
        be_patient(patch.setattr)
        with Robot.simulated(**arguments) as robot:
            robot.enable()
            yield robot


@pytest.fixture(scope='module')
def robot():
    yield from simulated(start=READY)


@pytest.fixture(scope='module')
def scara():
    yield from simulated(model='gx4_c251s', start=SCARA_READY)


@pytest.fixture
def arm(request):
    """Return a robot by the name of its fixture, and well-conditioned start joints."""
    ready = READY if request.param == 'robot' else SCARA_READY
    return request.getfixturevalue(request.param), ready


BOTH = pytest.mark.parametrize('arm', ['robot', 'scara'], indirect=True)
WITH_SCARA_IF_SLOW = pytest.mark.parametrize(
    'arm', ['robot', pytest.param('scara', marks=pytest.mark.slow)], indirect=True
)


def measured_path(robot, motion):
    """Return the measured flange positions of a motion, shape (k, 3), m."""
    arm = Kinematics(robot.model)
    joints = []
    while not motion.done:
        joints.append(robot.joints)
        time.sleep(0.002)
    motion.wait()
    return np.array([arm.forward(joint)[:3, 3] for joint in joints])


def cut_by_the_servos(start, via, end, speed):
    """Return the radial error of an arc caused by the servos' lag, m."""
    a, b, c = (
        np.linalg.norm(one - other) for one, other in ((via, end), (end, start), (start, via))
    )
    area = np.linalg.norm(np.cross(via - start, end - start)) / 2.0
    radius = a * b * c / (4.0 * area)
    return (speed * LAG_S) ** 2 / (2.0 * radius)


def bound(robot, ends, path, speed):
    """Return the shortest time from rest to rest that tool and joint limits allow, s.

    Position and orientation advance evenly along the path, so both limit the path fraction.
    """
    by_joints = go(robot.model.limits, *ends).duration
    lengths = np.array([[path.length], [path.angle]])
    with np.errstate(divide='ignore'):
        limits = np.min([[speed, 1.0, 10.0], [1.0, 10.0, 100.0]] / lengths, axis=0)
    one = np.ones(1)
    fraction = JointLimits(('share',), -one, 2.0 * one, *(limit * one for limit in limits))
    return max(by_joints, go(fraction, 0.0 * one, one).duration)


@WITH_SCARA_IF_SLOW
@pytest.mark.slow
@pytest.mark.parametrize('count', [3, pytest.param(15, marks=pytest.mark.soak)])
def test_lines_and_arcs_are_accurate_and_nearly_time_optimal(arm, count):
    robot, ready = arm
    random = np.random.default_rng(count)
    turning = np.array([0.3, 0.3, 0.3] if len(ready) == 6 else [0.3, 0.0, 0.0])
    worst: dict[str, float] = {'line': 0.0, 'arc': 0.0}
    longer = []
    number = 0
    while number < count:
        robot.move_joints(ready)
        start, first = robot.pose, robot.joints
        end = start.copy()
        end[:3, 3] += random.uniform(-0.08, 0.08, 3) * (1.0 if len(ready) == 6 else 0.5)
        end[:3, :3] = start[:3, :3] @ rotation_of_uvw(random.uniform(-1.0, 1.0, 3) * turning)
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
        planned = motion.duration
        seen = measured_path(robot, motion)
        places = np.array([path.pose(fraction)[:3, 3] for fraction in np.linspace(0.0, 1.0, 2001)])
        away = max(distance_from(place, places) for place in seen)
        cut = cut_by_the_servos(start[:3, 3], via, end[:3, 3], speed) if kind == 'arc' else 0.0
        assert away < ACCURACY + cut
        worst[kind] = max(worst[kind], away)
        assert np.abs(robot.pose - end).max() < 1e-5
        least = bound(robot, (first, robot.joints), path, speed)
        assert planned > least * 0.999
        if kind == 'line':
            assert planned < least * 1.01
        longer.append(planned / least)
    print(*(f'{kind}: at limits {away * 1e3:.3f} mm away' for kind, away in worst.items()))
    print(f'duration: {min(longer):.4f} to {max(longer):.4f} of what the limits allow')


@WITH_SCARA_IF_SLOW
@pytest.mark.parametrize('blend', [0.01, pytest.param(0.0, marks=pytest.mark.slow)])
def test_path_follows_its_lines_and_rounds_only_blended_corners(arm, blend):
    robot, ready = arm
    robot.move_joints(ready)
    start = robot.pose
    steps = [[0.0, 0.04, 0.0], [-0.04, 0.04, 0.01], [-0.04, 0.0, 0.01]]
    poses = [homogeneous(start[:3, :3], start[:3, 3] + step) for step in steps]
    motion = robot.move_path(poses, blend=blend, speed=0.2, wait=False)
    planned = motion.duration
    seen = measured_path(robot, motion)
    places = np.array(
        [
            run.pose(distance)[:3, 3]
            for run in path_runs([PathPoint(Target(pose), None, blend) for pose in poses], start)
            for distance in np.linspace(0.0, run.seams[-1], 2001).tolist()
        ]
    )
    away = max(distance_from(place, places) for place in seen)
    # the radius of curvature in a blend is about the blend radius
    assert away < ACCURACY + (0.1 * LAG_S) ** 2 / (2.0 * 0.005)
    assert np.abs(robot.pose - poses[-1]).max() < 1e-5
    print(f'blend {blend}: at limits {away * 1e3:.3f} mm away, {planned:.2f} s')


def test_lines_in_tool_and_named_frames_end_at_their_pose(robot):
    robot.move_joints(READY)
    tool = [0.0, 0.03, 0.12, 0.0, 0.0, 0.0, 1.0]
    robot.set_tool(tool, max_speed=0.25)
    try:
        start = robot.tool_pose
        assert np.allclose(robot.pose @ robot.tool, start)
        robot.set_frame('here', start)
        robot.move_line([0.0, 0.0, -0.02, 0, 0, 0, 1], frame='here')
        assert np.allclose(robot.pose_in('here')[:3, 3], [0.0, 0.0, -0.02], atol=1e-5)
        robot.move_line([0.0, 0.0, 0.02, 0, 0, 0, 1], frame='tool')
        assert np.allclose(robot.tool_pose, start, atol=1e-5)
        # turning the tool leaves its tip in place
        robot.move_line([0.0, 0.0, 0.0, *np.sin([0, 0.1, 0]), np.cos(0.1)], frame='tool')
        assert np.allclose(robot.tool_pose[:3, 3], start[:3, 3], atol=1e-5)
        assert np.abs(robot.pose[:3, 3] - (start @ np.linalg.inv(robot.tool))[:3, 3]).max() > 0.01
        with pytest.raises(ValueError, match=r'speed = 0\.3 m/s: the tool allows 0\.25 m/s'):
            robot.move_line(start, speed=0.3)
    finally:
        robot.set_tool(np.eye(4))


@pytest.mark.invariant(1, 2)
def test_invalid_tool_motion_is_rejected_before_the_arm_moves(robot):
    robot.move_joints(READY)
    before, pose = robot.joints, robot.pose
    far = pose.copy()
    far[0, 3] += 1.0
    for request, expected in (
        (lambda: robot.move_line(far), r'out of reach \d+ % of the way, at \('),
        (lambda: robot.move_line(far, speed=0.0), 'speed = 0.0: must be a number from'),
        (lambda: robot.move_path([far, pose], blend=2.0), r'points\[0\]: the motion is 1 m long'),
        (lambda: robot.move_arc(pose[:3, 3], far), 'no arc from'),
    ):
        with pytest.raises(ArgumentError, match=expected) as caught:
            request()
        assert isinstance(caught.value, RobotError)
        assert isinstance(caught.value, ValueError)
        assert isinstance(caught.value, PathError) == ('out of reach' in expected)
    assert np.array_equal(before, robot.joints)
    assert robot.status.enabled


@BOTH
def test_line_too_fast_for_a_joint_is_slowed_or_rejected(arm):
    robot, ready = arm
    robot.move_joints(ready, speed=1.0)
    pose = robot.tool_pose
    pose[:2, 3] += 0.05 * np.array([-pose[1, 3], pose[0, 3]]) / np.hypot(*pose[:2, 3])
    fast = {'speed': 20.0, 'acceleration': 500.0}
    with pytest.raises(ValueError, match=r'too fast, .* the limit is'):
        robot.move_line(pose, **fast, slow=False)
    motion = robot.move_line(pose, **fast, accuracy=1e-3)
    assert motion.duration > 0.05
    assert np.allclose(robot.tool_pose, pose, atol=1e-4)


@pytest.mark.parametrize(
    ('speed', 'acceleration', 'mm'),
    one_in(
        4,
        [(2.0, 10.0, 0.155), (1.0, 5.0, 0.095), (0.3, 2.0, 0.022), (0.1, 1.0, 0.0035)],
        several=True,
    ),
)
@pytest.mark.parametrize(
    ('model', 'start'),
    [
        ('gx4_c251s', SCARA_READY),
        pytest.param('c3_a601s', READY, marks=pytest.mark.slow),
    ],
    ids=['GX4', 'C3'],
)
async def test_line_straightness_matches_the_docs(model, start, speed, acceleration, mm):
    """The figures of docs/python.md come from the servos' lag. The SCARA is the worst case."""
    async with robot_cell(model=model, smooth=True) as (robot, _):
        await robot.move_joints(start)
        first = robot.tool_pose[:3, 3]
        recording = robot.record()
        there = [0.0, 0.15, 0.0, 0.0, 0.0, 0.0, 1.0]
        motion = await robot.move_line(there, frame='tool', speed=speed, acceleration=acceleration)
        recording.stop()
        places = np.array([robot.forward(joints)[:3, 3] for joints in recording.positions])
        along = (places[-1] - first) / np.linalg.norm(places[-1] - first)
        aside = places - first - np.outer((places - first) @ along, along)
        away = float(np.linalg.norm(aside, axis=1).max())
        assert away < 1e-3 * mm
        assert model == 'c3_a601s' or away > 0.4e-3 * mm
        assert ('away from its path' in motion.text) == (away > ACCURACY)


@pytest.mark.slow
async def test_motion_reports_its_deviation_from_the_path():
    async with robot_cell(model='gx4_c251s', smooth=True) as (robot, _):
        await robot.move_joints(SCARA_READY, speed=1.0)
        start = robot.tool_pose
        inwards = -start[:2, 3] / np.hypot(*start[:2, 3])
        end, via = start.copy(), start[:3, 3].copy()
        end[:2, 3] += 0.04 * inwards
        via[:2] += 0.02 * (inwards + np.array([-inwards[1], inwards[0]]))
        fast = {'speed': 1.0, 'acceleration': 20.0}
        motion = await robot.move_arc(via, end, **fast)  # lagging servos cut the corner
        assert 'the tool was up to 0.' in motion.text
        assert 'mm away from its path (accuracy 0.1 mm)' in motion.text
        assert 'away' not in (await robot.move_arc(via, start, speed=0.05)).text


@pytest.mark.invariant(3)
async def test_cancelled_line_stops_on_the_line():
    async with robot_cell() as (robot, _):
        await robot.move_joints(READY)
        start = robot.pose
        end = start.copy()
        end[1, 3] += 0.1
        line = asyncio.create_task(robot.move_line(end, speed=0.03))
        while robot.pose[1, 3] < start[1, 3] + 0.02:  # planning may take long
            assert not line.done()
            await asyncio.sleep(0.02)
        line.cancel()
        with pytest.raises(asyncio.CancelledError):
            await line
        place = robot.pose[:3, 3]
        assert 0.0 < place[1] - start[1, 3] < 0.1
        assert distance_from(place, np.array([start[:3, 3], end[:3, 3]])) < ACCURACY


@pytest.mark.invariant(1, 2)
def test_scara_rejects_a_tilted_tool_and_reaches_an_upright_pose(scara):
    scara.move_joints(SCARA_READY)
    before, pose = scara.joints, scara.pose
    leaning = pose.copy()
    leaning[:3, :3] = pose[:3, :3] @ rotation_of_uvw(np.array([0.0, 0.1, 0.0]))
    with pytest.raises(ValueError, match='a SCARA tool stays upright'):
        scara.move_line(leaning)
    assert np.array_equal(before, scara.joints)
    point = scara.epson_point
    scara.move_line(EpsonPoint(point.x, point.y, point.z + 20.0, point.u + 30.0))
    assert scara.pose[2, 3] == pytest.approx(pose[2, 3] + 0.02, abs=1e-5)
    assert scara.epson_point.u == pytest.approx(point.u + 30.0, abs=1e-3)


@pytest.mark.parametrize('model', one_in(2, ['c3_a601s', 'gx4_c251s']))
async def test_joint_move_to_a_pose_ends_in_the_nearest_configuration(model):
    async with robot_cell(model=model, smooth=True) as (robot, _):
        count = len(robot.model.joint_names)
        joints = np.array([0.3, 0.4, -0.02, 0.2, 0.5, 0.1])[:count]
        pose = robot.forward(joints)
        assert robot.inverse(pose, near=joints) == pytest.approx(joints, abs=1e-9)
        await robot.move_joints(pose)
        assert robot.tool_pose == pytest.approx(pose, abs=1e-4)
        assert robot.joints == pytest.approx(robot.inverse(pose), abs=1e-3)
        away = robot.pose
        away[0, 3] += 1.5
        with pytest.raises(PathError, match=r'target: no joint positions for \('):
            await robot.move_joints(away)
        with pytest.raises(PathError, match='pose: no joint positions for'):
            robot.inverse(away)
        before = robot.joints
        await robot.move_joints(robot.epson_point)
        assert robot.joints == pytest.approx(before, abs=2e-3)
