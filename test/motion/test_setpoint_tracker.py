# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The tracker of setpoints: limits by exact extrema, rest at the end, braking, lag."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.examples import examples

from epson_driver.motion.joint_motion import JointMotion, fastest_move, fastest_stop
from epson_driver.motion.setpoint_tracker import (
    RETURN_S,
    Aim,
    SetpointTracker,
    servo_limits,
    stopping_way,
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


class Usage:
    """The greatest share of each limit between two moments of a motion, by exact extrema."""

    def __init__(self, limits):
        self.limits = limits
        self.velocity = self.acceleration = self.jerk = 0.0
        self.low = np.full(N, np.inf)
        self.high = np.full(N, -np.inf)
        self.before = None

    def see(self, motion, begin, end):
        """Take a motion from `begin` to `end`, s."""
        for joint in range(N):
            times = motion.times[joint]
            for piece, jerk in enumerate(motion.jerks[joint]):
                first = max(begin, times[piece]) - times[piece]
                last = min(end, times[piece + 1]) - times[piece]
                if last > first:
                    state = [float(each[joint, piece]) for each in motion.states]
                    self._piece(joint, state, float(jerk), first, last)

    def _piece(self, joint, state, jerk, first, last):
        p, v, a = state

        def speed(t):
            return v + t * (a + t * jerk / 2)

        def place(t):
            return p + t * (v + t * (a / 2 + t * jerk / 6))

        limits = self.limits
        self.jerk = max(self.jerk, abs(jerk) / limits.jerk[joint])
        moments = [first, last]
        if jerk:
            moments.append(-a / jerk)
            root = a * a - 2 * jerk * v
            if root >= 0:
                moments += [(-a + sign * math.sqrt(root)) / jerk for sign in (1, -1)]
        elif a:
            moments.append(-v / a)
        inside = [t for t in moments if first <= t <= last]
        for t in inside:
            self.velocity = max(self.velocity, abs(speed(t)) / limits.velocity[joint])
            self.acceleration = max(
                self.acceleration, abs(a + jerk * t) / limits.acceleration[joint]
            )
            self.low[joint] = min(self.low[joint], place(t))
            self.high[joint] = max(self.high[joint], place(t))

    def assert_kept(self):
        assert self.velocity <= SLACK
        assert self.acceleration <= SLACK
        assert self.jerk <= SLACK
        assert np.all(self.low >= self.limits.position_min - 1e-9)
        assert np.all(self.high <= self.limits.position_max + 1e-9)


class Run:
    """A tracker whose every step is measured."""

    def __init__(self, start=HOME, limits=LIMITS):
        self.tracker = SetpointTracker(limits, start)
        self.usage = Usage(limits)
        self.last = self.tracker.state

    def step(self, dt=PERIOD):
        """Step; what is executed goes on from where it was, without a jump."""
        tracker = self.tracker
        for before, now in zip(self.last, tracker.state, strict=True):
            np.testing.assert_allclose(now, before, rtol=0.0, atol=1e-9)
        begin = tracker.time
        self.last = tracker.step(dt)
        self.usage.see(tracker.motion, begin, tracker.time)
        return self.last

    def rest(self):
        """Go on until it rests; return where."""
        while not self.tracker.at_rest:
            self.step()
        position, velocity, acceleration = self.last
        assert not velocity.any()
        assert not acceleration.any()
        return position


def aim(position, velocity=HOME, acceleration=HOME, low=-np.inf, high=np.inf):
    """Return an aim that may be passed, unless `low` or `high` say how far."""
    return Aim(position, velocity, acceleration, np.full(N, low), np.full(N, high))


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
LATE = st.one_of(st.just(1.0), st.floats(0.0, 3.0))
"""How many times the step that was planned passes before the next."""


@pytest.mark.invariant(2)
@given(st.lists(st.tuples(EVENTS, STEPS, LATE, SHARES), min_size=1, max_size=40))
@settings(max_examples=examples(200))
def test_inv2_any_stream_keeps_every_limit_at_every_instant_and_rests(events):
    """docs/invariants.md, 2 and 3: exact extrema between the steps, whatever comes when."""
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
            tracker.follow(dt, Aim(here + place, velocity, HOME, low, high), speed)
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
    run.usage.assert_kept()


def stop_time(run):
    """Return how long any stop takes at most from here, s: the longest there is."""
    limits = run.tracker.limits
    longest = limits.velocity / limits.acceleration + 2.0 * limits.acceleration / limits.jerk
    return float(longest.max()) * 3.0  # with a way back, at the end of the range


@pytest.mark.invariant(2)
@given(st.lists(st.tuples(SMALL, VELOCITIES, st.floats(0.004, 0.1)), min_size=1, max_size=30))
@settings(max_examples=examples(100))
def test_inv2_what_the_stream_has_shown_is_not_passed_where_a_stop_fits(aims):
    """Whatever the law wants: from rest, nothing passes walls that stay where they are."""
    run, walls = Run(), np.full(N, 0.03)
    for position, velocity, dt in aims:
        run.tracker.follow(dt, Aim(position, velocity, HOME, -walls, walls))
        run.step(dt)
    run.rest()
    run.usage.assert_kept()
    assert np.all(run.usage.low >= -walls - 1e-9)
    assert np.all(run.usage.high <= walls + 1e-9)


def test_a_joint_that_only_just_moves_turns_back():
    """Where it turns was sought by a difference that rounding made 0."""
    run, still = Run(), np.zeros((N, 1))
    state = HOME, pose(-1.1137833119019889e-26), pose(-0.0013652513950752798)
    run.tracker.motion = JointMotion(state, np.ones((N, 1)), still)
    run.last = run.tracker.state
    for _ in range(5):
        run.tracker.follow(0.1, aim(pose(0.1), low=-1.2e-3, high=1.2e-3))
        run.step(0.1)
    run.rest()
    run.usage.assert_kept()


def go_to(run, position, seconds):
    """Follow a position that stands, from joints that come from 0."""
    for _ in range(round(seconds / PERIOD)):
        low, high = np.minimum(position, 0.0), np.maximum(position, 0.0)
        run.tracker.follow(PERIOD, Aim(position, HOME, HOME, low, high))
        run.step()


def test_it_rests_exactly_at_the_last_setpoint():
    run = Run()
    for count in range(1, 40):
        place = pose(0.01 * count, -0.004 * count)
        run.tracker.follow(PERIOD, aim(place, pose(0.5, -0.2), HOME, -0.156, 0.39))
        run.step()
    go_to(run, place, 1.0)
    assert run.tracker.at_rest
    np.testing.assert_allclose(run.rest(), pose(0.39, -0.156), rtol=0.0, atol=1e-9)
    run.usage.assert_kept()
    assert run.usage.high[0] <= 0.39 + 1e-9  # never beyond it


def test_without_a_word_it_comes_to_rest():
    run = Run()
    go_to(run, pose(2.0), 0.4)
    assert run.tracker.remaining < 0.5
    assert run.rest()[0] < 1.0


def test_braking_far_from_the_setpoint_stops():
    run = Run()
    go_to(run, pose(2.0), 0.4)
    speed = run.last[1][0]
    run.tracker.brake(pose(2.0))
    assert run.rest()[0] < run.last[0][0] + 1.01 * stopping_way(LIMITS, pose(speed))[0]
    assert run.last[0][0] < 1.0


@pytest.mark.parametrize('speed', [0.02, 0.1, 0.4, 1.2])
def test_braking_ends_exactly_at_a_setpoint_that_was_followed_and_soon(speed):
    """The arm leads over the setpoint by 36 ms and a stop, so it comes back from beyond."""
    run, velocity = Run(), pose(speed, -speed / 2.0, 0.0, speed / 3.0)
    for count in range(30):
        run.tracker.follow(PERIOD, aim(PERIOD * count * velocity, velocity))
        run.step()
    last = run.last[0] - 0.036 * velocity
    stop = fastest_stop(LIMITS, run.last).duration
    run.tracker.brake(last)
    assert stop < run.tracker.remaining <= stop + RETURN_S
    np.testing.assert_allclose(run.rest(), last, rtol=0.0, atol=1e-9)
    run.usage.assert_kept()


def test_the_return_to_the_last_setpoint_keeps_to_the_speed_scaling():
    run, share, back = Run(), 0.02, []
    fastest = share * LIMITS.velocity[0]
    for count in range(30):
        run.tracker.follow(PERIOD, aim(pose(PERIOD * fastest * count), pose(fastest)), share)
        run.step()
    run.tracker.brake(run.last[0] - pose(0.003), share)
    while not run.tracker.at_rest:
        back.append(-float(run.step(0.004)[1][0]))
    assert 0.9 * fastest < max(back) <= SLACK * fastest


def test_a_move_ends_at_its_target_where_ruckig_misses_it_at_first():
    """From 1,000 moving states: it misses some by up to 1e-8 rad, which was no move at all."""
    random, found = np.random.default_rng(0), 0
    for _ in range(1000):
        velocity, acceleration = random.uniform(-0.5, 0.5, (2, N))
        state = HOME, velocity * LIMITS.velocity, acceleration * LIMITS.acceleration
        target = random.uniform(-0.1, 0.1, N)
        motion = fastest_move(LIMITS, state, target)
        found += motion is not None and np.abs(motion.end - target).max() < 1e-9
    assert found == 1000


@pytest.mark.invariant(2)
def test_inv2_a_velocity_that_goes_on_rests_at_the_end_of_the_range():
    run = Run()
    for _ in range(400):
        run.tracker.move(PERIOD, pose(1.5, -1.5))
        run.step()
    position = run.rest()
    assert position[0] == pytest.approx(LIMITS.position_max[0], abs=1e-6)
    assert position[1] == pytest.approx(LIMITS.position_min[1], abs=1e-6)
    run.usage.assert_kept()


def test_a_velocity_is_reached_and_a_smaller_one_too():
    run = Run()
    for speed in (1.0, 0.2, -0.5):
        for _ in range(30):
            run.tracker.move(PERIOD, pose(speed))
            run.step()
        assert run.last[1][0] == pytest.approx(speed, rel=1e-6)
    run.usage.assert_kept()


def test_a_steady_stream_is_followed_without_a_lag_or_jerk():
    run = Run()
    for count in range(1, 60):
        run.tracker.follow(PERIOD, aim(pose(0.01 * count), pose(0.5)))
        run.step()
    assert run.last[0][0] == pytest.approx(0.59, abs=1e-5)
    assert abs(run.tracker.motion.jerks[0, 0]) < 1e-3 * LIMITS.jerk[0]


def test_limits_are_a_share_and_never_too_fast_to_stop():
    limits = servo_limits(WHOLE, 0.25, 10.0)
    np.testing.assert_allclose(limits.velocity, 0.25 * WHOLE.velocity)
    np.testing.assert_allclose(limits.jerk, 0.25 * WHOLE.jerk)
    short = servo_limits(WHOLE, 1.0, 0.1)
    way = stopping_way(WHOLE, short.velocity)
    np.testing.assert_allclose(2.0 * way / short.velocity, 0.1, rtol=1e-6)


@pytest.mark.parametrize('start', [[9.0] * N, [math.nan] * N, [0.0] * (N - 1)])
def test_a_start_outside_the_range_is_refused(start):
    with pytest.raises(ValueError, match='start ='):
        SetpointTracker(LIMITS, np.array(start))
