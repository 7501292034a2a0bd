# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Sequences of motions as one trajectory: rests, times, limits, and what is refused as a whole."""

import numpy as np
import pytest

from epson_driver.motion.trajectory import problems
from epson_driver.robots import load_robot_model
from epson_driver.robots.kinematics import Kinematics
from epson_driver.robots.motion_sequence import Kind, Primitive, SequenceError, plan_sequence

ARM = Kinematics(load_robot_model('c3_a601s'))
LIMITS = ARM.model.limits
READY = np.array([0.0, 0.2, 0.2, 0.0, -1.9, 0.0])
ASIDE = READY + np.array([0.3, 0.1, 0.0, 0.0, 0.0, 0.5])


def to_joints(target=ASIDE, **more):
    return Primitive(Kind.LINEAR_JOINT, np.asarray(target), **more)


def to_pose(xyz=(0.0, 0.05, 0.0), via=None, begin=READY, **more):
    """Return a line from where joints have the flange, or an arc through a place beside that."""
    pose = ARM.forward(begin)
    place = None if via is None else pose[:3, 3] + via
    pose[:3, 3] += xyz
    kind = Kind.LINEAR_CARTESIAN if via is None else Kind.CIRCULAR_CARTESIAN
    return Primitive(kind, pose, place, **more)


def to_arc(**more):
    return to_pose(via=(0.03, 0.03, 0.0), **more)


@pytest.fixture
def opw():
    pytest.importorskip('py_opw_kinematics')


@pytest.mark.usefixtures('opw')
def test_the_arm_rests_at_the_end_of_each_motion_and_goes_on_from_there():
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


def test_the_index_is_that_of_the_motion_under_way():
    planned = plan_sequence(ARM, READY, [to_joints(), to_joints(READY), to_joints()])
    first, second, _ = planned.ends / planned.ends[-1]
    expected = {0.0: 0, 0.9 * first: 0, 1.1 * first: 1, 1.01 * second: 2, 0.99: 2, 1.0: 2}
    assert {share: planned.index(share) for share in expected} == expected


@pytest.mark.parametrize(
    ('arguments', 'velocity'),
    [({}, None), ({'velocity': 0.2}, 0.2), ({'velocity': 0.2, 'acceleration': 1.0}, 0.2)],
)
def test_velocity_and_acceleration_of_joints_are_at_most_those_asked_for(arguments, velocity):
    trajectory = plan_sequence(ARM, READY, [to_joints(**arguments)]).trajectory
    fastest = np.abs(trajectory.velocities).max()
    assert fastest == pytest.approx(velocity) if velocity else fastest > 0.5
    steps = np.diff(trajectory.velocities, axis=0) / np.diff(trajectory.times)[:, None]
    allowed = arguments.get('acceleration', LIMITS.acceleration)
    assert (np.abs(steps) <= allowed * (1.0 + 1e-9)).all()


def test_more_than_a_joint_can_is_as_much_as_it_can():
    fast = plan_sequence(ARM, READY, [to_joints(velocity=100.0, acceleration=1e4)])
    assert fast.ends == pytest.approx(plan_sequence(ARM, READY, [to_joints()]).ends)


@pytest.mark.usefixtures('opw')
def test_a_line_is_as_fast_as_asked_for():
    line = to_pose((0.0, 0.1, 0.0), velocity=0.05, acceleration=0.5)
    trajectory = plan_sequence(ARM, READY, [line]).trajectory
    places = np.array([ARM.forward(row)[:3, 3] for row in trajectory.positions])
    speeds = np.linalg.norm(np.diff(places, axis=0), axis=1) / np.diff(trajectory.times)
    assert speeds.max() == pytest.approx(0.05, rel=1e-3)


@pytest.mark.usefixtures('opw')
@pytest.mark.parametrize(
    ('make', 'seconds'),
    [(to_joints, 0.4), (to_joints, 3.0), (to_pose, 0.4), (to_pose, 3.0), (to_arc, 1.0)],
)
def test_a_move_time_is_kept_whatever_velocity_says(make, seconds):
    planned = plan_sequence(ARM, READY, [make(move_time=seconds, velocity=1e-3)])
    assert planned.ends == pytest.approx([seconds])
    assert list(problems(planned.trajectory, LIMITS)) == []


REFUSED = {
    'blending': (to_joints(blend_radius=0.01), 'blend_radius = 0.01 m: must be 0'),
    'too short': (
        to_joints(move_time=0.01),
        r'move_time = 0.01 s: the joint limits allow no less',
    ),
    'tool, too short': (to_pose(move_time=0.02), r'LINEAR_CARTESIAN: '),
    'out of reach': (to_pose((2.0, 0.0, 0.0)), 'out of reach'),
    'there already': (to_pose((0.0, 0.0, 0.0)), 'the tool is there already'),
    'no arc': (to_pose((0.0, 0.1, 0.0), via=(0.0, 0.05, 0.0)), 'no arc leads'),
    'outside': (to_joints(READY + np.eye(6)[0] * 9.0), 'joint_1: target 9 is outside'),
}


@pytest.mark.usefixtures('opw')
@pytest.mark.parametrize('name', REFUSED)
def test_one_motion_that_cannot_be_refuses_the_whole_sequence_and_is_named(name):
    bad, words = REFUSED[name]
    with pytest.raises(SequenceError, match=r'^motions\[1\], ' + bad.kind.name) as caught:
        plan_sequence(ARM, READY, [to_joints(READY), bad, to_joints()])
    with pytest.raises(AssertionError, match=words):
        raise AssertionError(str(caught.value))


@pytest.mark.usefixtures('opw')
def test_a_scara_has_lines_as_well_as_motions_in_joint_space():
    scara = Kinematics(load_robot_model('gx4_c251s'))
    ready = np.array([0.3, 1.2, -0.05, 0.0])
    pose = scara.forward(ready)
    pose[:3, 3] += (-0.03, 0.02, 0.01)
    sequence = plan_sequence(
        scara, np.zeros(4), [to_joints(ready), Primitive(Kind.LINEAR_CARTESIAN, pose)]
    )
    assert len(sequence.ends) == 2
    assert np.allclose(scara.forward(sequence.trajectory.positions[-1]), pose, atol=1e-8)
    assert not list(problems(sequence.trajectory, scara.model.limits))


def test_it_is_given_up_between_two_motions():
    asked = iter([False, True])
    with pytest.raises(SequenceError, match='given up'):
        plan_sequence(ARM, READY, [to_joints(), to_joints(READY)], given_up=lambda: next(asked))


def test_a_single_motion_may_be_its_end_alone():
    trajectory = plan_sequence(ARM, READY, [to_joints()], sampled=False).trajectory
    assert trajectory.positions.shape == (1, 6)
    sampled = plan_sequence(ARM, READY, [to_joints()]).trajectory
    assert trajectory.duration == pytest.approx(sampled.duration)
