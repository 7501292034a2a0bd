# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The controller's joints as ROS's and back: coupling, signs, offsets, velocities."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from epson_driver.driver.state.joint_mapping import joint_mapping, unmapped

numbers = st.lists(st.floats(-7.0, 7.0), min_size=6, max_size=6).map(np.array)
mappings = st.builds(
    joint_mapping,
    st.just(6),
    st.lists(st.sampled_from([1, -1]), min_size=6, max_size=6),
    st.lists(st.floats(-3.2, 3.2), min_size=6, max_size=6),
    st.sampled_from([-1, 0, 1]),
)


@pytest.mark.parametrize('factor', [1, -1])
def test_fanuc_and_abb_couple_the_third_joint_to_the_second(factor):
    """industrial_robot_client: state J3 + f J2, command J3 - f J2; velocities alike."""
    mapping = joint_mapping(6, [1], [0.0], factor)
    controller = np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
    expected = [0.1, 0.2, 0.3 + factor * 0.2, 0.4, 0.5, 0.6]
    for there, back in (
        (mapping.positions_to_ros, mapping.positions_to_controller),
        (mapping.velocities_to_ros, mapping.velocities_to_controller),
    ):
        ros = there(controller)
        np.testing.assert_allclose(ros, expected, rtol=0, atol=1e-15)
        np.testing.assert_allclose(back(ros), controller, rtol=0, atol=1e-15)
    np.testing.assert_array_equal(controller, [0.1, 0.2, 0.3, 0.4, 0.5, 0.6])


def test_sign_and_offset_come_after_the_coupling():
    mapping = joint_mapping(3, [1, -1, -1], [0.0, 0.5, 1.0], 1)
    controller = np.array([0.1, 0.2, 0.3])
    np.testing.assert_allclose(mapping.positions_to_ros(controller), [0.1, 0.3, 0.5])
    np.testing.assert_allclose(mapping.velocities_to_ros(controller), [0.1, -0.2, -0.5])


@given(mappings, numbers)
def test_there_and_back_is_the_same(mapping, values):
    for there, back in (
        (mapping.positions_to_ros, mapping.positions_to_controller),
        (mapping.velocities_to_ros, mapping.velocities_to_controller),
    ):
        np.testing.assert_allclose(back(there(values)), values, rtol=0, atol=1e-13)


@given(mappings, numbers, numbers)
def test_a_velocity_is_the_change_of_the_position(mapping, values, change):
    for positions, velocities in (
        (mapping.positions_to_ros, mapping.velocities_to_ros),
        (mapping.positions_to_controller, mapping.velocities_to_controller),
    ):
        moved = positions(values + change) - positions(values)
        np.testing.assert_allclose(moved, velocities(change), rtol=0, atol=1e-12)


@given(mappings, st.lists(numbers, min_size=1, max_size=4).map(np.array))
def test_rows_are_mapped_one_by_one(mapping, rows):
    together = mapping.positions_to_controller(rows)
    np.testing.assert_array_equal(together, [mapping.positions_to_controller(r) for r in rows])


@pytest.mark.invariant(8)
def test_inv8_without_a_mapping_the_values_are_the_same_bits():
    """docs/invariants.md, 8."""
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
def test_a_wrong_parameter_is_named(signs, offsets, factor, text):
    with pytest.raises(ValueError, match=re.escape(text)):
        joint_mapping(6, signs, offsets, factor)


def test_two_joints_have_no_coupling():
    with pytest.raises(ValueError, match='j23_factor = 1: there are 2 joints'):
        joint_mapping(2, [1], [0.0], 1)
