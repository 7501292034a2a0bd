# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Joint limits are checked on creation and immutable."""

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


def test_default_unit_is_rad() -> None:
    assert limits().units == ('rad', 'rad')
    assert limits(units=('rad', 'm')).units == ('rad', 'm')


def test_limits_are_immutable_arrays() -> None:
    velocities = np.array([3.0, 4.0])
    result = limits(velocity=velocities)
    velocities[0] = 1e9
    assert result.velocity.tolist() == [3.0, 4.0]
    for quantity in ('position_min', 'position_max', 'velocity', 'acceleration', 'jerk'):
        with pytest.raises(ValueError, match='read-only'):
            getattr(result, quantity)[0] = 1e9


@pytest.mark.parametrize(
    ('changed', 'text'),
    [
        ({'names': ()}, 'at least one joint name is needed, and all must differ: ()'),
        (
            {'names': ('a', 'a')},
            "at least one joint name is needed, and all must differ: ('a', 'a')",
        ),
        ({'units': ('rad',)}, "units must be rad or m, one per joint: ('rad',)"),
        ({'units': ('rad', 'mm')}, "units must be rad or m, one per joint: ('rad', 'mm')"),
        ({'velocity': [3.0]}, 'velocity: 1 values for 2 joints'),
        ({'jerk': [[7.0, 8.0]]}, 'jerk: 2 values for 2 joints'),
        ({'acceleration': 5.0}, 'acceleration: 1 values for 2 joints'),
        ({'jerk': [7.0, float('nan')]}, 'elbow: jerk = nan is not finite'),
        (
            {'position_min': [-float('inf'), -2.0]},
            'shoulder: position_min = -inf is not finite',
        ),
        ({'velocity': [3.0, 0.0]}, 'elbow: velocity = 0.0 must be positive'),
        ({'position_min': [-1.0, 2.0]}, 'elbow: position range 2.0 … 2.0 is empty'),
        ({'position_max': [-1.5, 2.0]}, 'shoulder: position range -1.0 … -1.5 is empty'),
    ],
    ids=lambda x: x if isinstance(x, str) else '',
)
def test_invalid_limits_are_named_with_joint_and_value(changed: dict[str, Any], text: str) -> None:
    with pytest.raises(ValueError, match=f'^{re.escape(text)}$'):
        limits(**changed)


def test_negative_position_range_is_valid() -> None:
    assert limits(position_min=[-3.0, -2.0], position_max=[-2.5, 0.0]).position_max[0] == -2.5


def test_rad_per_unit_compares_the_shaft_with_joint_1() -> None:
    scara = load_robot_model('rs6_c552s').limits
    assert scara.rad_per_unit == pytest.approx([1.0, 1.0, 7.2099 / 1.44, 1.0], rel=1e-5)
    assert np.array_equal(load_robot_model('c3_a601s').limits.rad_per_unit, np.ones(6))
