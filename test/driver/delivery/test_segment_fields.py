# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Velocity and duration of every segment: each fault that earlier clients had, by name.

industrial_robot_client and its ports, as their sources and runs show them.
"""

import numpy as np
import pytest

from epson_driver.driver.delivery.download import download_sequences
from epson_driver.driver.delivery.trajectory_points import (
    FIRST_POINT_VELOCITY_FRACTION,
    MIN_DURATION_S,
    START_MARGIN_RAD,
    from_standing,
    full_points,
    trajectory_points,
    with_velocities,
)
from epson_driver.motion import Trajectory
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
    for point in trajectory_points(trajectory, start, LIMITS):
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
    points = trajectory_points(plan([0.0, 0.5, 1.0], [0.0, 0.2, 0.3]), HOME, LIMITS)
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
    points = full_points(trajectory, LIMITS)
    assert [point.time for point in points] == [0.0, 0.004, 0.3]
    assert [point.velocities[0] for point in points] == [0.0, 0.5, 0.0]
    assert {(point.robot_id, point.valid_fields) for point in points} == {(0, 7)}
    with pytest.raises(ValueError, match='no velocities'):
        full_points(plan([0.0, 1.0], [0.0, 0.1]), LIMITS)


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
