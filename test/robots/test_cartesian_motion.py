# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Lines and arcs of the tool: the path itself, joint limits all the way, and what is refused."""

import numpy as np
import pytest

from epson_driver.motion.cartesian import arc, distance_from, line
from epson_driver.motion.smoothed import smoothed
from epson_driver.robots import load_robot_model
from epson_driver.robots.cartesian_motion import ToolLimits, cartesian_trajectory
from epson_driver.robots.joint_path import PathError
from epson_driver.robots.kinematics import Kinematics, rotation_of_uvw

pytest.importorskip('py_opw_kinematics')

ARM = Kinematics(load_robot_model('c3_a601s'))
LIMITS = ARM.model.limits
READY = np.array([0.0, 0.2, 0.2, 0.0, -1.9, 0.0])


def moved(pose, xyz=(0.0, 0.0, 0.0), uvw=(0.0, 0.0, 0.0)):
    """Return a pose moved in base_link, m, and turned in its own frame, rad."""
    other = pose.copy()
    other[:3, 3] += xyz
    other[:3, :3] = pose[:3, :3] @ rotation_of_uvw(np.array(uvw))
    return other


def turned_by(first, second):
    """Return the angle between two orientations, rad."""
    cosine = (np.trace(first[:3, :3].T @ second[:3, :3]) - 1.0) / 2.0
    return float(np.arccos(np.clip(cosine, -1.0, 1.0)))


def test_a_line_runs_evenly_in_place_and_orientation():
    start = ARM.forward(READY)
    end = moved(start, (0.05, -0.1, 0.02), (0.3, -0.2, 0.1))
    path = line(start, end)
    assert np.allclose(path.pose(0.0), start)
    assert np.allclose(path.pose(1.0), end)
    assert path.length == pytest.approx(np.linalg.norm([0.05, 0.1, 0.02]))
    for share in (0.25, 0.5, 0.9):
        pose = path.pose(share)
        assert np.allclose(pose[:3, 3], start[:3, 3] + share * np.array([0.05, -0.1, 0.02]))
        assert turned_by(start, pose) == pytest.approx(share * path.angle, abs=1e-7)
        assert turned_by(pose, end) == pytest.approx((1.0 - share) * path.angle, abs=1e-7)


def test_an_arc_goes_through_its_points_at_one_distance_from_its_center():
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


@pytest.mark.parametrize('via', [[0.5, 0.0, 0.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
def test_points_in_one_line_make_no_arc(via):
    end = moved(np.eye(4), (1.0, 0.0, 0.0))
    with pytest.raises(ValueError, match='no arc leads from'):
        arc(np.eye(4), np.array(via), end)


def test_half_a_turn_could_go_either_way():
    with pytest.raises(ValueError, match='half a turn'):
        line(np.eye(4), np.diag([-1.0, -1.0, 1.0, 1.0]))


def random_path(random, start_joints):
    """Return a random line or arc from where the joints are."""
    start = ARM.forward(start_joints)
    end = moved(start, random.uniform(-0.12, 0.12, 3), random.uniform(-0.5, 0.5, 3))
    if random.random() < 0.5:
        return line(start, end)
    return arc(start, (start[:3, 3] + end[:3, 3]) / 2 + random.uniform(-0.05, 0.05, 3), end)


@pytest.mark.invariant(2)
@pytest.mark.parametrize('count', [12, pytest.param(200, marks=pytest.mark.slow)])
def test_random_paths_are_refused_with_the_reason_or_keep_every_limit(count):
    random = np.random.default_rng(18)
    outcomes, reasons = [], []
    for number in range(count):
        spread = 0.3 if number % 2 else 2.0
        joints = READY + random.uniform(-spread, spread, 6)
        joints = np.clip(joints, LIMITS.position_min, LIMITS.position_max)
        path = random_path(random, joints)
        tool = ToolLimits(speed=random.uniform(0.02, 1.0), slow=number % 4 == 0)
        try:
            trajectory = cartesian_trajectory(ARM, joints, path, tool)
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
        assert np.allclose(ARM.forward(trajectory.positions[-1]), path.pose(1.0), atol=1e-5)
    assert len(outcomes) >= count / 5
    assert all('% of the way' in reason or 'accuracy' in reason for reason in reasons)
    assert {'near', 'out'} <= {reason.partition(' ')[0] for reason in reasons}


@pytest.mark.invariant(2)
def test_the_smooth_motion_through_the_points_stays_on_the_path():
    random = np.random.default_rng(5)
    worst = []
    while len(worst) < 5:
        path = random_path(random, READY)
        try:
            trajectory = cartesian_trajectory(ARM, READY, path, ToolLimits())
        except PathError:
            continue
        places = np.array([path.pose(share)[:3, 3] for share in np.linspace(0, 1, 2001)])
        motion = smoothed(trajectory, LIMITS)
        worst.append(max(distance_from(ARM.forward(q)[:3, 3], places) for q in motion.positions))
    assert max(worst) < 2e-4


def test_through_the_straight_wrist_a_joint_would_have_to_jump_or_be_too_fast():
    bent = np.array([0.0, 0.2, 0.2, 0.0, -0.15, 0.0])
    start = ARM.forward(bent)
    away = moved(start, uvw=(0.02, 0.3, 0.0))  # past the wrist's singularity, not through it
    other = moved(start, uvw=(0.02, -0.3, 0.0))
    refused = []
    for end in (away, other):
        try:
            cartesian_trajectory(ARM, bent, line(start, end), ToolLimits(turn_speed=3.0))
        except PathError as error:
            refused.append(str(error))
    assert refused
    assert 'near a singularity' in refused[0]
    assert 'joint_' in refused[0]
    assert '% of the way, at (' in refused[0]


def test_out_of_reach_says_where():
    start = ARM.forward(READY)
    with pytest.raises(PathError, match=r'out of reach \d+ % of the way, at \('):
        cartesian_trajectory(ARM, READY, line(start, moved(start, (1.0, 0, 0))), ToolLimits())


def test_too_fast_is_refused_with_joint_and_limit_or_slowed_if_asked():
    start = ARM.forward(READY)
    path = line(start, moved(start, (0.0, 0.15, 0.0)))
    fast = ToolLimits(speed=20.0, acceleration=500.0)
    with pytest.raises(PathError, match=r'joint_\d would need a \w+ of .* the limit is'):
        cartesian_trajectory(ARM, READY, path, fast)
    slowed = cartesian_trajectory(
        ARM, READY, path, ToolLimits(speed=20.0, acceleration=500.0, accuracy=1e-3, slow=True)
    )
    assert np.all(np.abs(slowed.velocities) <= LIMITS.velocity)


def test_no_way_and_no_turn_is_no_motion():
    start = ARM.forward(READY)
    with pytest.raises(PathError, match='there already'):
        cartesian_trajectory(ARM, READY, line(start, start), ToolLimits())
