# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The robot state: mapping, plausibility and age of joints."""

import math
import re
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from epson_driver.driver.state.joint_mapping import joint_mapping, unmapped
from epson_driver.driver.state.joint_velocity import VELOCITY_WINDOW_S
from epson_driver.driver.state.plausibility import MIN_JUMP, JointBounds, Margins
from epson_driver.driver.state.robot_state import RobotState
from epson_driver.robots import load_robot_model
from epson_driver.simple_message import Status, TriState, joint_data

DT = 0.005
ZEROS = (0.0,) * 10


def feed(state, position_at, seconds, begin=50.0, dt=DT):
    """Feed one-joint positions; return the samples, which start with the second position."""
    samples = []
    for count in range(round(seconds / dt) + 1):
        time = begin + count * dt
        samples.append(state.on_joints(joint_data([position_at(time - begin)]), time))
    return [sample for sample in samples if sample is not None]


@pytest.mark.invariant(8)
@given(st.tuples(*[st.floats(width=32, allow_nan=False, allow_infinity=False)] * 10))
def test_inv8_positions_are_bit_exact(values):
    state = RobotState(6)
    assert state.on_joints(ZEROS, 0.995) is None
    sample = state.on_joints(values, 1.0)
    assert sample.positions.dtype == np.float64
    assert sample.positions.tobytes() == struct.pack('6d', *values[:6])
    assert sample.time == 1.0


def test_velocity_of_a_constant_motion_is_exact():
    samples = feed(RobotState(1), lambda t: 0.3 - 1.7 * t, 1.0)
    for sample in samples[9:]:
        assert sample.velocities == pytest.approx([-1.7], rel=1e-9)


def test_velocity_lags_by_half_the_window():
    acceleration = 20.0
    samples = feed(RobotState(1), lambda t: 0.5 * acceleration * t * t, 0.5)
    for sample in samples[20:]:
        true = acceleration * (sample.time - 50.0)
        lag = true - sample.velocities[0]
        assert 0.0 < lag < acceleration * (VELOCITY_WINDOW_S / 2 + DT)


def test_velocity_of_an_arm_at_rest_is_exactly_zero():
    state = RobotState(1)
    for sample in feed(state, lambda t: 0.1 + 0.2, 1.0):
        assert sample.velocities[0] == 0.0


def test_velocity_is_zero_soon_after_the_arm_stopped():
    state = RobotState(1)
    for sample in feed(state, lambda t: min(t, 0.5), 1.0):
        if sample.time > 50.0 + 0.5 + VELOCITY_WINDOW_S + DT:
            assert sample.velocities[0] == 0.0


def test_velocity_is_accurate_at_a_slow_rate_and_after_a_gap():
    samples = feed(RobotState(1), lambda t: 0.25 * t, 10.0, dt=1.0)
    assert [sample.velocities[0] for sample in samples] == pytest.approx([0.25] * 10)
    state = RobotState(1)
    feed(state, lambda t: 0.5 * t, 0.1)
    after_gap = state.on_joints(joint_data([0.05 + 0.5 * 0.9]), 51.0)
    assert after_gap.velocities == pytest.approx([0.5], rel=1e-6)


def test_measured_velocities_are_unchanged():
    velocities = (0.125, -1.5, 1e-9, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0)
    sample = RobotState(4).on_joints(ZEROS, 1.0, velocities)
    assert sample.velocities.tolist() == [0.125, -1.5, 1e-9, 4.0]


@pytest.mark.parametrize('bad', [float('nan'), float('inf'), float('-inf')])
@pytest.mark.parametrize('joint', [0, 3])
def test_non_finite_position_is_refused(joint, bad):
    state = RobotState(4)
    state.on_joints(ZEROS, 0.995)
    good = state.on_joints(ZEROS, 1.0)
    values = list(ZEROS)
    values[joint] = bad
    with pytest.raises(ValueError, match=rf'joint {joint + 1}: position .* is not finite'):
        state.on_joints(tuple(values), 1.005)
    assert state.sample is good
    assert state.on_joints(ZEROS, 1.01).velocities.tolist() == [0.0] * 4


@pytest.mark.parametrize('bad', [float('nan'), float('inf')])
def test_non_finite_velocity_is_refused(bad):
    """NaN is not above any tolerance, so the arm would seem to be at rest."""
    state = RobotState(4)
    with pytest.raises(ValueError, match=r'joint 2: velocity .* is not finite'):
        state.on_joints(ZEROS, 1.0, (0.0, bad) + (0.0,) * 8)
    assert state.sample is None


def test_non_finite_value_of_an_unused_joint_is_ignored():
    values = (0.0, 0.0, float('nan')) + (0.0,) * 7
    assert RobotState(2).on_joints(values, 1.0, values).positions.tolist() == [0.0, 0.0]


@pytest.mark.invariant(6)
def test_moving_joint_that_the_model_lacks_is_reported_once():
    state = RobotState(6)
    data = [*[0.0] * 6, 0.2, *[0.0] * 3]
    assert state.moved_beyond_model(tuple(data)) is None
    data[6] += 0.0005  # noise
    assert state.moved_beyond_model(tuple(data)) is None
    data[6] += 0.001
    assert state.moved_beyond_model(tuple(data)) == 7
    data[6] += 0.001
    assert state.moved_beyond_model(tuple(data)) is None
    state.clear()
    assert state.moved_beyond_model(tuple(data)) is None


def test_inv6_clear_removes_all_state():
    state = RobotState(1)
    feed(state, lambda t: 3.0 * t, 1.0)
    state.on_status(Status(in_motion=TriState.TRUE), 51.0)
    assert state.in_motion == TriState.TRUE
    assert state.status_time == 51.0
    state.clear()
    assert state.sample is None
    assert state.status is None
    assert state.in_motion == TriState.UNKNOWN
    # no velocity is derived across the time without a link
    assert state.on_joints(joint_data([0.0]), 51.1) is None
    assert state.why_not_ready(51.1) == 'no joint state from the controller'


def test_joint_mapping_applies_to_positions_and_velocities():
    """The controller's joint 3 depends on its joint 2, and joint 1 is reversed."""
    mapping = joint_mapping(3, [-1, 1, 1], [0.5, 0.0, 0.0], 1)
    state = RobotState(3, mapping=mapping)
    for count in range(20):  # fitted velocities
        t = count * DT
        sample = state.on_joints(joint_data([0.1 * t, 0.2 * t, 0.3 * t]), 50.0 + t)
    np.testing.assert_allclose(sample.positions, [0.5 - 0.1 * t, 0.2 * t, 0.5 * t])
    np.testing.assert_allclose(sample.velocities, [-0.1, 0.2, 0.5], rtol=1e-9)
    sample = state.on_joints(joint_data([0.0, 1.0, 2.0]), 51.0, joint_data([0.1, 0.2, 0.3]))
    np.testing.assert_allclose(sample.positions, [0.5, 1.0, 3.0])
    np.testing.assert_allclose(sample.velocities, [-0.1, 0.2, 0.5])


LIMITS = load_robot_model('c3_a601s').limits

JOINTS = len(LIMITS.names)

BOUNDS = JointBounds(JOINTS, LIMITS, Margins())

LOW, HIGH = LIMITS.position_min - 0.1, LIMITS.position_max + 0.1

FASTEST = LIMITS.velocity * 1.5

NEAR = st.sampled_from([-1.0, -1e-9, 0.0, 1e-9, 1.0])
"""Distance beyond a limit."""


@st.composite
def near_limits(draw, low, high):
    """Return values at a limit, just beyond it, or not finite."""
    values = []
    for joint in range(JOINTS):
        side = draw(st.sampled_from([low[joint], high[joint], 0.0]))
        values.append(draw(st.sampled_from([side + draw(NEAR), math.nan, math.inf, 0.0])))
    return values


@pytest.mark.invariant(8)
@given(near_limits(LOW, HIGH))
def test_inv8_positions_out_of_range_are_implausible(positions):
    inside = all(
        low <= value <= high for low, value, high in zip(LOW, positions, HIGH, strict=True)
    )
    assert (BOUNDS.why_not_there(positions) is None) == inside


@pytest.mark.invariant(8)
@given(near_limits(-FASTEST, FASTEST))
def test_inv8_velocities_beyond_the_limit_are_implausible(velocities):
    too_fast = any(
        abs(value) > fastest for value, fastest in zip(velocities, FASTEST, strict=True)
    )
    assert (BOUNDS.why_not_so_fast(velocities) is not None) == too_fast


@pytest.mark.invariant(8)
@given(
    st.lists(st.floats(-1.0, 1.0), min_size=JOINTS, max_size=JOINTS),
    st.lists(st.sampled_from([0.0, MIN_JUMP, 0.06, 0.3, -0.3]), min_size=JOINTS, max_size=JOINTS),
    st.floats(0.001, 0.3),
)
def test_inv8_jumps_beyond_the_velocity_limit_are_implausible(before, steps, elapsed):
    positions = [old + step for old, step in zip(before, steps, strict=True)]
    jumped = any(
        abs(new - old) > fastest * elapsed + MIN_JUMP
        for new, old, fastest in zip(positions, before, FASTEST.tolist(), strict=True)
    )
    assert (BOUNDS.why_not_from(before, positions, elapsed) is not None) == jumped


numbers = st.lists(st.floats(-7.0, 7.0), min_size=6, max_size=6).map(np.array)

mappings = st.builds(
    joint_mapping,
    st.just(6),
    st.lists(st.sampled_from([1, -1]), min_size=6, max_size=6),
    st.lists(st.floats(-3.2, 3.2), min_size=6, max_size=6),
    st.sampled_from([-1, 0, 1]),
)


@pytest.mark.parametrize('factor', [1, -1])
def test_coupling_of_joint_3_to_joint_2_matches_fanuc_and_abb(factor):
    """industrial_robot_client: state J3 + f J2, command J3 - f J2; the same for velocities."""
    mapping = joint_mapping(6, [1], [0.0], factor)
    controller = np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
    expected = [0.1, 0.2, 0.3 + factor * 0.2, 0.4, 0.5, 0.6]
    for to_ros, to_controller in (
        (mapping.positions_to_ros, mapping.positions_to_controller),
        (mapping.velocities_to_ros, mapping.velocities_to_controller),
    ):
        ros = to_ros(controller)
        np.testing.assert_allclose(ros, expected, rtol=0, atol=1e-15)
        np.testing.assert_allclose(to_controller(ros), controller, rtol=0, atol=1e-15)
    np.testing.assert_array_equal(controller, [0.1, 0.2, 0.3, 0.4, 0.5, 0.6])


def test_sign_and_offset_are_applied_after_the_coupling():
    mapping = joint_mapping(3, [1, -1, -1], [0.0, 0.5, 1.0], 1)
    controller = np.array([0.1, 0.2, 0.3])
    np.testing.assert_allclose(mapping.positions_to_ros(controller), [0.1, 0.3, 0.5])
    np.testing.assert_allclose(mapping.velocities_to_ros(controller), [0.1, -0.2, -0.5])


@given(mappings, numbers)
def test_mapping_is_reversible(mapping, values):
    for there, back in (
        (mapping.positions_to_ros, mapping.positions_to_controller),
        (mapping.velocities_to_ros, mapping.velocities_to_controller),
    ):
        np.testing.assert_allclose(back(there(values)), values, rtol=0, atol=1e-13)


@given(mappings, numbers, numbers)
def test_velocity_mapping_matches_position_changes(mapping, values, change):
    for positions, velocities in (
        (mapping.positions_to_ros, mapping.velocities_to_ros),
        (mapping.positions_to_controller, mapping.velocities_to_controller),
    ):
        moved = positions(values + change) - positions(values)
        np.testing.assert_allclose(moved, velocities(change), rtol=0, atol=1e-12)


@pytest.mark.invariant(8)
def test_inv8_identity_mapping_keeps_values_bit_exact():
    values = np.array([0.1, -0.0, 5e-324])
    mapping = unmapped(3)
    assert mapping.identity
    assert mapping.positions_to_ros(values) is values
    assert mapping.velocities_to_controller(values) is values


@pytest.mark.parametrize(
    ('signs', 'offsets', 'factor', 'text'),
    [
        ([1, 1], [0.0], 0, 'joint_signs = [1, 1]: needs one number, or 6'),
        ([2], [0.0], 0, 'joint_signs = [2]: must be a list, of which each must be 1 or -1'),
        ([1], [0.0] * 7, 0, 'needs one number, or 6'),
        (
            [1],
            [float('nan')],
            0,
            'joint_offsets = [nan]: must be a list, of which each must be a number',
        ),
        ([], [0.0], 0, 'joint_signs = []: needs one number, or 6'),
        ([1], [1e300], 0, 'joint_offsets = [1e+300]: must be a list, of which each must be a'),
    ],
)
def test_invalid_mapping_parameter_is_named(signs, offsets, factor, text):
    with pytest.raises(ValueError, match=re.escape(text)):
        joint_mapping(6, signs, offsets, factor)
