# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Joint limits are checked when they are made, and cannot change afterwards."""

import re
from typing import Any

import numpy as np
import pytest

from epson_driver.motion import JointLimits
from epson_driver.robots import load_robot_model


def limits(**changed: Any) -> JointLimits:
    values: dict[str, Any] = {
        'names': ('shoulder', 'elbow'),
        'position_min': [-1.0, -2.0],
        'position_max': [1.0, 2.0],
        'velocity': [3.0, 4.0],
        'acceleration': [5.0, 6.0],
        'jerk': [7.0, 8.0],
    }
    return JointLimits(**(values | changed))


def test_joints_are_in_rad_unless_said_otherwise() -> None:
    assert limits().units == ('rad', 'rad')
    assert limits(units=('rad', 'm')).units == ('rad', 'm')


def test_limits_are_arrays_that_cannot_be_changed() -> None:
    given = np.array([3.0, 4.0])
    made = limits(velocity=given)
    given[0] = 1e9
    assert made.velocity.tolist() == [3.0, 4.0]
    for quantity in ('position_min', 'position_max', 'velocity', 'acceleration', 'jerk'):
        with pytest.raises(ValueError, match='read-only'):
            getattr(made, quantity)[0] = 1e9


@pytest.mark.parametrize(
    ('changed', 'text'),
    [
        ({'names': ()}, 'joint names must be there and differ: ()'),
        ({'names': ('a', 'a')}, "joint names must be there and differ: ('a', 'a')"),
        ({'units': ('rad',)}, "units must be rad or m, one per joint: ('rad',)"),
        ({'units': ('rad', 'mm')}, "units must be rad or m, one per joint: ('rad', 'mm')"),
        ({'velocity': [3.0]}, 'velocity: 1 values for 2 joints'),
        ({'position_max': [1.0, 2.0, 3.0]}, 'position_max: 3 values for 2 joints'),
        ({'jerk': [[7.0, 8.0]]}, 'jerk: 2 values for 2 joints'),
        ({'acceleration': 5.0}, 'acceleration: 1 values for 2 joints'),
        ({'jerk': [7.0, float('nan')]}, 'elbow: jerk = nan is not finite'),
        ({'velocity': [float('inf'), 4.0]}, 'shoulder: velocity = inf is not finite'),
        (
            {'position_min': [-float('inf'), -2.0]},
            'shoulder: position_min = -inf is not finite',
        ),
        ({'velocity': [3.0, 0.0]}, 'elbow: velocity = 0.0 must be positive'),
        ({'acceleration': [-5.0, 6.0]}, 'shoulder: acceleration = -5.0 must be positive'),
        ({'position_min': [-1.0, 2.0]}, 'elbow: position range 2.0 … 2.0 is empty'),
        ({'position_max': [-1.5, 2.0]}, 'shoulder: position range -1.0 … -1.5 is empty'),
    ],
    ids=lambda x: x if isinstance(x, str) else '',
)
def test_an_error_names_the_joint_the_quantity_and_the_value(
    changed: dict[str, Any], text: str
) -> None:
    with pytest.raises(ValueError, match=f'^{re.escape(text)}$'):
        limits(**changed)


def test_a_negative_position_range_is_a_range() -> None:
    assert limits(position_min=[-3.0, -2.0], position_max=[-2.5, 0.0]).position_max[0] == -2.5


def test_a_metre_counts_as_what_joint_1_turns_while_the_shaft_goes_it() -> None:
    scara = load_robot_model('rs6_c552s').limits
    assert scara.rad_per_unit == pytest.approx([1.0, 1.0, 7.2099 / 1.44, 1.0], rel=1e-5)
    assert np.array_equal(load_robot_model('c3_a601s').limits.rad_per_unit, np.ones(6))
