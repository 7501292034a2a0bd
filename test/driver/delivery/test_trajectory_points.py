# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A trajectory as the points on the wire: nothing is faster or further than planned."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from epson_driver.driver.delivery.trajectory_points import (
    FIRST_POINT_VELOCITY_FRACTION,
    MIN_DURATION_S,
    STOP,
    setpoint_of,
    to_float32_inside,
    trajectory_points,
)
from epson_driver.driver.state.joint_mapping import joint_mapping
from epson_driver.motion import JointLimits, Trajectory
from epson_driver.motion.trajectory import LIMIT_TOLERANCE_SHARE
from epson_driver.robots import load_robot_model
from epson_driver.simple_message import LITTLE_ENDIAN, Framer, decode, encode, request

LIMITS = load_robot_model('c3_a601s').limits
JOINTS = len(LIMITS.names)
NOT_MAPPED = joint_mapping(JOINTS, [1], [0.0], 0)


def trajectory(times, positions, velocities=None):
    return Trajectory(
        LIMITS.names,
        np.array(times, dtype=float),
        np.array(positions, dtype=float),
        None if velocities is None else np.array(velocities, dtype=float),
    )


def along(joint, values):
    """Return positions in which one joint takes the values and the others are 0."""
    positions = np.zeros((len(values), JOINTS))
    positions[:, joint] = values
    return positions


def as_received(points):
    """Return the points after they went over the wire."""
    framer = Framer()
    framer.receive_data(b''.join(encode(request(point), LITTLE_ENDIAN) for point in points))
    return [decode(framer.next_frame()).message for _ in points]


def points_of(plan, start=None):
    return trajectory_points(plan, np.zeros(JOINTS) if start is None else start, LIMITS)


def test_sequences_count_from_zero_and_unused_joints_are_zero():
    points = points_of(trajectory([0, 1, 2, 3], along(2, [0.0, 0.1, 0.2, 0.3])))
    assert [point.sequence for point in points] == [0, 1, 2, 3]
    assert all(len(point.joints) == 10 for point in points)
    assert all(point.joints[JOINTS:] == (0.0,) * (10 - JOINTS) for point in points)


def test_durations_of_less_than_a_second_are_exact():
    times = [0.0, 0.004, 0.27, 0.999999999, 2.5]
    points = points_of(trajectory(times, along(0, np.zeros(5))))
    assert [point.duration for point in points[1:]] == np.diff(times).tolist()
    received = [np.float32(step) for step in np.diff(times)]
    assert [point.duration for point in as_received(points)[1:]] == received


def test_a_first_point_without_time_gets_the_usual_velocity_and_a_duration_above_zero():
    first = points_of(trajectory([0, 1], along(0, [0.0, 0.5])))[0]
    assert first.velocity == FIRST_POINT_VELOCITY_FRACTION
    assert first.duration == MIN_DURATION_S


def test_a_first_point_with_time_is_a_segment_from_where_the_arm_is():
    first = points_of(trajectory([0.5, 1], along(0, [1.0, 1.0])))[0]
    assert first.duration == 0.5
    assert first.velocity == pytest.approx(2.0 / LIMITS.velocity[0])


def test_velocity_is_the_fraction_the_segment_needs():
    points = points_of(trajectory([0, 1, 3], along(1, [0.0, 0.785, 0.0])))
    assert points[1].velocity == pytest.approx(0.1)
    assert points[2].velocity == pytest.approx(0.05)


def test_velocities_of_the_plan_count_at_both_ends_of_a_segment():
    velocities = along(0, [0.0, 3.925, 0.0, 0.0])
    plan = trajectory([0, 1, 2, 3], along(0, [0.0, 0.1, 0.2, 0.2]), velocities)
    assert [point.velocity for point in points_of(plan)[1:]] == pytest.approx([0.5, 0.5, 1e-3])


def test_stop_is_minus_four_and_nothing_else():
    assert encode(request(STOP), LITTLE_ENDIAN).hex() == (
        '400000000b0000000200000000000000fcffffff' + '00' * 48
    )


plans = st.lists(
    st.tuples(
        st.floats(1e-6, 5.0),
        st.lists(st.floats(-1.0, 1.0), min_size=JOINTS, max_size=JOINTS),
        st.lists(st.floats(-1.0, 1.0), min_size=JOINTS, max_size=JOINTS),
    ),
    min_size=1,
    max_size=12,
)


@pytest.mark.invariant(2)
@given(plans, st.booleans(), st.booleans())
def test_inv2_velocity_is_at_most_1_and_enough_for_the_plan(rows, with_velocities, from_zero):
    """docs/invariants.md, 2."""
    times = np.cumsum([row[0] for row in rows])
    if from_zero:
        times = times - times[0]
    positions = np.array([row[1] for row in rows]) * 0.8
    velocities = np.array([row[2] for row in rows]) * LIMITS.velocity if with_velocities else None
    points = as_received(points_of(trajectory(times, positions, velocities)))
    starts = np.vstack([np.zeros(JOINTS), positions[:-1]])
    for index, point in enumerate(points):
        assert 0.0 < point.velocity <= 1.0
        assert point.duration > 0.0
        if index == 0 and from_zero:
            continue
        duration = max(times[index] - (times[index - 1] if index else 0.0), MIN_DURATION_S)
        needed = np.abs(positions[index] - starts[index]) / duration / LIMITS.velocity
        if velocities is not None:
            needed = np.maximum(needed, np.abs(velocities[index]) / LIMITS.velocity)
        assert point.velocity >= min(needed.max(), 1.0) * (1.0 - 1e-6)


ranges = st.tuples(
    st.floats(-7.0, 7.0, allow_subnormal=False), st.floats(1e-3, 10.0), st.floats(-1.0, 2.0)
)


@pytest.mark.invariant(2)
@given(st.lists(ranges, min_size=1, max_size=6))
def test_inv2_float32_positions_never_leave_the_limits(rows):
    """docs/invariants.md, 2: rounding a limit to float32 may lead outside."""
    low = np.array([row[0] for row in rows])
    high = low + np.array([row[1] for row in rows])
    ones = np.ones(len(rows))
    names = tuple(f'j{index}' for index in range(len(rows)))
    limits = JointLimits(names, low, high, ones, ones, ones)
    share = np.array([row[2] for row in rows])
    for wanted in (low, high, low + share * (high - low), np.nextafter(high, np.inf)):
        sent = to_float32_inside(wanted[None, :], limits)[0]
        assert np.all(sent == sent.astype(np.float32))  # the wire changes nothing any more
        assert np.all(sent >= low)
        assert np.all(sent <= high)
        inside = np.clip(wanted, low, high)
        assert np.all(np.abs(sent - inside) <= np.spacing(np.abs(inside).astype(np.float32)))


@pytest.mark.invariant(2)
@pytest.mark.parametrize('side', ['position_min', 'position_max'])
def test_inv2_a_plan_at_the_limit_and_a_rounding_beyond_it_is_sent_inside(side):
    """docs/invariants.md, 2."""
    limit = getattr(LIMITS, side)
    span = LIMITS.position_max - LIMITS.position_min
    beyond = limit + np.sign(limit) * span * LIMIT_TOLERANCE_SHARE * 0.99
    points = as_received(points_of(trajectory([0, 9], [limit, beyond])))
    for point in points:
        sent = np.array(point.joints[:JOINTS])
        assert np.all(sent >= LIMITS.position_min)
        assert np.all(sent <= LIMITS.position_max)
        assert np.all(np.abs(sent - limit) < 1e-6)


def test_a_setpoint_needs_the_velocity_with_which_it_is_passed():
    way = trajectory([0.0, 0.1], np.zeros((2, JOINTS)))
    with pytest.raises(ValueError, match='the setpoint has no velocities'):
        setpoint_of(way, 7, 1.0, LIMITS, NOT_MAPPED)
    moving = trajectory([0.0, 0.1], np.full((2, JOINTS), 0.1), np.full((2, JOINTS), 0.2))
    message = setpoint_of(moving, 7, 0.5, LIMITS, NOT_MAPPED)
    assert (message.sequence, message.scale) == (7, 0.5)
    assert message.velocities[:JOINTS] == pytest.approx([0.2] * JOINTS)
