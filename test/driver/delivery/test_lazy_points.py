# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Points that are made when they are sent are those that are made at once."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.examples import examples

from epson_driver.driver.delivery.lazy_points import BLOCK_POINTS, LazyPoints
from epson_driver.driver.delivery.trajectory_points import full_points, trajectory_points
from epson_driver.driver.state.joint_mapping import joint_mapping
from epson_driver.motion import Trajectory
from epson_driver.profiles.point_fields import FieldsUsed, VelocityUnit
from epson_driver.robots import load_robot_model

LIMITS = load_robot_model('c3_a601s').limits
JOINTS = len(LIMITS.names)
START = np.full(JOINTS, 0.01)
MAPPINGS = [
    joint_mapping(JOINTS, [1], [0.0], 0),
    joint_mapping(JOINTS, [1, -1, 1, 1, -1, 1], [0.1], 1),
]


def plan(count: int, first: float, *, with_velocities: bool) -> Trajectory:
    times = first + 0.01 * np.arange(count)
    positions = 0.3 * np.sin(times[:, None] + np.arange(JOINTS))
    velocities = 0.3 * np.cos(times[:, None] + np.arange(JOINTS)) if with_velocities else None
    return Trajectory(LIMITS.names, times, positions, velocities)


@pytest.mark.invariant(1, 2)
@settings(max_examples=examples(40), deadline=None)
@given(
    count=st.integers(1, 3 * BLOCK_POINTS + 1),
    first=st.sampled_from([0.0, 0.5]),
    with_velocities=st.booleans(),
    mapping=st.sampled_from(MAPPINGS),
    unit=st.sampled_from(VelocityUnit),
    uses=st.sampled_from(FieldsUsed),
    order=st.randoms(use_true_random=False),
)
def test_inv2_each_point_is_the_one_that_is_made_with_all_others(
    count, first, with_velocities, mapping, unit, uses, order
):
    """docs/invariants.md, 2: also where one block ends and the next begins, in any order."""
    trajectory = plan(count, first, with_velocities=with_velocities)
    whole = trajectory_points(trajectory, START, LIMITS, mapping, unit, uses)
    lazy = LazyPoints(
        count,
        lambda first, end: trajectory_points(
            trajectory, START, LIMITS, mapping, unit, uses, first=first, end=end
        ),
    )
    assert len(lazy) == count
    assert list(lazy) == whole
    indices = list(range(count))
    order.shuffle(indices)
    assert all(lazy[index] == whole[index] for index in indices[:20])
    assert lazy[-1] == whole[-1]
    assert lazy[1:3] == whole[1:3]
    with pytest.raises(IndexError):
        lazy[count]


def test_full_points_in_blocks_are_those_made_at_once():
    trajectory = plan(2 * BLOCK_POINTS + 5, 0.0, with_velocities=True)
    lazy = LazyPoints(
        len(trajectory.times),
        lambda first, end: full_points(trajectory, LIMITS, first=first, end=end),
    )
    assert list(lazy) == full_points(trajectory, LIMITS)


@pytest.mark.parametrize('count', [1, 2, 10, BLOCK_POINTS, 100_000])
def test_the_first_point_takes_as_long_however_many_follow(count):
    """It is made alone; those after it a block at a time."""
    made = []

    def make(first, end):
        made.append((first, end))
        return list(range(first, end))

    points = LazyPoints(count, make)
    assert points[0] == 0
    assert made == [(0, 1)]
    blocks = [(at, min(at + BLOCK_POINTS, count)) for at in range(0, count, BLOCK_POINTS)]
    assert [points[index] for index in range(1, count)] == list(range(1, count))
    assert made[1:] == (blocks if count > 1 else [])
