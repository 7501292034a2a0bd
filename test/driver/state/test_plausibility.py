# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What is seen of all joints at once is what is seen joint by joint."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from epson_driver.driver.state.plausibility import MIN_JUMP, JointBounds, Margins
from epson_driver.robots import load_robot_model

LIMITS = load_robot_model('c3_a601s').limits
JOINTS = len(LIMITS.names)
BOUNDS = JointBounds(JOINTS, LIMITS, Margins())
LOW, HIGH = LIMITS.position_min - 0.1, LIMITS.position_max + 0.1
FASTEST = LIMITS.velocity * 1.5

NEAR = st.sampled_from([-1.0, -1e-9, 0.0, 1e-9, 1.0])
"""How far beyond a limit."""


@st.composite
def near_limits(draw, low, high):
    """Return values of which some lie at a limit, or just beyond it, or are not finite."""
    values = []
    for joint in range(JOINTS):
        side = draw(st.sampled_from([low[joint], high[joint], 0.0]))
        values.append(draw(st.sampled_from([side + draw(NEAR), math.nan, math.inf, 0.0])))
    return values


@pytest.mark.invariant(8)
@given(near_limits(LOW, HIGH))
def test_inv8_where_joints_cannot_be(positions):
    """docs/invariants.md, 8."""
    inside = all(
        low <= value <= high for low, value, high in zip(LOW, positions, HIGH, strict=True)
    )
    assert (BOUNDS.why_not_there(positions) is None) == inside


@pytest.mark.invariant(8)
@given(near_limits(-FASTEST, FASTEST))
def test_inv8_how_fast_joints_cannot_be(velocities):
    """docs/invariants.md, 8."""
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
def test_inv8_where_joints_cannot_have_got_to(before, steps, elapsed):
    """docs/invariants.md, 8."""
    positions = [old + step for old, step in zip(before, steps, strict=True)]
    jumped = any(
        abs(new - old) > fastest * elapsed + MIN_JUMP
        for new, old, fastest in zip(positions, before, FASTEST.tolist(), strict=True)
    )
    assert (BOUNDS.why_not_from(before, positions, elapsed) is not None) == jumped
