# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Moves from rest to rest, and stops: limits, straightness and end point."""

import warnings
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from support.examples import examples

from epson_driver.motion import Array, JointLimits, LineMotion, go
from epson_driver.motion.joint_motion import JointMotion, stop_joints
from epson_driver.robots import load_robot_model

LIMITS = load_robot_model('c3_a601s').limits
LOW, HIGH = LIMITS.position_min, LIMITS.position_max
JOINTS = len(LIMITS.names)
ROUNDING = 1e-9
"""Relative rounding error of a limit in float64."""


@dataclass(frozen=True)
class Motion:
    """Samples of a motion at about 1 kHz. Arrays have the shape (samples, joints)."""

    times: Array
    positions: Array
    velocities: Array
    accelerations: Array


def sampled(motion: LineMotion) -> Motion:
    """Sample every ms, 50 to 1500 times, including the end."""
    count = int(np.clip(motion.duration / 1e-3, 50, 1500))
    times = np.linspace(0.0, motion.duration, count + 1)
    states = [motion.at(time) for time in times]
    return Motion(times, *(np.array(column) for column in zip(*states, strict=True)))


def check_limits(
    motion: LineMotion, limits: JointLimits, speed: float, accel: float, scale: float
) -> None:
    """Assert velocity, acceleration and jerk limits, and consistency of the derivatives.

    `scale`: largest value whose rounding, divided by the step, affects differences of samples.
    """
    samples = sampled(motion)
    slack = 1.0 + ROUNDING
    assert np.all(np.abs(samples.velocities) <= speed * limits.velocity * slack)
    assert np.all(np.abs(samples.accelerations) <= accel * limits.acceleration * slack)
    if motion.duration < 1e-9:
        return  # too short for differences
    step = samples.times[1]
    rounding = 1e-13 * scale / step
    jerks = np.diff(samples.accelerations, axis=0) / step
    assert np.all(np.abs(jerks) <= accel * limits.jerk * slack + rounding)
    # Within a step the velocity differs from the mean of its ends by less than j·step².
    rates = np.diff(samples.positions, axis=0) / step
    means = (samples.velocities[1:] + samples.velocities[:-1]) / 2.0
    assert np.all(np.abs(rates - means) <= limits.jerk * step**2 + rounding)
    rates = np.diff(samples.velocities, axis=0) / step
    means = (samples.accelerations[1:] + samples.accelerations[:-1]) / 2.0
    assert np.all(np.abs(rates - means) <= limits.jerk * step + rounding)


def check_line(motion: LineMotion, start: Array, target: Array) -> None:
    """Assert that the motion proceeds on the line from start to target."""
    positions = sampled(motion).positions
    assert np.all(positions >= np.minimum(start, target) - 1e-14)
    assert np.all(positions <= np.maximum(start, target) + 1e-14)
    longest = int(np.argmax(np.abs(target - start)))
    progress = (positions[:, longest] - start[longest]) / (target[longest] - start[longest])
    line = start + progress[:, None] * (target - start)
    np.testing.assert_allclose(positions, line, rtol=0.0, atol=1e-14)
    length = abs(target[longest] - start[longest])
    assert np.all(np.diff(progress) * length >= -1e-14)


FRACTIONS = st.floats(0.0, 1.0)
PERCENTAGES = st.floats(0.01, 1.0)
STARTS = st.tuples(*[st.sampled_from([0.0, 1.0]) | FRACTIONS] * JOINTS).map(
    lambda shares: LOW + np.array(shares) * (HIGH - LOW)
)
STEPS = st.one_of(
    st.just(0.0),
    st.sampled_from([1e-12, -1e-12, 1e-9, -1e-8, 1e-6]),
    st.floats(-0.1, 0.1),
    st.floats(-15.0, 15.0),
)
TARGETS = st.tuples(*[STEPS] * JOINTS)
INSTANTS = FRACTIONS | st.sampled_from([1e-15, 1e-6, 0.5, 1.0 - 1e-9, 1.0 - 1e-15])


@pytest.mark.invariant(2)
@settings(max_examples=examples(60))
@given(start=STARTS, steps=TARGETS, speed=PERCENTAGES, accel=PERCENTAGES)
def test_inv2_move_stays_within_every_limit(
    start: Array, steps: tuple[float, ...], speed: float, accel: float
) -> None:
    target = np.clip(start + np.array(steps), LOW, HIGH)
    assume(np.max(np.abs(target - start)) >= 1e-9)
    motion = go(LIMITS, start, target, speed, accel)
    check_limits(motion, LIMITS, speed, accel, scale=200.0)
    check_line(motion, start, target)
    np.testing.assert_allclose(motion.at(0.0)[0], start, rtol=0.0, atol=0.0)
    for late in (motion.duration, motion.duration + 1.0, float('inf')):
        position, velocity, acceleration = motion.at(late)
        np.testing.assert_array_equal(position, target)
        assert not velocity.any()
        assert not acceleration.any()


@pytest.mark.invariant(3)
@settings(max_examples=examples(60))
@given(
    start=STARTS,
    steps=TARGETS,
    speed=PERCENTAGES,
    accel=PERCENTAGES,
    instant=INSTANTS,
    again=INSTANTS,
)
def test_inv3_stop_at_any_time_stays_on_the_line_within_the_limits(
    start: Array,
    steps: tuple[float, ...],
    speed: float,
    accel: float,
    instant: float,
    again: float,
) -> None:
    target = np.clip(start + np.array(steps), LOW, HIGH)
    assume(np.max(np.abs(target - start)) >= 1e-9)
    moving = go(LIMITS, start, target, speed, accel)
    time = instant * moving.duration
    for _ in range(2):  # a stop can be stopped, too
        stop = moving.stop(time)
        for before, after in zip(moving.at(time), stop.at(0.0), strict=True):
            np.testing.assert_allclose(after, before, rtol=1e-12, atol=1e-14)
        check_limits(stop, LIMITS, 1.0, 1.0, scale=200.0)
        check_line(stop, start, target)
        end, velocity, acceleration = stop.at(stop.duration)
        assert not velocity.any()
        assert not acceleration.any()
        assert np.all((end >= LOW - 1e-14) & (end <= HIGH + 1e-14))
        np.testing.assert_array_equal(end, stop.at(stop.duration + 1.0)[0])
        assert stop.duration <= max(moving.duration - time, 0.0) + 1e-7
        moving, time = stop, again * stop.duration


def one_joint(step: float, joint: int = 0) -> tuple[Array, Array]:
    start = np.zeros(JOINTS)
    target = start.copy()
    target[joint] = step
    return start, target


def ramp(v: float, a: float, j: float) -> float:
    """Return the shortest time between rest and velocity v, with limits a and j."""
    return 2.0 * float(np.sqrt(v / j)) if v < a**2 / j else v / a + a / j


@pytest.mark.parametrize('speed', [1.0, 0.5, 0.1])
@pytest.mark.parametrize('accel', [1.0, 0.5])
@pytest.mark.parametrize('joint', range(JOINTS))
def test_long_move_takes_the_shortest_time(joint: int, accel: float, speed: float) -> None:
    limits = JointLimits(
        LIMITS.names, LOW - 20.0, HIGH + 20.0, LIMITS.velocity, LIMITS.acceleration, LIMITS.jerk
    )
    v = speed * limits.velocity[joint]
    a = accel * limits.acceleration[joint]
    j = accel * limits.jerk[joint]
    motion = go(limits, *one_joint(-20.0, joint), speed, accel)
    assert motion.duration == pytest.approx(20.0 / v + ramp(v, a, j), rel=1e-9)
    _, velocity, _ = motion.at(motion.duration / 2.0)
    assert velocity[joint] == pytest.approx(-v)


@pytest.mark.invariant(3)
def test_inv3_stop_from_full_speed_takes_the_shortest_time() -> None:
    motion = go(LIMITS, *one_joint(2.9), speed=0.5)
    stop = motion.stop(motion.duration / 2.0)
    v, a, j = 0.5 * LIMITS.velocity[0], LIMITS.acceleration[0], LIMITS.jerk[0]
    assert motion.at(motion.duration / 2.0)[1][0] == pytest.approx(v)
    assert stop.duration == pytest.approx(ramp(v, a, j))


def test_slowest_joint_sets_the_common_duration() -> None:
    start = np.zeros(JOINTS)
    target = np.array([1.0, 0.01, -0.02, 0.03, -0.04, 0.05])
    motion = go(LIMITS, start, target)
    assert motion.duration == go(LIMITS, *one_joint(1.0)).duration
    position, velocity, _ = motion.at(motion.duration / 2.0)
    np.testing.assert_allclose(position, target / 2.0, atol=1e-12)
    assert np.all(velocity * target > 0.0)


@pytest.mark.parametrize('step', [0.0, 1e-12, -9e-10])
def test_move_shorter_than_the_minimum_is_no_move(step: float) -> None:
    start, target = one_joint(step)
    motion = go(LIMITS, start, target)
    for rest in (motion, motion.stop(0.0), motion.stop(1.0)):
        assert rest.duration == 0.0
        position, velocity, acceleration = rest.at(0.0)
        np.testing.assert_array_equal(position, target)
        assert not velocity.any()
        assert not acceleration.any()


@pytest.mark.invariant(2)
@settings(max_examples=examples(30))
@given(tiny=st.floats(-1e-8, 1e-8), instant=INSTANTS)
@example(tiny=1e-12, instant=0.5)
@example(tiny=-1e-12, instant=0.5)
@example(tiny=5e-324, instant=0.5)
def test_inv2_tiny_move_of_one_joint_does_not_delay_the_others(
    tiny: float, instant: float
) -> None:
    start, target = one_joint(1.0)
    alone = go(LIMITS, start, target).duration
    target[5] = tiny
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        motion = go(LIMITS, start, target)
        stop = motion.stop(instant * motion.duration)
    assert motion.duration == alone
    for moving in (motion, stop):
        check_limits(moving, LIMITS, 1.0, 1.0, scale=200.0)
        check_line(moving, start, target)


@pytest.mark.invariant(3)
def test_inv3_stop_of_a_resting_arm_causes_no_motion() -> None:
    start, target = one_joint(1.0)
    motion = go(LIMITS, start, target)
    for time, where in ((0.0, start), (-1.0, start), (motion.duration, target), (99.0, target)):
        stop = motion.stop(time)
        assert stop.duration == 0.0
        np.testing.assert_array_equal(stop.at(0.0)[0], where)


@pytest.mark.invariant(2)
def test_inv2_motion_is_independent_of_later_array_changes() -> None:
    start, target = one_joint(1.0)
    motion = go(LIMITS, start, target)
    start[:], target[:] = 99.0, -99.0
    motion.at(motion.duration)[0][:] = 77.0
    assert motion.at(0.0)[0].tolist() == [0.0] * JOINTS
    assert motion.at(motion.duration)[0].tolist() == [1.0] + [0.0] * 5


def test_move_may_return_from_outside_the_position_limits() -> None:
    start = HIGH.copy()
    start[1] += 0.1
    motion = go(LIMITS, start, HIGH)
    assert motion.duration > 0.0
    np.testing.assert_array_equal(motion.at(motion.duration)[0], HIGH)


@pytest.mark.invariant(2)
@pytest.mark.parametrize('joint', range(JOINTS))
@pytest.mark.parametrize('limit', [LOW, HIGH], ids=['min', 'max'])
def test_inv2_target_at_a_limit_is_accepted_and_beyond_rejected(limit: Array, joint: int) -> None:
    start, target = one_joint(limit[joint], joint)
    assert go(LIMITS, start, target).at(99.0)[0][joint] == limit[joint]
    target[joint] = np.nextafter(limit[joint], 99.0 * np.sign(limit[joint]))
    with pytest.raises(ValueError, match=f'^joint_{joint + 1}: target .* is outside the limits'):
        go(LIMITS, start, target)


@pytest.mark.parametrize('value', [0.0, -0.1, 1.0001, float('nan'), float('inf')])
@pytest.mark.parametrize('name', ['speed', 'accel'])
def test_fraction_outside_its_range_is_rejected(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=rf'^{name} = {value}: must be in \(0, 1\]$'):
        go(LIMITS, *one_joint(1.0), **{name: value})


@pytest.mark.parametrize('name', ['start', 'target'])
def test_vector_of_wrong_length_or_not_finite_is_rejected(name: str) -> None:
    vectors = dict(zip(('start', 'target'), one_joint(1.0), strict=True))
    for short in (np.zeros(5), np.zeros(7), np.zeros((1, 6))):
        with pytest.raises(ValueError, match=f'^{name}: {short.size} values for 6 joints$'):
            go(LIMITS, **(vectors | {name: short}))
    for value in (float('nan'), float('inf'), -float('inf')):
        bad = np.array([0.0, 0.0, value, 0.0, 0.0, 0.0])
        with pytest.raises(ValueError, match=rf'^{name} = \[0.0, 0.0, {value}.*\]: not finite$'):
            go(LIMITS, **(vectors | {name: bad}))


# ---- start of the deceleration, and the pieces of a move


@settings(max_examples=examples(60))
@given(start=STARTS, steps=TARGETS, speed=PERCENTAGES, accel=PERCENTAGES)
def test_deceleration_starts_at_the_highest_speed(
    start: Array, steps: tuple[float, ...], speed: float, accel: float
) -> None:
    target = np.clip(start + np.array(steps), LOW, HIGH)
    assume(np.max(np.abs(target - start)) >= 1e-6)
    motion = go(LIMITS, start, target, speed, accel)
    assert 0.0 < motion.braking < motion.duration
    speeds = [np.abs(motion.at(time)[1]).max() for time in np.linspace(0, motion.duration, 201)]
    fastest = np.abs(motion.at(motion.braking)[1]).max()
    assert fastest >= max(speeds) * (1.0 - 1e-9)
    braking = np.linspace(motion.braking, motion.duration, 101)
    slower = [np.abs(motion.at(time)[1]).max() for time in braking]
    assert np.all(np.diff(slower) <= 1e-12)
    assert slower[1] < fastest


def test_pieces_of_constant_jerk_reproduce_the_motion() -> None:
    motion = go(LIMITS, *one_joint(1.3, joint=2), speed=0.4, accel=0.7)
    pieces = motion.pieces
    assert pieces.times[-1] == pytest.approx(motion.duration)
    for time, s, v, a in zip(
        pieces.times, pieces.distances, pieces.velocities, pieces.accelerations, strict=True
    ):
        position, velocity, acceleration = motion.at(time)
        assert position[2] == pytest.approx(s, abs=1e-12)
        assert velocity[2] == pytest.approx(v, abs=1e-9)
        assert acceleration[2] == pytest.approx(a, abs=1e-7)
    start, target = one_joint(0.0)
    assert go(LIMITS, start, target).braking == 0.0
    with pytest.raises(ValueError, match='no pieces'):
        _ = go(LIMITS, start, target).pieces


# ---- independent stops of the joints


def check_stop(stop: JointMotion, state: tuple[Array, Array, Array]) -> None:
    """Assert that a stop starts in a state, respects the limits, and ends at rest."""
    for now, before in zip(stop.at(0.0), state, strict=True):
        np.testing.assert_allclose(now, before, rtol=1e-12, atol=1e-12)
    times = np.linspace(0.0, stop.duration, 400)
    p, v, a = (np.array(column) for column in zip(*[stop.at(time) for time in times], strict=True))
    slack = 1.0 + 1e-9
    assert np.all((p >= LOW - 1e-11) & (p <= HIGH + 1e-11))
    assert np.all(np.abs(v) <= LIMITS.velocity * slack)
    assert np.all(np.abs(a) <= LIMITS.acceleration * slack)
    jerks = np.abs(np.diff(a, axis=0)) / (times[1] - times[0])
    assert np.all(jerks <= LIMITS.jerk * slack + 1e-6)
    end, velocity, acceleration = stop.at(stop.duration)
    np.testing.assert_array_equal(end, stop.end)
    assert not velocity.any()
    assert not acceleration.any()


@pytest.mark.invariant(3)
def test_inv3_every_joint_stops_as_fast_as_possible() -> None:
    velocity = 0.8 * LIMITS.velocity * [1, -1, 1, -1, 1, 0]
    state = ((LOW + HIGH) / 2.0, velocity, np.zeros(JOINTS))
    stop = stop_joints(LIMITS, state)
    check_stop(stop, state)
    times = [
        ramp(abs(v), a, j)
        for v, a, j in zip(velocity, LIMITS.acceleration, LIMITS.jerk, strict=True)
    ]
    assert stop.duration == pytest.approx(max(times))
    assert stop.end[5] == state[0][5]


@pytest.mark.invariant(3)
@pytest.mark.parametrize('side', [-1.0, 1.0])
@pytest.mark.parametrize('share', [0.02, 0.1, 0.3])
def test_inv3_joint_that_cannot_stop_before_its_limit_returns(share: float, side: float) -> None:
    # With full braking, joint 1 reverses at its limit, because it is too fast to stop there.
    limit = HIGH if side > 0 else LOW
    fastest = share * LIMITS.velocity[0]
    room = fastest**2 / (2.0 * LIMITS.acceleration[0]) + 1e-6
    position, velocity, acceleration = (np.zeros(JOINTS) for _ in range(3))
    position[0] = limit[0] - side * room
    velocity[0], acceleration[0] = side * fastest, -side * LIMITS.acceleration[0]
    state = position, velocity, acceleration
    stop = stop_joints(LIMITS, state)
    check_stop(stop, state)
    assert stop.duration < 2.0
    assert abs(stop.end[0] - limit[0]) < 0.6
