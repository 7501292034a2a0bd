# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The tracker of setpoints: limits by exact extrema, rest at the end, braking, lag."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.examples import examples

from benchmark.exact_extrema import exact_extrema
from epson_driver.motion.joint_motion import JointMotion, fastest_move, fastest_stop
from epson_driver.motion.setpoint_tracker import (
    RETURN_S,
    ServoTarget,
    SetpointTracker,
    servo_limits,
    stopping_distance,
)
from epson_driver.robots import load_robot_model

WHOLE = load_robot_model('c3_a601s').limits
LIMITS = servo_limits(WHOLE, 0.25, 0.3)
N = len(LIMITS.names)
HOME = np.zeros(N)
PERIOD = 0.02
SLACK = 1.0 + 1e-6


def pose(*values):
    return np.array([*values, *[0.0] * (N - len(values))])


class Run:
    """A tracker whose executed motion is recorded."""

    def __init__(self):
        self.tracker = SetpointTracker(LIMITS, HOME)
        self.executed, self.now = [], 0.0
        self.last = self.tracker.state

    def step(self, dt=PERIOD):
        """Step, and assert that the motion continues without a jump."""
        tracker = self.tracker
        for before, now in zip(self.last, tracker.state, strict=True):
            np.testing.assert_allclose(now, before, rtol=0.0, atol=1e-9)
        if not self.executed or tracker.motion is not self.executed[-1][1]:
            self.executed.append((self.now - tracker.time, tracker.motion))
        self.last = tracker.step(dt)
        self.now += dt
        return self.last

    def rest(self):
        """Step until the tracker rests, and return its position."""
        while not self.tracker.at_rest:
            self.step()
        position, velocity, acceleration = self.last
        assert not velocity.any()
        assert not acceleration.any()
        return position

    def assert_kept(self, low=-np.inf, high=np.inf):
        """Assert all limits, and the bounds on positions, at every instant."""
        limits = replace(
            LIMITS,
            position_min=np.maximum(LIMITS.position_min, low),
            position_max=np.minimum(LIMITS.position_max, high),
        )
        run = SimpleNamespace(executed=self.executed, now=self.now, limits=limits)
        extrema = exact_extrema(run, HOME)
        assert extrema.worst <= SLACK
        assert extrema.outside <= 1e-9


def aim(position, velocity=HOME, acceleration=HOME, low=-np.inf, high=np.inf):
    """Return an aim without bounds, except `low` and `high`."""
    return ServoTarget(position, velocity, acceleration, np.full(N, low), np.full(N, high))


POSITIONS = st.lists(st.floats(-4.0, 4.0), min_size=N, max_size=N).map(np.array)
SMALL = st.lists(st.floats(-0.05, 0.05), min_size=N, max_size=N).map(np.array)
VELOCITIES = st.lists(st.floats(-10.0, 10.0), min_size=N, max_size=N).map(np.array)
HUGE = st.lists(st.floats(-1e6, 1e6), min_size=N, max_size=N).map(np.array)
SHARES = st.one_of(st.just(1.0), st.lists(st.floats(1e-3, 1.0), min_size=N, max_size=N))
EVENTS = st.one_of(
    st.tuples(st.just('far'), POSITIONS),
    st.tuples(st.just('near'), SMALL),
    st.tuples(st.just('fed forward'), st.tuples(SMALL, VELOCITIES, HUGE)),
    st.tuples(st.just('walls'), st.tuples(SMALL, VELOCITIES, SMALL)),
    st.tuples(st.just('move'), VELOCITIES),
    st.tuples(st.just('release'), st.just(None)),
    st.tuples(st.just('brake'), st.one_of(st.none(), SMALL)),
)
STEPS = st.one_of(st.just(PERIOD), st.floats(0.001, 0.2), st.floats(0.5, 2.0))
LATE = st.one_of(st.just(1.0), st.just(0.0), st.floats(1e-6, 3.0))
"""Actual duration of a step, as a multiple of the planned one."""


@pytest.mark.invariant(2)
@given(st.lists(st.tuples(EVENTS, STEPS, LATE, SHARES), min_size=1, max_size=40))
@settings(max_examples=examples(200))
def test_inv2_any_stream_respects_every_limit_and_ends_at_rest(events):
    """Exact extrema are checked between the steps, for any sequence of events."""
    run = Run()
    for (kind, value), dt, late, speed in events:
        tracker, here = run.tracker, run.last[0]
        speed = np.array(speed)
        if kind == 'far':
            tracker.follow(dt, aim(value), speed)
        elif kind == 'near':
            tracker.follow(dt, aim(here + value), speed)
        elif kind == 'fed forward':
            tracker.follow(dt, aim(here + value[0], *value[1:]), speed)
        elif kind == 'walls':
            place, velocity, wall = value
            low, high = here + np.minimum(wall, 0.0), here + np.maximum(wall, 0.0)
            tracker.follow(dt, ServoTarget(here + place, velocity, HOME, low, high), speed)
        elif kind == 'move':
            tracker.move(dt, value)
        elif kind == 'release':
            tracker.move(dt, HOME)
        else:
            tracker.brake(None if value is None else here + value)
            assert tracker.remaining <= 1.25 * stop_time(run) + RETURN_S
        run.step(dt * late)
    run.tracker.brake()
    run.rest()
    run.assert_kept()


def stop_time(run):
    """Return an upper bound for the duration of a stop, s."""
    limits = run.tracker.limits
    longest = limits.velocity / limits.acceleration + 2.0 * limits.acceleration / limits.jerk
    return float(longest.max()) * 3.0  # includes a return at the end of the range


@pytest.mark.invariant(2)
@given(st.lists(st.tuples(SMALL, VELOCITIES, st.floats(0.004, 0.1)), min_size=1, max_size=30))
@settings(max_examples=examples(100))
def test_inv2_positions_shown_by_the_stream_are_not_exceeded(aims):
    """From rest, no joint exceeds constant bounds, for any aims."""
    run, walls = Run(), np.full(N, 0.03)
    for position, velocity, dt in aims:
        run.tracker.follow(dt, ServoTarget(position, velocity, HOME, -walls, walls))
        run.step(dt)
    run.rest()
    run.assert_kept(-walls, walls)


def test_joint_with_a_tiny_velocity_can_reverse():
    """Its reversal was once computed from a difference that rounding made 0."""
    run, still = Run(), np.zeros((N, 1))
    state = HOME, pose(-1.1137833119019889e-26), pose(-0.0013652513950752798)
    run.tracker.motion = JointMotion(state, np.ones((N, 1)), still)
    run.last = run.tracker.state
    for _ in range(5):
        run.tracker.follow(0.1, aim(pose(0.1), low=-1.2e-3, high=1.2e-3))
        run.step(0.1)
    run.rest()
    run.assert_kept()


def go_to(run, position, seconds):
    """Follow a constant position between 0 and it."""
    for _ in range(round(seconds / PERIOD)):
        low, high = np.minimum(position, 0.0), np.maximum(position, 0.0)
        run.tracker.follow(PERIOD, ServoTarget(position, HOME, HOME, low, high))
        run.step()


def test_tracker_rests_exactly_at_the_last_setpoint():
    run = Run()
    for count in range(1, 40):
        place = pose(0.01 * count, -0.004 * count)
        run.tracker.follow(PERIOD, aim(place, pose(0.5, -0.2), HOME, -0.156, 0.39))
        run.step()
    go_to(run, place, 1.0)
    assert run.tracker.at_rest
    np.testing.assert_allclose(run.rest(), pose(0.39, -0.156), rtol=0.0, atol=1e-9)
    run.assert_kept(high=np.append(0.39, LIMITS.position_max[1:]))


def test_braking_far_from_the_setpoint_ends_without_reaching_it():
    run = Run()
    go_to(run, pose(2.0), 0.4)
    speed = run.last[1][0]
    run.tracker.brake(pose(2.0))
    assert run.rest()[0] < run.last[0][0] + 1.01 * stopping_distance(LIMITS, pose(speed))[0]
    assert run.last[0][0] < 1.0


@pytest.mark.parametrize('speed', [0.02, 0.1, 0.4, 1.2])
def test_braking_soon_ends_exactly_at_the_followed_setpoint(speed):
    """The arm is 36 ms and a stop ahead of the setpoint, so it returns."""
    run, velocity = Run(), pose(speed, -speed / 2.0, 0.0, speed / 3.0)
    for count in range(30):
        run.tracker.follow(PERIOD, aim(PERIOD * count * velocity, velocity))
        run.step()
    last = run.last[0] - 0.036 * velocity
    stop = fastest_stop(LIMITS, run.last).duration
    run.tracker.brake(last)
    assert stop < run.tracker.remaining <= stop + RETURN_S
    np.testing.assert_allclose(run.rest(), last, rtol=0.0, atol=1e-9)
    run.assert_kept()


def test_return_to_the_last_setpoint_respects_the_speed_scaling():
    run, fraction, back = Run(), 0.02, []
    fastest = fraction * LIMITS.velocity[0]
    for count in range(30):
        run.tracker.follow(PERIOD, aim(pose(PERIOD * fastest * count), pose(fastest)), fraction)
        run.step()
    run.tracker.brake(run.last[0] - pose(0.003), fraction)
    while not run.tracker.at_rest:
        back.append(-float(run.step(0.004)[1][0]))
    assert 0.9 * fastest < max(back) <= SLACK * fastest


def test_move_ends_at_its_target_although_ruckig_misses_it():
    """Ruckig misses some of 1,000 targets by up to 1e-8 rad."""
    random, result = np.random.default_rng(0), 0
    for _ in range(1000):
        velocity, acceleration = random.uniform(-0.5, 0.5, (2, N))
        state = HOME, velocity * LIMITS.velocity, acceleration * LIMITS.acceleration
        target = random.uniform(-0.1, 0.1, N)
        motion = fastest_move(LIMITS, state, target)
        result += motion is not None and np.abs(motion.end - target).max() < 1e-9
    assert result == 1000


@pytest.mark.invariant(2)
def test_inv2_continued_velocity_rests_at_the_end_of_the_range():
    run = Run()
    for _ in range(400):
        run.tracker.move(PERIOD, pose(1.5, -1.5))
        run.step()
    position = run.rest()
    assert position[0] == pytest.approx(LIMITS.position_max[0], abs=1e-6)
    assert position[1] == pytest.approx(LIMITS.position_min[1], abs=1e-6)
    run.assert_kept()


def test_commanded_velocities_are_reached_and_reduced():
    run = Run()
    for speed in (1.0, 0.2, -0.5):
        for _ in range(30):
            run.tracker.move(PERIOD, pose(speed))
            run.step()
        assert run.last[1][0] == pytest.approx(speed, rel=1e-6)
    run.assert_kept()


def test_steady_stream_is_followed_without_lag_or_jerk():
    run = Run()
    for count in range(1, 60):
        run.tracker.follow(PERIOD, aim(pose(0.01 * count), pose(0.5)))
        run.step()
    assert run.last[0][0] == pytest.approx(0.59, abs=1e-5)
    assert abs(run.tracker.motion.jerks[0, 0]) < 1e-3 * LIMITS.jerk[0]


def test_servo_limits_are_scaled_and_allow_a_stop_in_time():
    limits = servo_limits(WHOLE, 0.25, 10.0)
    np.testing.assert_allclose(limits.velocity, 0.25 * WHOLE.velocity)
    np.testing.assert_allclose(limits.jerk, 0.25 * WHOLE.jerk)
    short = servo_limits(WHOLE, 1.0, 0.1)
    distance = stopping_distance(WHOLE, short.velocity)
    np.testing.assert_allclose(2.0 * distance / short.velocity, 0.1, rtol=1e-6)


@pytest.mark.parametrize('start', [[9.0] * N, [math.nan] * N, [0.0] * (N - 1)])
def test_start_outside_the_range_is_rejected(start):
    with pytest.raises(ValueError, match='start ='):
        SetpointTracker(LIMITS, np.array(start))
