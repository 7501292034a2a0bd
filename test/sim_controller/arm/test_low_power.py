# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Power Low: the caps of a line, and of a motion in any proportion."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from epson_driver.motion import JointLimits
from epson_driver.robots import load_robot_model
from epson_driver.sim_controller.arm.low_power import LowPower

MODEL = load_robot_model('c3_a601s')
LIMITS = MODEL.limits
CAPS = LowPower(0.05, 0.25, MODEL.reach)


@pytest.mark.invariant(2)
def test_invariant_2_the_limits_keep_the_tools_speed_whatever_the_joints_do():
    capped = CAPS.limits(LIMITS)
    assert capped.velocity @ MODEL.reach == pytest.approx(0.25, rel=1e-12)
    assert np.all(capped.velocity <= 0.05 * LIMITS.velocity)
    # joint 6 turns the tool on the spot
    assert capped.velocity[5] == 0.05 * LIMITS.velocity[5]
    np.testing.assert_allclose(capped.acceleration, 0.05 * LIMITS.acceleration)
    np.testing.assert_allclose(capped.jerk, 0.05 * LIMITS.jerk)
    np.testing.assert_array_equal(capped.position_min, LIMITS.position_min)
    np.testing.assert_array_equal(capped.position_max, LIMITS.position_max)
    assert capped.names == LIMITS.names


def test_a_fast_enough_tool_leaves_the_fraction():
    caps = LowPower(0.05, 5.0, MODEL.reach)
    np.testing.assert_allclose(caps.limits(LIMITS).velocity, 0.05 * LIMITS.velocity)
    assert caps.speed(LIMITS, np.ones(6)) == 0.05


@pytest.mark.parametrize(
    ('direction', 'speed'),
    [
        ([1, 0, 0, 0, 0, 0], 0.25 / 0.665 / 7.85),
        ([0, -3, 0, 0, 0, 0], 0.05),  # 0.25 / 0.565 / 7.85 is above 5 %
        ([0, 0, 0, 0, 0, 1e-9], 0.05),
        ([2, -2, 0, 0, 0, 0], 0.25 / (0.665 + 0.565) / 7.85),
        ([0, 0, 0, 0, 0, 0], 0.05),
    ],
)
def test_the_speed_of_a_line_depends_on_the_joints_that_move(direction, speed):
    expected = min(speed, 0.05)
    assert CAPS.speed(LIMITS, np.array(direction, dtype=float)) == pytest.approx(expected)


WAYS = st.tuples(*[st.floats(-5.0, 5.0)] * 6).map(np.array)


@pytest.mark.invariant(2)
@given(way=WAYS, fraction=st.floats(0.01, 1.0), tool_speed=st.floats(0.01, 5.0))
def test_invariant_2_no_line_moves_the_tool_faster(way, fraction, tool_speed):
    caps = LowPower(fraction, tool_speed, MODEL.reach)
    speed = caps.speed(LIMITS, way)
    assert 0.0 < speed <= fraction
    if np.any(np.abs(way) > 1e-300):
        fastest = speed / np.max(np.abs(way) / LIMITS.velocity) * np.abs(way)
        assert fastest @ MODEL.reach <= tool_speed * (1.0 + 1e-9)
        # and it is no slower than that needs
        needed = fastest @ MODEL.reach >= tool_speed * (1.0 - 1e-9)
        assert needed or speed == fraction


@pytest.mark.parametrize(
    ('fraction', 'tool_speed', 'reach', 'text'),
    [
        (0.0, 0.25, [1.0], 'fraction = 0.0'),
        (1.1, 0.25, [1.0], 'fraction = 1.1'),
        (np.nan, 0.25, [1.0], 'fraction = nan'),
        (0.05, 0.0, [1.0], 'tool_speed = 0.0'),
        (0.05, np.inf, [1.0], 'tool_speed = inf'),
        (0.05, np.nan, [1.0], 'tool_speed = nan'),
        (0.05, 0.25, [-1.0], r'reach = \[-1.0\]'),
        (0.05, 0.25, [np.nan], r'reach = \[nan\]'),
    ],
)
def test_wrong_caps_are_refused_and_named(fraction, tool_speed, reach, text):
    with pytest.raises(ValueError, match=f'^{text}'):
        LowPower(fraction, tool_speed, np.array(reach))


def test_another_number_of_joints_is_refused():
    one = JointLimits(('a',), *(np.array([value]) for value in (-1, 1, 1, 1, 1)))
    for ask in (CAPS.limits, lambda limits: CAPS.speed(limits, np.ones(1))):
        with pytest.raises(ValueError, match=r'^reach: 6 values for 1 joints$'):
            ask(one)
