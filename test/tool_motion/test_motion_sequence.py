# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Sequences of motions as one trajectory: rests, times, limits, blends and refusals."""

from dataclasses import replace
from itertools import count, pairwise

import numpy as np
import pytest

from epson_driver.api.moves import PathPoint, path_runs
from epson_driver.api.poses import Target
from epson_driver.motion.smoothed import smoothed
from epson_driver.motion.trajectory import problems
from epson_driver.robots import load_robot_model
from epson_driver.robots.kinematics import Kinematics, rotation_of_uvw
from epson_driver.tool_motion import path_timing
from epson_driver.tool_motion.motion_sequence import Kind, Primitive, SequenceError, plan_sequence
from epson_driver.tool_motion.tool_trajectory import ToolLimits, trajectory_along_runs

ARM = Kinematics(load_robot_model('c3_a601s'))
LIMITS = ARM.model.limits
READY = np.array([0.0, 0.2, 0.2, 0.0, -1.9, 0.0])
ASIDE = READY + np.array([0.3, 0.1, 0.0, 0.0, 0.0, 0.5])


def to_joints(target=ASIDE, **more):
    return Primitive(Kind.LINEAR_JOINT, np.asarray(target), **more)


def to_pose(xyz=(0.0, 0.05, 0.0), via=None, begin=READY, **more):
    """Return a line, or with `via` an arc, from the flange pose of joints. `via` is relative."""
    pose = ARM.forward(begin)
    place = None if via is None else pose[:3, 3] + via
    pose[:3, 3] += xyz
    kind = Kind.LINEAR_CARTESIAN if via is None else Kind.CIRCULAR_CARTESIAN
    return Primitive(kind, pose, place, **more)


def to_arc(**more):
    return to_pose(via=(0.03, 0.03, 0.0), **more)


def test_arm_rests_at_the_end_of_each_motion():
    arc = to_pose((0.0, 0.0, 0.0), via=(0.03, -0.05, 0.0))
    line = to_pose((0.0, 0.06, 0.02))
    arc.target[:3, 3] -= [0.0, 0.1, 0.0]
    back = to_joints(READY)
    planned = plan_sequence(ARM, READY, [line, back, arc, to_joints()])
    trajectory = planned.trajectory
    assert list(problems(trajectory, LIMITS)) == []
    assert np.allclose(trajectory.positions[0], READY)
    assert trajectory.times[0] == 0.0
    assert planned.ends[-1] == pytest.approx(trajectory.duration)
    rows = np.searchsorted(trajectory.times, planned.ends - 1e-9)
    assert np.allclose(trajectory.times[rows], planned.ends)
    assert np.allclose(trajectory.velocities[rows], 0.0)
    assert np.allclose(ARM.forward(trajectory.positions[rows[0]]), line.target, atol=1e-9)
    assert np.allclose(trajectory.positions[rows[1]], READY)
    assert np.allclose(ARM.forward(trajectory.positions[rows[2]]), arc.target, atol=1e-9)
    assert np.allclose(trajectory.positions[-1], ASIDE)


@pytest.mark.parametrize(
    ('arguments', 'velocity'),
    [({}, None), ({'velocity': 0.2}, 0.2), ({'velocity': 0.2, 'acceleration': 1.0}, 0.2)],
)
def test_joint_velocity_and_acceleration_respect_the_request(arguments, velocity):
    trajectory = plan_sequence(ARM, READY, [to_joints(**arguments)]).trajectory
    fastest = np.abs(trajectory.velocities).max()
    assert fastest == pytest.approx(velocity) if velocity else fastest > 0.5
    steps = np.diff(trajectory.velocities, axis=0) / np.diff(trajectory.times)[:, None]
    allowed = arguments.get('acceleration', LIMITS.acceleration)
    assert (np.abs(steps) <= allowed * (1.0 + 1e-9)).all()


def test_line_has_the_requested_velocity():
    line = to_pose((0.0, 0.1, 0.0), velocity=0.05, acceleration=0.5)
    trajectory = plan_sequence(ARM, READY, [line]).trajectory
    places = np.array([ARM.forward(row)[:3, 3] for row in trajectory.positions])
    speeds = np.linalg.norm(np.diff(places, axis=0), axis=1) / np.diff(trajectory.times)
    assert speeds.max() == pytest.approx(0.05, rel=1e-3)


@pytest.mark.parametrize(
    ('make', 'seconds'),
    [(to_joints, 0.4), (to_joints, 3.0), (to_pose, 0.4), (to_pose, 3.0), (to_arc, 1.0)],
)
def test_move_time_overrides_velocity(make, seconds):
    planned = plan_sequence(ARM, READY, [make(move_time=seconds, velocity=1e-3)])
    assert planned.ends == pytest.approx([seconds])
    assert list(problems(planned.trajectory, LIMITS)) == []


REFUSED = {
    'joints, then the tool': (
        to_pose(blend_radius=0.01),
        r'blend_radius = 0.01 m: must be 0, because motions\[2\] is LINEAR_JOINT',
    ),
    'a move time': (
        to_joints(blend_radius=0.01, move_time=1.0),
        'move_time = 1 s: must be 0 for a blended motion',
    ),
    'only the wrist turns': (
        to_joints(READY + np.eye(6)[5], blend_radius=0.01),
        r'a blend of 0.01 m is longer than the largest distance of the tool from the corner, .* m',
    ),
    'joints there already': (
        to_joints(READY, blend_radius=0.01),
        'the joints are already at the target',
    ),
    'longer than the path': (
        to_joints(READY + 0.1 * np.eye(6)[0], blend_radius=0.2),
        'a blend of 0.2 m is longer than the largest distance of the tool from the corner, 0.0',
    ),
    'too short': (
        to_joints(move_time=0.01),
        r'move_time = 0.01 s: the joint limits allow no less',
    ),
    'tool, too short': (to_pose(move_time=0.02), r'LINEAR_CARTESIAN: '),
    'out of reach': (to_pose((2.0, 0.0, 0.0)), 'out of reach'),
    'there already': (to_pose((0.0, 0.0, 0.0)), 'the tool is already at the target'),
    'no arc': (to_pose((0.0, 0.1, 0.0), via=(0.0, 0.05, 0.0)), 'no arc from'),
    'outside': (to_joints(READY + np.eye(6)[0] * 9.0), 'joint_1: target 9 is outside'),
}


@pytest.mark.parametrize('name', REFUSED)
def test_infeasible_motion_refuses_the_whole_sequence(name):
    bad, words = REFUSED[name]
    with pytest.raises(SequenceError, match=r'^motions\[1\], ' + bad.kind.name) as caught:
        plan_sequence(ARM, READY, [to_joints(READY), bad, to_joints()])
    with pytest.raises(AssertionError, match=words):
        raise AssertionError(str(caught.value))


def test_scara_moves_straight_without_tilting():
    scara = Kinematics(load_robot_model('gx4_c251s'))
    start = np.zeros(4)
    target = np.array([0.2, 0.3, -0.05, 0.1])
    assert len(plan_sequence(scara, start, [to_joints(target)]).ends) == 1
    pose = scara.forward(target)
    pose[0, 3] -= 0.02
    (end,) = plan_sequence(scara, target, [Primitive(Kind.LINEAR_CARTESIAN, pose)]).ends
    assert end > 0.0
    pose[:3, :3] = pose[:3, :3] @ rotation_of_uvw(np.array([0.0, 0.2, 0.0]))
    with pytest.raises(SequenceError, match='stays upright'):
        plan_sequence(scara, target, [Primitive(Kind.LINEAR_CARTESIAN, pose)])


KINDS = {
    'line': lambda **more: [to_pose(**more)],
    'arc': lambda **more: [to_arc(**more)],
    'blended joints': lambda **more: [to_joints(blend_radius=0.02, **more), to_joints(READY)],
}


@pytest.mark.invariant(9)
@pytest.mark.parametrize('kind', KINDS)
def test_inv9_planning_can_be_cancelled_at_every_sample(kind):
    """docs/invariants.md, 9."""
    calls = []
    points = plan_sequence(
        ARM, READY, KINDS[kind](), checkpoint=lambda: calls.append(0)
    ).trajectory
    assert len(calls) >= 2 * len(points.times)
    for last in (0, 20, len(calls) - 1):
        counted = count(1)

        def checkpoint(last=last, counted=counted):
            if next(counted) > last:
                raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            plan_sequence(ARM, READY, KINDS[kind](), checkpoint=checkpoint)


@pytest.mark.invariant(7)
@pytest.mark.parametrize('motions', [*KINDS.values(), lambda **more: [to_joints(**more)]])
def test_inv7_motion_of_days_is_refused_before_sampling(motions):
    """docs/invariants.md, 7."""
    with pytest.raises(SequenceError, match=r'motions\[0\].* s: must be at most 5000 s'):
        plan_sequence(ARM, READY, motions(velocity=1e-5))


@pytest.mark.invariant(7)
def test_inv7_sequence_has_a_limited_number_of_points(monkeypatch):
    """docs/invariants.md, 7."""
    monkeypatch.setattr(path_timing, 'MAX_POINTS', 10)
    with pytest.raises(SequenceError, match='points: must be at most 10'):
        plan_sequence(ARM, READY, [to_joints(), to_joints(READY), to_joints()])


STEPS = [(0.0, 0.06, 0.0), (-0.05, 0.06, 0.02), (-0.05, 0.0, 0.02)]
RADII = [0.02, 0.01, 0.0]


def path(**more):
    """Return blended lines, and the same path as waypoints of the API."""
    lines = [
        to_pose(step, blend_radius=radius, **more)
        for step, radius in zip(STEPS, RADII, strict=True)
    ]
    points = [PathPoint(Target(line.target), None, line.blend_radius) for line in lines]
    return lines, points


def test_blended_lines_equal_waypoints_with_blends():
    lines, points = path(velocity=0.2)
    planned = plan_sequence(ARM, READY, lines)
    runs = path_runs(points, ARM.forward(READY))
    expected = trajectory_along_runs(ARM, READY, runs, ToolLimits(speed=0.2))
    assert np.array_equal(planned.trajectory.times, expected.times)
    assert np.array_equal(planned.trajectory.positions, expected.positions)
    assert np.array_equal(planned.trajectory.velocities, expected.velocities)
    resting = plan_sequence(ARM, READY, [replace(line, blend_radius=0.0) for line in lines])
    assert planned.trajectory.duration < 0.8 * resting.trajectory.duration


def test_blended_line_has_its_velocity_and_ends_at_its_corner():
    lines, _ = path()
    speeds = [0.05, 0.1, 0.08]
    lines = [replace(item, velocity=speed) for item, speed in zip(lines, speeds, strict=True)]
    planned = plan_sequence(ARM, READY, lines)
    motion = smoothed(planned.trajectory, LIMITS)
    places = np.array([ARM.forward(row)[:3, 3] for row in motion.positions])
    measured = np.linalg.norm(np.diff(places, axis=0), axis=1) / np.diff(motion.times)
    for index, (start, end) in enumerate(pairwise([0.0, *planned.ends])):
        during = (motion.times[1:] > start + 0.02) & (motion.times[1:] < end - 0.02)
        assert measured[during].max() == pytest.approx(speeds[index], rel=0.05)
        fraction = (start + end) / 2.0 / planned.trajectory.duration
        assert planned.index(fraction) == index
    for end, line, radius in zip(planned.ends[:-1], lines, RADII, strict=False):
        place = places[np.searchsorted(motion.times, end)]
        corner = line.target[:3, 3]
        nearest = np.linalg.norm(places - corner, axis=1).min()
        assert np.linalg.norm(place - corner) < nearest + 0.1 * radius


CORNER = READY + np.array([0.5, 0.2, -0.2, 0.1, 0.2, 0.5])
BEHIND = CORNER + np.array([-0.1, 0.3, 0.2, 0.4, 0.0, -0.8])


@pytest.mark.invariant(2)
@pytest.mark.parametrize(
    'radius', [0.02, *(pytest.param(item, marks=pytest.mark.slow) for item in (0.002, 0.1))]
)
@pytest.mark.parametrize('arguments', [{}, {'velocity': 0.5, 'acceleration': 2.0}])
def test_blended_joint_moves_respect_radius_and_limits(radius, arguments):
    moves = [to_joints(CORNER, blend_radius=radius, **arguments), to_joints(BEHIND, **arguments)]
    planned = plan_sequence(ARM, READY, moves)
    trajectory = planned.trajectory
    assert list(problems(trajectory, LIMITS)) == []
    assert np.allclose(trajectory.positions[0], READY)
    assert np.allclose(trajectory.positions[-1], BEHIND)
    assert planned.ends[-1] == pytest.approx(trajectory.duration)
    motion = smoothed(trajectory, LIMITS)
    slack = 1.0 + 1e-6
    assert np.all(np.abs(motion.velocities) <= LIMITS.velocity * slack)
    assert np.all(np.abs(motion.accelerations) <= LIMITS.acceleration * slack)
    if arguments:
        assert np.abs(motion.velocities).max() <= 0.5 * 1.01
    corner = ARM.forward(CORNER)[:3, 3]
    away = [np.linalg.norm(ARM.forward(position)[:3, 3] - corner) for position in motion.positions]
    assert 0.0 < min(away) < radius
    for index, (at, place) in enumerate(zip(motion.positions, away, strict=True)):
        if place > radius * 1.05:  # straight in joint space there
            start, end = (
                (READY, CORNER)
                if motion.times[index] < planned.ends[0]
                else (
                    CORNER,
                    BEHIND,
                )
            )
            fraction = (at - start) @ (end - start) / ((end - start) @ (end - start))
            assert np.abs(at - start - fraction * (end - start)).max() < 0.1 * radius
    resting = plan_sequence(ARM, READY, [replace(moves[0], blend_radius=0.0), moves[1]])
    if radius > 0.01:  # a tighter blend at full speed is not faster than a rest
        assert trajectory.duration < resting.trajectory.duration
    assert planned.index(0.0) == 0
    assert planned.index(1.0) == 1


@pytest.mark.invariant(2)
@pytest.mark.parametrize('count', [2, pytest.param(100, marks=pytest.mark.soak)])
def test_random_joint_blends_respect_limits_or_are_refused(count):
    random = np.random.default_rng(18)
    driven, reasons = 0, []
    for _ in range(count):
        corners = READY + random.uniform(-0.6, 0.6, (4, 6))
        radii = random.uniform(0.001, 0.15, 2)
        start, *targets = np.clip(corners, LIMITS.position_min, LIMITS.position_max)
        moves = [
            to_joints(target, blend_radius=radius)
            for target, radius in zip(targets, [*radii, 0.0], strict=True)
        ]
        try:
            planned = plan_sequence(ARM, start, moves)
        except SequenceError as error:
            reasons.append(str(error))
            continue
        driven += 1
        assert list(problems(planned.trajectory, LIMITS)) == []
        assert np.all(np.diff(planned.ends) > 0.0)
        motion = smoothed(planned.trajectory, LIMITS)
        assert np.all(np.abs(motion.velocities) <= LIMITS.velocity * (1.0 + 1e-6))
        assert np.all(np.abs(motion.accelerations) <= LIMITS.acceleration * (1.0 + 1e-6))
        for target, radius in zip(targets[:-1], radii, strict=True):
            corner = ARM.forward(target)[:3, 3]
            places = (ARM.forward(position)[:3, 3] for position in motion.positions)
            assert min(np.linalg.norm(place - corner) for place in places) < radius
    assert count < 10 or driven >= count / 2
    assert all(
        'longer than the largest distance' in reason or 'overlap' in reason for reason in reasons
    )


def test_blend_of_the_last_motion_is_refused():
    with pytest.raises(SequenceError, match=r'^motions\[1\], .*blend_radius = 0.1 m: must be 0'):
        plan_sequence(ARM, READY, [to_joints(), to_joints(READY, blend_radius=0.1)])


def test_overlapping_blends_are_refused():
    moves = [
        to_joints(CORNER, blend_radius=0.05),
        to_joints(CORNER + 0.1 * np.eye(6)[0], blend_radius=0.03),
        to_joints(BEHIND),
    ]
    with pytest.raises(SequenceError, match=r'^motions\[1\], LINEAR_JOINT: .*(overlap|longer)'):
        plan_sequence(ARM, READY, moves)
