# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Lines and arcs of the tool: path, joint limits, speed and refusals."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from support.examples import one_in

from epson_driver.motion.smoothed import smoothed
from epson_driver.robots import load_robot_model
from epson_driver.robots.kinematics import Kinematics, rotation_of_uvw
from epson_driver.tool_motion import path_timing
from epson_driver.tool_motion.joint_path import PathError
from epson_driver.tool_motion.pose_path import arc, distance_from, line, runs
from epson_driver.tool_motion.tool_pose import rotation
from epson_driver.tool_motion.tool_trajectory import ToolLimits, trajectory_along_runs

ARM = Kinematics(load_robot_model('c3_a601s'))
LIMITS = ARM.model.limits
READY = np.array([0.0, 0.2, 0.2, 0.0, -1.9, 0.0])


def moved(pose, xyz=(0.0, 0.0, 0.0), uvw=(0.0, 0.0, 0.0)):
    """Return a pose moved in base_link, m, and turned in its own frame, rad."""
    other = pose.copy()
    other[:3, 3] += xyz
    other[:3, :3] = pose[:3, :3] @ rotation_of_uvw(np.array(uvw))
    return other


def on_path(kinematics, start, path, tool):
    """Return the joint trajectory along one line or arc."""
    return trajectory_along_runs(kinematics, start, runs([path], []), tool)


def turned_by(first, second):
    """Return the angle between two orientations, rad."""
    cosine = (np.trace(first[:3, :3].T @ second[:3, :3]) - 1.0) / 2.0
    return float(np.arccos(np.clip(cosine, -1.0, 1.0)))


def test_line_is_uniform_in_position_and_orientation():
    start = ARM.forward(READY)
    end = moved(start, (0.05, -0.1, 0.02), (0.3, -0.2, 0.1))
    path = line(start, end)
    assert np.allclose(path.pose(0.0), start)
    assert np.allclose(path.pose(1.0), end)
    assert path.length == pytest.approx(np.linalg.norm([0.05, 0.1, 0.02]))
    for fraction in (0.25, 0.5, 0.9):
        pose = path.pose(fraction)
        assert np.allclose(pose[:3, 3], start[:3, 3] + fraction * np.array([0.05, -0.1, 0.02]))
        assert turned_by(start, pose) == pytest.approx(fraction * path.angle, abs=1e-7)
        assert turned_by(pose, end) == pytest.approx((1.0 - fraction) * path.angle, abs=1e-7)


@pytest.mark.parametrize('noise', [0.0, 1e-9, -1e-9])
def test_half_turn_is_about_the_positive_axis_despite_rounding(noise):
    for axis in np.array([[0.0, 0.0, 1.0], [0.6, 0.0, -0.8], [0.0, -1.0, 0.0]]):
        end = np.eye(4)
        end[:3, :3] = rotation((np.pi + noise) * axis)
        positive = axis * np.sign(axis[np.argmax(np.abs(axis))])
        half = line(np.eye(4), end).pose(0.5)[:3, :3]
        assert np.allclose(half, rotation(np.pi / 2 * positive), atol=1e-6)


def test_arc_passes_its_points_with_constant_radius():
    start = np.eye(4)
    start[:3, 3] = [1.0, 0.0, 0.0]
    end = np.eye(4)
    end[:3, 3] = [0.0, -1.0, 0.0]
    path = arc(start, np.array([0.0, 1.0, 0.0]), end)  # three quarters of a turn
    assert path.length == pytest.approx(1.5 * np.pi)
    assert np.allclose(path.pose(0.0)[:3, 3], start[:3, 3])
    assert np.allclose(path.pose(1 / 3)[:3, 3], [0.0, 1.0, 0.0])
    assert np.allclose(path.pose(1.0)[:3, 3], end[:3, 3])
    other = arc(start, np.array([np.sqrt(0.5), -np.sqrt(0.5), 0.0]), end)
    assert other.length == pytest.approx(0.5 * np.pi)


def random_path(random, start_joints):
    """Return a random line or arc from the pose of the joints."""
    start = ARM.forward(start_joints)
    end = moved(start, random.uniform(-0.12, 0.12, 3), random.uniform(-0.5, 0.5, 3))
    if random.random() < 0.5:
        return line(start, end)
    return arc(start, (start[:3, 3] + end[:3, 3]) / 2 + random.uniform(-0.05, 0.05, 3), end)


@pytest.mark.invariant(2)
@pytest.mark.parametrize('count', [12, pytest.param(200, marks=pytest.mark.soak)])
def test_random_paths_respect_limits_or_are_refused(count):
    random = np.random.default_rng(18)
    outcomes, reasons = [], []
    for number in range(count):
        spread = 0.3 if number % 2 else 2.0
        joints = READY + random.uniform(-spread, spread, 6)
        joints = np.clip(joints, LIMITS.position_min, LIMITS.position_max)
        path = random_path(random, joints)
        tool = ToolLimits(speed=random.uniform(0.02, 1.0), slow=number % 4 == 0)
        try:
            trajectory = on_path(ARM, joints, path, tool)
        except PathError as error:
            reasons.append(str(error))
            continue
        outcomes.append(trajectory)
        assert np.allclose(trajectory.positions[0], joints, atol=1e-6)
        assert np.all(trajectory.positions >= LIMITS.position_min)
        assert np.all(trajectory.positions <= LIMITS.position_max)
        assert np.all(np.abs(trajectory.velocities) <= LIMITS.velocity * (1 + 1e-6))
        steps = np.diff(trajectory.times)[:, None]
        change = np.diff(trajectory.velocities, axis=0) / steps
        assert np.all(np.abs(change) <= LIMITS.acceleration * 1.02)
        assert np.all(np.abs(np.diff(trajectory.positions, axis=0)) < 1.0)  # none jumps
        wrist = np.sign(trajectory.positions[:, 4])
        assert len(set(wrist[wrist != 0.0])) == 1  # the wrist does not flip
        assert np.allclose(ARM.forward(trajectory.positions[-1]), path.pose(1.0), atol=1e-5)
    assert len(outcomes) >= count / 5
    assert all('% of ' in reason or 'accuracy' in reason for reason in reasons)
    assert {'near', 'out'} <= {reason.partition(' ')[0] for reason in reasons}


@pytest.mark.invariant(2)
@pytest.mark.slow
def test_smooth_motion_through_the_points_stays_on_the_path():
    random = np.random.default_rng(5)
    worst = []
    while len(worst) < 5:
        path = random_path(random, READY)
        try:
            trajectory = on_path(ARM, READY, path, ToolLimits())
        except PathError:
            continue
        places = np.array([path.pose(fraction)[:3, 3] for fraction in np.linspace(0, 1, 2001)])
        motion = smoothed(trajectory, LIMITS)
        worst.append(max(distance_from(ARM.forward(q)[:3, 3], places) for q in motion.positions))
    assert max(worst) < 2e-4


def test_path_through_a_singularity_is_refused():
    for_folding_arm = np.array([0.0, 0.2, 0.2, 0.0, -0.15, 0.0])
    start = ARM.forward(for_folding_arm)
    away = moved(start, uvw=(0.02, 0.3, 0.0))  # near the wrist's singularity
    other = moved(start, uvw=(0.02, -0.3, 0.0))
    refused = []
    for end in (away, other):
        try:
            on_path(ARM, for_folding_arm, line(start, end), ToolLimits(turn_speed=3.0))
        except PathError as error:
            refused.append(str(error))
    assert refused
    assert 'near a singularity' in refused[0]
    assert 'joint_' in refused[0]
    assert '% of the way, at (' in refused[0]


@pytest.mark.invariant(2)
@pytest.mark.parametrize('beside', one_in(3, [0.05, 0.02, 0.1]))
def test_path_near_a_singularity_is_slow(beside):
    """Joint 4 turns by more than 0.5 rad while the tool turns by 0.01 rad."""
    for_folding_arm = np.array([0.0, 0.2, 0.2, 0.0, -0.15, 0.0])
    start = ARM.forward(for_folding_arm)
    path = line(start, moved(start, uvw=(beside, 0.3, 0.0)))
    trajectory = on_path(ARM, for_folding_arm, path, ToolLimits(slow=True))
    assert trajectory.duration > 2.0
    assert np.all(np.abs(trajectory.velocities) <= LIMITS.velocity * (1 + 1e-6))
    assert np.ptp(trajectory.positions[:, 3]) > 2.5
    for joints in trajectory.positions[::4]:
        turn = ARM.forward(joints)[:3, :3]
        angles = [np.trace(turn.T @ path.pose(item)[:3, :3]) for item in np.linspace(0, 1, 401)]
        assert max(angles) > 3.0 - 1e-5  # reached on the path


def test_tool_jerk_is_a_multiple_of_the_acceleration():
    start = ARM.forward(READY)
    path = line(start, moved(start, (0.0, 0.1, 0.0)))
    gentle, usual = (
        on_path(ARM, READY, path, ToolLimits(jerk_ratio=ratio)).duration for ratio in (1.0, 10.0)
    )
    v, a = 0.1, 1.0
    assert usual == pytest.approx(0.1 / v + v / a + a / (10.0 * a), rel=1e-3)
    assert gentle > usual + 0.3


def test_too_fast_path_is_refused_or_slowed():
    start = ARM.forward(READY)
    path = line(start, moved(start, (0.0, 0.15, 0.0)))
    fast = ToolLimits(speed=20.0, acceleration=500.0)
    with pytest.raises(
        PathError,
        match=r'joint_\d would need (a velocity|an acceleration|a jerk) of .* the limit is',
    ):
        on_path(ARM, READY, path, fast)
    slowed = on_path(
        ARM, READY, path, ToolLimits(speed=20.0, acceleration=500.0, accuracy=1e-3, slow=True)
    )
    assert np.all(np.abs(slowed.velocities) <= LIMITS.velocity)


PAST_THE_STRAIGHT_WRIST = np.array([-0.404, 0.106, 0.278, -1.554, -0.378, 1.407])
"""A start from which the wrist is nearly straight in the middle of 0.24 m along y."""


@pytest.mark.invariant(2)
def test_path_is_slow_only_where_a_joint_limit_requires_it(monkeypatch):
    joints = PAST_THE_STRAIGHT_WRIST
    start = ARM.forward(joints)
    path = line(start, moved(start, (0.0, 0.24, 0.0)))
    tool = ToolLimits(speed=0.3, acceleration=3.0, accuracy=1e-3)
    with pytest.raises(PathError, match='near a singularity, or too fast'):
        on_path(ARM, joints, path, tool)
    trajectory = on_path(ARM, joints, path, replace(tool, slow=True))
    motion = smoothed(trajectory, LIMITS)
    assert np.all(np.abs(motion.velocities) <= LIMITS.velocity * (1 + 1e-6))
    assert np.all(np.abs(motion.accelerations) <= LIMITS.acceleration * (1 + 1e-6))
    places = np.array([ARM.forward(position)[:3, 3] for position in motion.positions])
    speeds = np.linalg.norm(np.diff(places, axis=0), axis=1) / np.diff(motion.times)
    assert speeds.max() > 0.8 * tool.speed
    shares = np.linspace(0.0, 1.0, 501)
    poses = [path.pose(fraction)[:3, 3] for fraction in shares]
    assert max(distance_from(place, np.array(poses)) for place in places) < 2e-3
    monkeypatch.setattr(path_timing, 'LEVELS', ())  # the slowest speed everywhere
    as_a_whole = on_path(ARM, joints, path, replace(tool, slow=True))
    assert trajectory.duration < 0.7 * as_a_whole.duration
    print(f'{trajectory.duration:.2f} s; as a whole {as_a_whole.duration:.2f} s')


def test_accuracy_holds_between_the_points():
    start = ARM.forward(READY)
    path = line(start, moved(start, (0.0, 0.15, 0.0)))
    ends = np.array([path.pose(0.0)[:3, 3], path.pose(1.0)[:3, 3]])
    counts = []
    for accuracy in (1e-3, 2e-5):
        tool = ToolLimits(speed=0.3, acceleration=2.0, accuracy=accuracy)
        positions = on_path(ARM, READY, path, tool).positions
        for fraction in (0.25, 0.5, 0.75):
            between = positions[:-1] + fraction * np.diff(positions, axis=0)
            places = [ARM.forward(item)[:3, 3] for item in between]
            assert max(distance_from(place, ends) for place in places) < 1.01 * accuracy
        counts.append(len(positions))
    assert counts[0] < counts[1]


SCARA = Kinematics(load_robot_model('gx4_c251s'))
SCARA_READY = np.array([0.3, 1.2, -0.05, 0.0])


def corners(arm, joints, *steps):
    """Return lines from the pose of the joints, one per step, m, in base_link."""
    poses = [arm.forward(joints)]
    for step in steps:
        poses.append(moved(poses[-1], step))
    return [line(a, b) for a, b in itertools.pairwise(poses)]


def along(arm, trajectory):
    """Return positions of the tool at and between the points, shape (k, 3), and their interval."""
    motion = smoothed(trajectory, arm.model.limits)
    places = np.array([arm.forward(position)[:3, 3] for position in motion.positions])
    return places, float(motion.times[1] - motion.times[0])


@pytest.mark.invariant(2)
@pytest.mark.parametrize(
    ('arm', 'joints'), [(ARM, READY), (SCARA, SCARA_READY)], ids=['C3', 'GX4']
)
def test_blended_path_respects_tool_limits_at_corners(arm, joints):
    segments = corners(arm, joints, (0.0, 0.05, 0.0), (-0.05, 0.0, 0.02), (0.0, -0.03, -0.01))
    tool = ToolLimits(speed=0.2, acceleration=1.0)
    blended = trajectory_along_runs(arm, joints, runs(segments, [0.02, 0.014]), tool)
    resting = trajectory_along_runs(arm, joints, runs(segments, [0.0, 0.0]), tool)
    assert blended.duration < 0.95 * resting.duration
    assert np.allclose(arm.forward(blended.positions[-1]), segments[-1].pose(1.0), atol=1e-8)
    places, period = along(arm, blended)
    velocities = np.diff(places, axis=0) / period
    assert np.linalg.norm(velocities, axis=1).max() < tool.speed * 1.02
    wide = velocities[:: max(round(0.01 / period), 1)]
    accelerations = np.diff(wide, axis=0) / (max(round(0.01 / period), 1) * period)
    assert np.linalg.norm(accelerations, axis=1).max() < tool.acceleration * 1.1
    inner = np.linalg.norm(np.diff(places, axis=0), axis=1)[20:-20]
    assert inner.min() > 0.0  # at rest only at the ends
    for corner, radius in ((segments[0].pose(1.0), 0.02), (segments[1].pose(1.0), 0.014)):
        nearest = np.linalg.norm(places - corner[:3, 3], axis=1).min()
        assert 0.1 * radius < nearest < radius
    stops = np.flatnonzero(np.all(resting.velocities == 0.0, axis=1))
    assert len(stops) == 6  # start and end, and of both rests


@pytest.mark.invariant(2)
def test_scara_lines_respect_limits_and_elbow_or_are_refused():
    limits = SCARA.model.limits
    random = np.random.default_rng(18)
    driven, reasons = 0, []
    for _ in range(20):
        joints = random.uniform(limits.position_min, limits.position_max)
        start = SCARA.forward(joints)
        end = moved(start, random.uniform(-0.1, 0.1, 3), (random.uniform(-1.0, 1.0), 0.0, 0.0))
        try:
            trajectory = on_path(SCARA, joints, line(start, end), ToolLimits())
        except PathError as error:
            reasons.append(str(error))
            continue
        driven += 1
        assert np.all(trajectory.positions >= limits.position_min)
        assert np.all(trajectory.positions <= limits.position_max)
        assert np.all(np.abs(trajectory.velocities) <= limits.velocity)
        assert len(set(np.sign(np.sin(trajectory.positions[:, 1])))) == 1
        assert np.allclose(SCARA.forward(trajectory.positions[-1]), end, atol=1e-8)
    assert driven >= 4
    assert all('% of ' in reason for reason in reasons)


def test_tilted_tool_of_a_scara_is_refused():
    start = SCARA.forward(SCARA_READY)
    path = line(start, moved(start, (0.02, 0.0, 0.0), (0.0, 0.1, 0.0)))
    with pytest.raises(
        PathError, match=r'2 % of the way, .*: it is tilted by .* SCARA tool stays upright'
    ):
        on_path(SCARA, SCARA_READY, path, ToolLimits())


@pytest.mark.invariant(2)
@pytest.mark.parametrize('count', [8, pytest.param(200, marks=pytest.mark.soak)])
def test_extreme_requests_respect_limits_or_are_refused(count):
    random = np.random.default_rng(180)
    reasons = []
    for number in range(count):
        arm, limits = (ARM, LIMITS) if number % 2 else (SCARA, SCARA.model.limits)
        if number % 2:  # near the straight wrist, the stretched arm, or joint 1's axis
            joints = READY + random.uniform(-0.3, 0.3, 6)
            joint, value = ((4, 0.0), (2, np.pi / 2), (1, 1.1))[number % 3]
            joints[joint] = value + random.uniform(-0.05, 0.05)
            turn = random.uniform(-0.4, 0.4, 3)
        else:  # near the stretched or the folded arms
            joints = random.uniform(limits.position_min, limits.position_max)
            joints[1] = (0.0, 0.0, 2.4)[number % 3] + random.uniform(-0.05, 0.05)
            turn = np.array([random.uniform(-0.4, 0.4), 0.0, 0.0])
        joints = np.clip(joints, limits.position_min, limits.position_max)
        start = arm.forward(joints)
        path = line(start, moved(start, random.uniform(-0.06, 0.06, 3), turn))
        tool = ToolLimits(speed=0.1, slow=number % 4 < 2)
        try:
            trajectory = on_path(arm, joints, path, tool)
        except PathError as error:
            reasons.append(str(error))
            continue
        motion = smoothed(trajectory, limits)
        assert np.all(motion.positions >= limits.position_min - 1e-9)
        assert np.all(motion.positions <= limits.position_max + 1e-9)
        assert np.all(np.abs(motion.velocities) <= limits.velocity * (1 + 1e-6))
        assert np.all(np.abs(motion.accelerations) <= limits.acceleration * (1 + 1e-6))
        period = motion.times[1] - motion.times[0]
        assert np.all(np.abs(np.diff(motion.positions, axis=0)) <= limits.velocity * period * 1.01)
    assert all('% of ' in reason or 'accuracy' in reason for reason in reasons)
    assert count / 5 < len(reasons) < count
    print(f'{len(reasons)} of {count} refused, {count - len(reasons)} inside all limits')
