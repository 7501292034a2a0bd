# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The fields of points, alone, in blocks, and along whole trajectories."""

import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.examples import examples

from epson_driver.driver.delivery.delivery import DeliveryRules
from epson_driver.driver.delivery.download import download_sequences
from epson_driver.driver.delivery.streaming import Streaming
from epson_driver.driver.delivery.trajectory_points import (
    BLOCK_POINTS,
    FIRST_POINT_VELOCITY_FRACTION,
    MIN_DURATION_S,
    START_MARGIN_RAD,
    STOP,
    LazyPoints,
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
    """Return a plan in which joint 1 moves and the others stand."""
    columns = [None, None]
    for index, values in enumerate((first_joint, velocities)):
        if values is not None:
            columns[index] = np.zeros((len(times), JOINTS))
            columns[index][:, 0] = values
    return Trajectory(LIMITS.names, np.array(times, dtype=float), columns[0], columns[1])


def sent(trajectory, start=HOME):
    """Return the points as the controller receives them."""
    framer = Framer()
    for point in trajectory_points(trajectory, start, LIMITS, unmapped(len(LIMITS.names))):
        framer.receive_data(encode(request(point), LITTLE_ENDIAN))
    return [decode(framer.next_frame()).message for _ in trajectory.times]


def test_the_first_duration_is_not_ten_seconds():
    """Old: a first point at 0 s was sent with 10 s, and a controller waited as long."""
    assert sent(plan([0.0, 1.0], [0.0, 0.5]))[0].duration == np.float32(MIN_DURATION_S)


def test_a_trajectory_knows_nothing_of_the_one_before():
    """Old: the last time was kept from one trajectory to the next: 10 s, or a wrong difference."""
    long, short = plan([0.0, 9.0], [0.0, 0.5]), plan([0.5, 1.0], [0.5, 0.0])
    alone = sent(short, long.positions[-1])
    sent(long)
    assert sent(short, long.positions[-1]) == alone
    assert [point.duration for point in alone] == [0.5, 0.5]


@pytest.mark.parametrize('step', [0.004, 0.02, 0.1, 0.25, 0.999])
def test_durations_of_less_than_a_second(step):
    """Old (a ROS 2 port): whole seconds only; segments below one second became 10 s."""
    points = sent(plan(np.arange(5) * step, np.linspace(0, 1e-3, 5)))
    np.testing.assert_allclose([point.duration for point in points[1:]], step, rtol=1e-6)


def test_durations_add_up_to_the_plan_however_long_it_is():
    """Old (a ROS 2 port): seconds and nanoseconds were halved apart, with whole numbers."""
    times = np.cumsum(np.full(10_000, 0.0201))
    points = sent(plan(times, np.linspace(0.0, 1.0, len(times))))
    assert sum(point.duration for point in points) == pytest.approx(times[-1], rel=1e-5)


def test_the_last_segment_is_as_fast_as_planned():
    """Old: a point with velocity 0, as every last one has, was sent with 10 %."""
    share = np.array([0.0, 0.5, 1.0])
    points = sent(plan([0.0, 0.2, 0.4], share * 0.8, [0.0, 3.5, 0.0]))
    expected = 3.5 / LIMITS.velocity[0]
    assert points[1].velocity == pytest.approx(expected)
    assert points[2].velocity == pytest.approx(expected)


def test_the_first_segment_is_as_fast_as_planned():
    """Old: the same at the other end, when the plan begins with a point that is away."""
    points = sent(plan([0.2, 0.4], [0.6, 0.8], [0.0, 0.0]))
    assert points[0].velocity == pytest.approx(3.0 / LIMITS.velocity[0])
    assert points[0].duration == np.float32(0.2)


def test_a_plan_without_velocities_is_as_fast_as_planned():
    """Old: all of its points were sent with 10 %."""
    points = sent(plan([0.0, 0.2, 0.6], [0.0, 0.6, 0.7]))
    speeds = np.array([3.0, 0.25]) / LIMITS.velocity[0]
    np.testing.assert_allclose([point.velocity for point in points[1:]], speeds, rtol=1e-6)


def test_a_segment_that_stands_has_no_velocity_of_ten_percent():
    """Old: velocity 0 was taken for 'not given'. A controller refuses 0: it is the smallest."""
    assert sent(plan([0.0, 1.0], [0.0, 0.0]))[1].velocity == np.float32(1e-3)


def test_a_start_beside_the_arm_takes_its_time():
    """A controller that goes by the duration alone must not jump there."""
    first = sent(plan([0.0, 1.0], [0.02, 0.5]))[0]
    assert first.duration == pytest.approx(
        0.02 / (FIRST_POINT_VELOCITY_FRACTION * LIMITS.velocity[0])
    )
    assert first.velocity == np.float32(FIRST_POINT_VELOCITY_FRACTION)


def test_a_download_has_the_same_fields():
    """Old: the same faults in both interfaces; a single point was sent twice."""
    points = trajectory_points(
        plan([0.0, 0.5, 1.0], [0.0, 0.2, 0.3]), HOME, LIMITS, unmapped(len(LIMITS.names))
    )
    downloaded = download_sequences(points)
    assert [point.sequence for point in downloaded] == [-1, 1, -3]
    for one, other in zip(points, downloaded, strict=True):
        assert (one.joints, one.velocity, one.duration) == (
            other.joints,
            other.velocity,
            other.duration,
        )
    assert [point.sequence for point in download_sequences(points[:1])] == [-1, -3]


# ---- JOINT_TRAJ_PT_FULL


def test_full_points_carry_the_times_and_velocities_of_the_plan():
    trajectory = plan([0.0, 0.004, 0.3], [0.0, 0.001, 0.2], [0.0, 0.5, 0.0])
    points = full_points(trajectory, LIMITS, unmapped(len(LIMITS.names)))
    assert [point.time for point in points] == [0.0, 0.004, 0.3]
    assert [point.velocities[0] for point in points] == [0.0, 0.5, 0.0]
    assert {(point.robot_id, point.valid_fields) for point in points} == {(0, 7)}
    with pytest.raises(ValueError, match='no velocities'):
        full_points(plan([0.0, 1.0], [0.0, 0.1]), LIMITS, unmapped(len(LIMITS.names)))


def test_velocities_that_a_plan_lacks_never_overshoot():
    """0 at the ends and where the joint turns; a cubic between the points stays between them."""
    trajectory = with_velocities(plan([0, 1, 2, 3, 5, 6], [0.0, 0.1, 0.9, 1.0, 0.4, 0.4]))
    velocities = trajectory.velocities[:, 0]
    assert velocities[[0, 3, 4, 5]].tolist() == [0.0, 0.0, 0.0, 0.0]
    steps, slopes = np.diff(trajectory.times), np.diff(trajectory.positions[:, 0])
    share = np.linspace(0.0, 1.0, 101)
    for index, (step, way) in enumerate(zip(steps, slopes, strict=True)):
        v0, v1 = velocities[index : index + 2] * step
        path = share * (v0 + share * (3 * way - 2 * v0 - v1 + share * (v0 + v1 - 2 * way)))
        assert path.min() >= min(way, 0.0) - 1e-12
        assert path.max() <= max(way, 0.0) + 1e-12


def test_velocities_of_the_plan_stay_as_they_are():
    trajectory = plan([0.0, 1.0], [0.0, 0.1], [0.0, 0.0])
    assert with_velocities(trajectory) is trajectory


def test_a_plan_begins_exactly_where_the_arm_stands():
    """MotoROS refuses a first point that is further away than some encoder pulses."""
    start = HOME + 0.9 * START_MARGIN_RAD
    near = from_standing(plan([0.0, 1.0], [0.0, 0.5]), start, LIMITS)
    np.testing.assert_array_equal(near.positions[0], start)
    assert near.times.tolist() == [0.0, 1.0]
    away = from_standing(plan([0.5, 1.0], [0.3, 0.5], [1.0, 0.0]), start, LIMITS)
    assert away.times.tolist() == [0.0, 0.5, 1.0]
    np.testing.assert_array_equal(away.positions[0], start)
    assert away.velocities[:, 0].tolist() == [0.0, 1.0, 0.0]
    beside = from_standing(plan([0.0, 1.0], [0.01, 0.5]), HOME, LIMITS)
    hold = 0.01 / (FIRST_POINT_VELOCITY_FRACTION * LIMITS.velocity[0])
    np.testing.assert_allclose(beside.times, [0.0, hold, 1.0 + hold])


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
    return trajectory_points(
        plan, np.zeros(JOINTS) if start is None else start, LIMITS, unmapped(len(LIMITS.names))
    )


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
def test_inv2_each_point_is_the_one_that_is_made_with_all_others(
    count, first, with_velocities, mapping, uses, order
):
    """docs/invariants.md, 2: also where one block ends and the next begins, in any order."""
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


def test_full_points_in_blocks_are_those_made_at_once():
    trajectory = wave(2 * BLOCK_POINTS + 5, 0.0, with_velocities=True)
    lazy = LazyPoints(
        len(trajectory.times),
        lambda first, end: full_points(
            trajectory, LIMITS, unmapped(len(LIMITS.names)), first=first, end=end
        ),
    )
    assert list(lazy) == full_points(trajectory, LIMITS, unmapped(len(LIMITS.names)))


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


def most_memory(count):
    """Return what checking a goal and preparing its first message allocate at most, bytes."""
    times = 0.004 * np.arange(count)
    trajectory = plan(times, 0.1 * (1.0 - np.cos(2.0 * np.pi * times / times[-1])))
    link = Link('none', '127.0.0.1', 1, on_packet=lambda _: None, on_state=lambda *_: None)
    delivery = Streaming(link, LIMITS, unmapped(JOINTS), DeliveryRules())
    tracemalloc.start()
    checked_goal(Goal(trajectory, np.full(JOINTS, 0.01), 0.0), LIMITS)
    assert delivery.prepare(trajectory, HOME).messages[0].sequence == 0
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return most


@pytest.mark.invariant(7)
def test_inv7_a_long_goal_needs_no_more_memory_for_its_first_point():
    """docs/invariants.md, 7: a message takes 500 bytes."""
    assert most_memory(10_000) - most_memory(4_000) < 30_000
