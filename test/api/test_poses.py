# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Pose formats, frames, tools and waypoints: meaning and checks."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from epson_driver.api.moves import path_points, path_runs
from epson_driver.api.poses import (
    EpsonPoint,
    Frames,
    Tool,
    Waypoint,
    checked_pose,
    checked_tool,
)
from epson_driver.robots import load_robot_model
from epson_driver.robots.kinematics import rotation_of_uvw
from epson_driver.tool_motion.tool_pose import homogeneous, quaternion_pose

MODEL = load_robot_model('c3_a601s')
HERE = homogeneous(np.eye(3), np.array([0.4, 0.0, 0.5]))


def frames():
    return Frames(MODEL.base.matrix, float(MODEL.reach[0]))


def random_poses(count):
    random = np.random.default_rng(18)
    for turn in Rotation.random(count, random_state=18).as_matrix():
        yield homogeneous(turn, random.uniform(-0.5, 0.5, 3))


def test_quaternion_order_is_x_y_z_w():
    turns = ([1, -1, -1], [-1, 1, -1], [-1, -1, 1], [1, 1, 1])
    half_turns = (homogeneous(np.diag(turn), np.zeros(3)) for turn in turns)
    for pose in (*random_poses(50), *half_turns):
        result = quaternion_pose(pose)
        turn = Rotation.from_quat(result[3:]).as_matrix()
        np.testing.assert_allclose(turn, pose[:3, :3], atol=1e-12)
        np.testing.assert_allclose(checked_pose('pose', result), pose, atol=1e-12)


def test_epson_point_is_in_mm_and_degrees_of_the_epson_world():
    pose = frames().target('pose', EpsonPoint(-207.5, 359.401, 570.0, 0.0, -90.0, -60.0), None)
    x, y, z = pose.pose[:3, 3]
    assert (x, y, z) == pytest.approx((0.359401, 0.2075, 0.57))  # base_link: x forward, y left
    for item in random_poses(50):
        np.testing.assert_allclose(EpsonPoint.of(item).pose, item, atol=1e-12)


def test_named_frames_nest_and_work_with_the_tool_frame():
    known = frames()
    table = homogeneous(Rotation.from_euler('z', 90, degrees=True).as_matrix(), [0.5, 0.1, 0.0])
    known.set('table', table, None)
    known.set('tray', homogeneous(np.eye(3), np.array([0.1, 0.0, 0.02])), 'table')
    on_tray = [0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 1.0]
    target = known.target('pose', on_tray, 'tray')
    assert target.in_base_link(HERE)[:3, 3] == pytest.approx([0.5, 0.2, 0.12])
    assert known.pose_in(target.pose, 'tray')[:3, 3] == pytest.approx([0.0, 0.0, 0.1])
    in_tool = known.target('pose', on_tray, 'tool')
    assert in_tool.in_base_link(HERE)[:3, 3] == pytest.approx([0.4, 0.0, 0.6])
    assert set(known.poses) == {'base_link', 'base', 'table', 'tray'}
    # an EPSON point in a named frame, like in an EPSON Local
    assert known.target('pose', EpsonPoint(100, 0, 20), 'table').pose[:3, 3] == pytest.approx(
        [0.5, 0.2, 0.02]
    )


UNKNOWN = r"frame = 'tabel': must be base_link, base or tool"


@pytest.mark.invariant(1)
@pytest.mark.parametrize(
    ('request_', 'expected'),
    [
        (lambda: frames().target('pose', HERE, 'tabel'), UNKNOWN),
        (lambda: frames().target('pose', HERE, 7), 'frame = 7: must be base_link'),
        (lambda: frames().pose_in(HERE, 'tool'), "frame = 'tool': must be base_link or base"),
        (lambda: frames().set('a', HERE, 'tool'), "parent = 'tool': must be base_link or base"),
        (lambda: frames().set('base', HERE, None), "name = 'base': this frame is built in"),
        (lambda: frames().set('', HERE, None), "name = '': must be a string, not empty"),
        (lambda: checked_pose('pose', [1.0] * 6), r'has shape \(6,\): .*take an EpsonPoint'),
        (lambda: checked_pose('pose', [0.4, 0, 0.5, 0, 0, 0, 2]), 'has length 2: must be 1'),
        (lambda: checked_pose('pose', [0.4, 0, np.nan, 0, 0, 0, 1]), 'must be finite numbers'),
        (lambda: checked_pose('pose', 'here'), "pose = 'here': must be numbers"),
        (lambda: EpsonPoint(400.0, float('nan'), 0.0), 'y = nan: must be a number from'),
        (lambda: EpsonPoint(400.0, 0.0, 0.0, '90'), "u = '90': must be a number from"),
        (
            lambda: frames().target('pose', [400, 0, 500, 0, 0, 0, 1], None),
            r'pose: 640\.3 m away, but the arm reaches .* m: positions are in m \(in mm only',
        ),
        (lambda: checked_tool([0, 0, 120, 0, 0, 0, 1], None, None), 'tool is 120 m from the'),
        (lambda: checked_tool(np.eye(4), 0.0, None), r'max_speed = 0\.0: must be a number'),
        (
            lambda: Tool(np.eye(4), max_speed=0.2).check(0.25, 1.0),
            r'speed = 0\.25 m/s: the tool allows 0\.2 m/s',
        ),
        (
            lambda: Tool(np.eye(4), max_acceleration=0.5).check(0.1, 1.0),
            r'acceleration = 1 m/s²: the tool allows 0\.5 m/s²',
        ),
    ],
)
def test_invalid_pose_frame_or_tool_is_rejected_with_field_and_value(request_, expected):
    with pytest.raises(ValueError, match=expected) as caught:
        request_()
    assert '\n' not in str(caught.value)


def pose_at(x, y, z=0.5):
    return homogeneous(np.eye(3), np.array([x, y, z]))


def test_path_accepts_poses_and_waypoints_with_via_blend_and_frame():
    points = [
        pose_at(0.4, 0.1),
        Waypoint(pose_at(0.3, 0.1), via=[0.35, 0.15, 0.5], blend=0.0),
        Waypoint([0.0, -0.1, 0.0, 0, 0, 0, 1], frame='tool'),
    ]
    result = path_points(points, 0.01, None, frames())
    assert [point.blend for point in result] == [0.01, 0.0, 0.0]
    first, second = path_runs(result, HERE)
    assert [part.length for part in first.parts[:2]] == pytest.approx([0.09, 0.02])
    assert second.pose(second.seams[-1])[:3, 3] == pytest.approx([0.4, -0.1, 0.5])


@pytest.mark.invariant(1)
@pytest.mark.parametrize(
    ('points', 'blend', 'expected'),
    [
        ([], 0.0, 'points: must have at least one'),
        ('here', 0.0, "points = 'here': must be a list"),
        ([HERE[:3]], 0.0, r'points\[0\] has shape \(3, 4\)'),
        ([pose_at(0.4, 0.1)], -0.01, r'blend = -0\.01: must be a number from 0'),
        ([pose_at(0.4, 0.1)], float('nan'), 'blend = nan: must be a number from 0'),
        ([Waypoint(HERE, blend='1'), HERE], 0.0, r"points\[0\]\.blend = '1': must be a number"),
        ([Waypoint(HERE, blend=0.1)], 0.0, r'points\[0\]\.blend = 0\.1 m: must be 0 for the last'),
        ([Waypoint(HERE, frame='b')], 0.0, "frame = 'b': must be base_link"),
        ([Waypoint(HERE, via=[1, 2])], 0.0, r'points\[0\]\.via has shape \(2,\)'),
        (
            [pose_at(0.4, 0.1), pose_at(0.4, 0.2)],
            0.15,
            r'points\[0\]: the motion is 0\.1 m long, shorter than the blend of 0\.15 m',
        ),
        (
            [Waypoint(pose_at(0.4, 0.2), via=[0.4, 0.1, 0.5])],
            0.0,
            r'points\[0\]: no arc from',
        ),
    ],
)
def test_invalid_path_is_rejected_with_point_and_reason(points, blend, expected):
    with pytest.raises(ValueError, match=expected) as caught:
        path_runs(path_points(points, blend, None, frames()), HERE)
    assert '\n' not in str(caught.value)


def with_noise(pose, random):
    """Return the pose with encoder noise."""
    moved = pose.copy()
    moved[:3, 3] += random.uniform(-2e-5, 2e-5, 3)
    return moved


def test_nearly_equal_points_merge_to_one_with_the_smallest_blend():
    first, second = pose_at(0.4, 0.1), pose_at(0.5, 0.1)
    random = np.random.default_rng(31)
    for _ in range(20):
        here, again, twice = (with_noise(item, random) for item in (HERE, first, first))
        for given, runs, lengths in (
            ([here, again, second], 1, [0.08, 0.04, 0.08]),
            ([first, twice, again, second], 1, [0.08, 0.04, 0.08]),
            ([Waypoint(first, blend=0.0), twice, second], 2, [0.1]),
            ([first, Waypoint(twice, blend=0.0), second], 2, [0.1]),
            ([here, first, second, with_noise(second, random)], 1, [0.08, 0.04, 0.08]),
        ):
            result = path_runs(path_points(given, 0.02, None, frames()), HERE)
            assert len(result) == runs
            assert [part.length for part in result[0].parts] == pytest.approx(lengths, abs=1e-4)
            assert result[-1].last == len(given) - 1
            end = result[-1].pose(result[-1].seams[-1])
            np.testing.assert_allclose(end, given[-1], atol=1e-12)


def test_rounded_matrix_becomes_the_nearest_rotation():
    exact = homogeneous(rotation_of_uvw(np.array([0.3, -0.7, 2.0])), np.array([0.1, 0.2, 0.3]))
    result = checked_pose('pose', np.round(exact, 5))
    turn = result[:3, :3]
    assert np.abs(turn @ turn.T - np.eye(3)).max() < 1e-12
    assert np.abs(result - exact).max() < 2e-5
    with pytest.raises(ValueError, match='must be a rotation'):
        checked_pose('pose', np.round(exact, 3))
