# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The fields of points, alone, in blocks, and along whole trajectories."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.examples import examples

from epson_driver.driver.delivery.delivery import DeliveryRules
from epson_driver.driver.delivery.download import download_sequences
from epson_driver.driver.delivery.streaming import (
    BLOCK_POINTS,
    FIRST_POINT_VELOCITY_FRACTION,
    MIN_DURATION_S,
    START_MARGIN_RAD,
    STOP,
    LazyPoints,
    Streaming,
    from_standing,
    full_points,
    to_float32_inside,
    trajectory_points,
    with_velocities,
)
from epson_driver.driver.goal.goal import Goal, checked_goal
from epson_driver.driver.state.joint_mapping import joint_mapping, unmapped
from epson_driver.link import Link
from epson_driver.motion import JointLimits, Trajectory
from epson_driver.motion.trajectory import LIMIT_TOLERANCE_SHARE
from epson_driver.profiles.profile_rules import FieldsUsed
from epson_driver.robots import load_robot_model
from epson_driver.simple_message import LITTLE_ENDIAN, Framer, decode, encode, request

LIMITS = load_robot_model('c3_a601s').limits
JOINTS = len(LIMITS.names)
HOME = np.zeros(JOINTS)


def plan(times, first_joint, velocities=None):
    """Return a plan that moves joint 1 alone."""
    return trajectory(
        times, along(0, first_joint), None if velocities is None else along(0, velocities)
    )


def test_first_point_has_the_minimum_duration():
    """The ROS 1 client sent 10 s for a first point at 0 s."""
    assert points_of(plan([0.0, 1.0], [0.0, 0.5]))[0].duration == MIN_DURATION_S


def test_last_segment_has_the_planned_velocity():
    """The ROS 1 client sent 10 % for every point with velocity 0, such as the last one."""
    points = points_of(plan([0.0, 0.2, 0.4], [0.0, 0.4, 0.8], [0.0, 3.5, 0.0]))
    expected = 3.5 / LIMITS.velocity[0]
    assert [point.velocity for point in points[1:]] == pytest.approx([expected] * 2)


def test_segment_without_motion_has_the_smallest_velocity():
    """Controllers refuse velocity 0."""
    assert points_of(plan([0.0, 1.0], [0.0, 0.0]))[1].velocity == 1e-3


def test_start_away_from_the_arm_is_approached_slowly():
    """A controller that uses only the duration must not jump there."""
    first = points_of(plan([0.0, 1.0], [0.02, 0.5]))[0]
    assert first.duration == pytest.approx(
        0.02 / (FIRST_POINT_VELOCITY_FRACTION * LIMITS.velocity[0])
    )
    assert first.velocity == FIRST_POINT_VELOCITY_FRACTION


def test_download_differs_from_streaming_only_in_sequence_numbers():
    points = points_of(plan([0.0, 0.5, 1.0], [0.0, 0.2, 0.3]))
    downloaded = download_sequences(points)
    assert [point.sequence for point in downloaded] == [-1, 1, -3]
    assert [replace(point, sequence=0) for point in downloaded] == [
        replace(point, sequence=0) for point in points
    ]
    assert [point.sequence for point in download_sequences(points[:1])] == [-1, -3]


# ---- JOINT_TRAJ_PT_FULL


def test_full_points_have_the_plan_times_and_velocities():
    trajectory = plan([0.0, 0.004, 0.3], [0.0, 0.001, 0.2], [0.0, 0.5, 0.0])
    points = full_points(trajectory, LIMITS, unmapped(len(LIMITS.names)))
    assert [point.time for point in points] == [0.0, 0.004, 0.3]
    assert [point.velocities[0] for point in points] == [0.0, 0.5, 0.0]
    assert {(point.robot_id, point.valid_fields) for point in points} == {(0, 7)}
    with pytest.raises(ValueError, match='no velocities'):
        full_points(plan([0.0, 1.0], [0.0, 0.1]), LIMITS, unmapped(len(LIMITS.names)))


def test_velocities_added_to_points_cause_no_overshoot():
    """They are 0 at the ends and reversals; a cubic between two points stays between them."""
    trajectory = with_velocities(plan([0, 1, 2, 3, 5, 6], [0.0, 0.1, 0.9, 1.0, 0.4, 0.4]))
    velocities = trajectory.velocities[:, 0]
    assert velocities[[0, 3, 4, 5]].tolist() == [0.0, 0.0, 0.0, 0.0]
    steps, slopes = np.diff(trajectory.times), np.diff(trajectory.positions[:, 0])
    fraction = np.linspace(0.0, 1.0, 101)
    for index, (step, distance) in enumerate(zip(steps, slopes, strict=True)):
        v0, v1 = velocities[index : index + 2] * step
        cubic = v0 + v1 - 2 * distance
        path = fraction * (v0 + fraction * (3 * distance - 2 * v0 - v1 + fraction * cubic))
        assert path.min() >= min(distance, 0.0) - 1e-12
        assert path.max() <= max(distance, 0.0) + 1e-12


def test_velocities_of_the_plan_are_unchanged():
    trajectory = plan([0.0, 1.0], [0.0, 0.1], [0.0, 0.0])
    assert with_velocities(trajectory) is trajectory


def test_motoman_plan_starts_exactly_at_the_arm_position():
    """MotoROS refuses a first point that is some encoder pulses away."""
    start = HOME + 0.9 * START_MARGIN_RAD
    near = from_standing(plan([0.0, 1.0], [0.0, 0.5]), start, LIMITS)
    np.testing.assert_array_equal(near.positions[0], start)
    assert near.times.tolist() == [0.0, 1.0]
    away = from_standing(plan([0.5, 1.0], [0.3, 0.5], [1.0, 0.0]), start, LIMITS)
    assert away.times.tolist() == [0.0, 0.5, 1.0]
    np.testing.assert_array_equal(away.positions[0], start)
    assert away.velocities[:, 0].tolist() == [0.0, 1.0, 0.0]
    shifted = from_standing(plan([0.0, 1.0], [0.01, 0.5]), HOME, LIMITS)
    hold = 0.01 / (FIRST_POINT_VELOCITY_FRACTION * LIMITS.velocity[0])
    np.testing.assert_allclose(shifted.times, [0.0, hold, 1.0 + hold])


def trajectory(times, positions, velocities=None):
    return Trajectory(
        LIMITS.names,
        np.array(times, dtype=float),
        np.array(positions, dtype=float),
        None if velocities is None else np.array(velocities, dtype=float),
    )


def along(joint, values):
    """Return positions in which one joint has the values and the others are 0."""
    positions = np.zeros((len(values), JOINTS))
    positions[:, joint] = values
    return positions


def as_received(points):
    """Return the points after encoding and decoding."""
    framer = Framer()
    framer.receive_data(b''.join(encode(request(point), LITTLE_ENDIAN) for point in points))
    return [decode(framer.next_frame()).message for _ in points]


def points_of(plan, start=HOME):
    return trajectory_points(plan, start, LIMITS, unmapped(JOINTS))


def test_sequences_start_at_zero_and_unused_joints_are_zero():
    points = points_of(trajectory([0, 1, 2, 3], along(2, [0.0, 0.1, 0.2, 0.3])))
    assert [point.sequence for point in points] == [0, 1, 2, 3]
    assert all(len(point.joints) == 10 for point in points)
    assert all(point.joints[JOINTS:] == (0.0,) * (10 - JOINTS) for point in points)


def test_durations_below_a_second_are_exact():
    """A ROS 2 port sent 10 s for segments below one second."""
    times = [0.0, 0.004, 0.27, 0.999999999, 2.5]
    points = points_of(plan(times, np.zeros(5)))
    assert [point.duration for point in points[1:]] == np.diff(times).tolist()
    received = [np.float32(step) for step in np.diff(times)]
    assert [point.duration for point in as_received(points)[1:]] == received


def test_first_point_with_time_is_a_segment_from_the_arm_position():
    first = points_of(trajectory([0.5, 1], along(0, [1.0, 1.0])))[0]
    assert first.duration == 0.5
    assert first.velocity == pytest.approx(2.0 / LIMITS.velocity[0])


def test_point_velocity_is_the_fraction_that_its_segment_needs():
    points = points_of(trajectory([0, 1, 3], along(1, [0.0, 0.785, 0.0])))
    assert points[1].velocity == pytest.approx(0.1)
    assert points[2].velocity == pytest.approx(0.05)


def test_plan_velocities_at_both_ends_bound_the_segment_velocity():
    velocities = along(0, [0.0, 3.925, 0.0, 0.0])
    plan = trajectory([0, 1, 2, 3], along(0, [0.0, 0.1, 0.2, 0.2]), velocities)
    assert [point.velocity for point in points_of(plan)[1:]] == pytest.approx([0.5, 0.5, 1e-3])


def test_stop_has_sequence_minus_four_and_zero_fields():
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
    """Rounding a limit to float32 may exceed it."""
    low = np.array([row[0] for row in rows])
    high = low + np.array([row[1] for row in rows])
    ones = np.ones(len(rows))
    names = tuple(f'j{index}' for index in range(len(rows)))
    limits = JointLimits(names, low, high, ones, ones, ones)
    fraction = np.array([row[2] for row in rows])
    for value in (low, high, low + fraction * (high - low), np.nextafter(high, np.inf)):
        sent = to_float32_inside(value[None, :], limits)[0]
        assert np.all(sent == sent.astype(np.float32))  # unchanged by encoding
        assert np.all(sent >= low)
        assert np.all(sent <= high)
        inside = np.clip(value, low, high)
        assert np.all(np.abs(sent - inside) <= np.spacing(np.abs(inside).astype(np.float32)))


@pytest.mark.invariant(2)
@pytest.mark.parametrize('side', ['position_min', 'position_max'])
def test_inv2_plan_within_tolerance_of_a_limit_is_sent_inside(side):
    limit = getattr(LIMITS, side)
    span = LIMITS.position_max - LIMITS.position_min
    beyond = limit + np.sign(limit) * span * LIMIT_TOLERANCE_SHARE * 0.99
    points = as_received(points_of(trajectory([0, 9], [limit, beyond])))
    for point in points:
        sent = np.array(point.joints[:JOINTS])
        assert np.all(sent >= LIMITS.position_min)
        assert np.all(sent <= LIMITS.position_max)
        assert np.all(np.abs(sent - limit) < 1e-6)


START = np.full(JOINTS, 0.01)

MAPPINGS = [
    joint_mapping(JOINTS, [1], [0.0], 0),
    joint_mapping(JOINTS, [1, -1, 1, 1, -1, 1], [0.1], 1),
]


def wave(count: int, first: float, *, with_velocities: bool) -> Trajectory:
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
    uses=st.sampled_from(FieldsUsed),
    order=st.randoms(use_true_random=False),
)
def test_inv2_points_made_in_blocks_equal_those_made_together(
    count, first, with_velocities, mapping, uses, order
):
    """They are equal at block boundaries and in any order."""
    trajectory = wave(count, first, with_velocities=with_velocities)
    whole = trajectory_points(trajectory, START, LIMITS, mapping, uses)
    lazy = LazyPoints(
        count,
        lambda first, end: trajectory_points(
            trajectory, START, LIMITS, mapping, uses, first=first, end=end
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
    if with_velocities:
        full = full_points(trajectory, LIMITS, mapping, first=1, end=3)
        assert full == full_points(trajectory, LIMITS, mapping)[1:3]


@pytest.mark.parametrize('count', [1, 2, 10, BLOCK_POINTS, 100_000])
def test_first_point_is_made_alone_and_later_points_in_blocks(count):
    """The time for the first point does not depend on the number of points."""
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


def peak_memory(count):
    """Return the peak memory for checking a goal and preparing its first message, bytes."""
    times = 0.004 * np.arange(count)
    trajectory = plan(times, 0.1 * (1.0 - np.cos(2.0 * np.pi * times / times[-1])))
    link = Link('none', '127.0.0.1', 1, on_packet=lambda _: None, on_state=lambda *_: None)
    delivery = Streaming(link, LIMITS, unmapped(JOINTS), DeliveryRules())
    tracemalloc.start()
    checked_goal(Goal(trajectory, np.full(JOINTS, 0.01), 0.0), LIMITS)
    assert delivery.prepare(trajectory, HOME).messages[0].sequence == 0
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak


@pytest.mark.invariant(7)
def test_inv7_first_point_of_a_long_goal_needs_no_extra_memory():
    """A message takes 500 bytes."""
    assert peak_memory(10_000) - peak_memory(4_000) < 30_000
