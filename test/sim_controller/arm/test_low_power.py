# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The caps of power Low on lines and on joint motion."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from epson_driver.robots import load_robot_model
from epson_driver.sim_controller.arm.low_power import LowPower

MODEL = load_robot_model('c3_a601s')
LIMITS = MODEL.limits
CAPS = LowPower(0.05, 0.25, MODEL.reach)


@pytest.mark.invariant(2)
def test_inv2_capped_limits_bound_the_tool_speed():
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
def test_speed_of_a_line_depends_on_its_direction(direction, speed):
    expected = min(speed, 0.05)
    assert CAPS.speed(LIMITS, np.array(direction, dtype=float)) == pytest.approx(expected)


DIRECTIONS = st.tuples(*[st.floats(-5.0, 5.0)] * 6).map(np.array)


@pytest.mark.invariant(2)
@given(direction=DIRECTIONS, fraction=st.floats(0.01, 1.0), tool_speed=st.floats(0.01, 5.0))
def test_inv2_no_line_exceeds_the_tool_speed(direction, fraction, tool_speed):
    caps = LowPower(fraction, tool_speed, MODEL.reach)
    speed = caps.speed(LIMITS, direction)
    assert 0.0 < speed <= fraction
    if np.any(np.abs(direction) > 1e-300):
        fastest = speed / np.max(np.abs(direction) / LIMITS.velocity) * np.abs(direction)
        assert fastest @ MODEL.reach <= tool_speed * (1.0 + 1e-9)
        # the cap is not lower than necessary
        needed = fastest @ MODEL.reach >= tool_speed * (1.0 - 1e-9)
        assert needed or speed == fraction
