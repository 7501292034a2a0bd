# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""An arm that follows setpoints: inside its limits, to rest in silence, and points after that."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.examples import examples

from epson_driver.robots import load_robot_model
from epson_driver.sim_controller.arm.executor import Point
from epson_driver.sim_controller.arm.following import SILENCE_S, Following
from epson_driver.sim_controller.arm.low_power import LowPower
from epson_driver.sim_controller.arm.point_to_point import PointToPoint

MODEL = load_robot_model('c3_a601s')
LIMITS = MODEL.limits
HOME = np.zeros(6)
CYCLE = 0.004
CAPS = LowPower(0.05, 0.25, MODEL.reach)
SLACK = 1.0 + 2e-6


def joint_1(value):
    return np.array([value, 0.0, 0.0, 0.0, 0.0, 0.0])


class Run:
    """An arm in its cycles, judged by the whole motions that it executes."""

    def __init__(self):
        self.arm = Following(PointToPoint(LIMITS, HOME), CAPS.limits(LIMITS))
        self.ways = []

    def run(self, seconds, limits=LIMITS):
        for _ in range(round(seconds / CYCLE)):
            tracker = self.arm.tracker
            if tracker is not None:
                assert tracker.motion.within(limits)  # exact extrema, to its rest
            self.arm.step(CYCLE)
            self.ways.append(self.arm.position)

    def stream(self, way, seconds, period=0.02, velocity=None):
        """Send way(t) each period for some seconds."""
        for count in range(round(seconds / period)):
            t = count * period
            speed = HOME if velocity is None else joint_1(velocity(t))
            self.arm.follow(joint_1(way(t)), speed)
            self.run(period)

    def rest(self, most=5.0):
        time = 0.0
        while self.arm.moving:
            assert time < most
            self.run(CYCLE)
            time += CYCLE
        return time

    @property
    def at(self):
        return self.arm.position[0]


@pytest.fixture
def run():
    return Run()


def sine(t):
    return 0.2 * (1.0 - np.cos(np.pi * t))


def slope(t):
    return 0.2 * np.pi * np.sin(np.pi * t)


def lag_of(run, way):
    """Return the delay, s, that fits best, without the first half second."""
    times = (np.arange(len(run.ways)) + 1) * CYCLE
    late = times > 0.5
    ways = np.array([each[0] for each in run.ways])[late]
    lags = np.arange(-0.02, 0.2, 0.002)
    errors = [np.square(ways - way(times[late] - lag)).mean() for lag in lags]
    return lags[int(np.argmin(errors))]


def test_positions_are_followed_with_little_lag_and_with_velocities_with_next_to_none(run):
    run.stream(sine, 2.5)
    assert lag_of(run, sine) < 0.1
    with_velocities = Run()
    with_velocities.stream(sine, 2.5, velocity=slope)
    assert lag_of(with_velocities, sine) < 0.02


@pytest.mark.invariant(3)
def test_inv3_silence_rests_exactly_at_the_last_position(run):
    run.stream(lambda t: 0.4 * t, 1.0)
    run.rest()
    assert run.at == pytest.approx(0.4 * 0.98, abs=1e-6)


@pytest.mark.invariant(3)
@pytest.mark.parametrize('moment', [0.1, 0.26, 0.5, 0.74, 0.98])
def test_inv3_silence_with_a_velocity_brakes_on_the_spot(run, moment):
    run.stream(sine, moment, velocity=slope)
    before = abs(run.arm.velocity[0])
    assert run.rest() < SILENCE_S + 0.4
    last = sine(moment - 0.02)
    assert abs(run.at - last) < 0.05 + 0.2 * before
    assert not run.arm.following


@pytest.mark.invariant(2)
@settings(max_examples=examples(20), deadline=None)
@given(st.data())
def test_inv2_whatever_is_sent_and_stopped_the_limits_are_kept(data):
    run = Run()
    number = st.floats(-4.0, 4.0)
    for _ in range(data.draw(st.integers(1, 12))):
        what = data.draw(st.sampled_from(['setpoint', 'setpoint', 'silence', 'stop', 'hold']))
        if what == 'setpoint' and run.arm.ready:
            target = np.array(data.draw(st.lists(number, min_size=6, max_size=6)))
            speed = np.array(data.draw(st.lists(number, min_size=6, max_size=6)))
            run.arm.follow(np.clip(target, LIMITS.position_min, LIMITS.position_max), speed)
        elif what == 'stop':
            run.arm.stop()
        elif what == 'hold':
            run.arm.hold()
            run.arm.resume()
        run.run(data.draw(st.sampled_from([0.004, 0.02, 0.1, 0.3])))
    run.arm.stop()
    run.rest()
    ways = np.array(run.ways)
    assert np.all(ways >= LIMITS.position_min)
    assert np.all(ways <= LIMITS.position_max)
    assert np.all(np.abs(np.diff(ways, axis=0)) <= LIMITS.velocity * CYCLE * SLACK)


@pytest.mark.invariant(3)
@pytest.mark.parametrize('end', ['stop', 'hold'])
def test_inv3_a_stop_or_a_hold_ends_the_stream(run, end):
    run.stream(lambda t: 0.6 * t, 0.5, velocity=lambda _t: 0.6)
    getattr(run.arm, end)()
    assert not run.arm.ready
    run.rest()
    rests = run.at
    assert run.arm.ready == (end == 'stop')
    run.arm.resume()
    run.run(1.0)
    assert run.at == rests
    assert run.arm.ready


def test_points_wait_until_the_arm_rests_and_begin_there(run):
    run.stream(lambda t: 0.5 * t, 0.4)
    assert not run.arm.has_room
    run.rest()
    assert run.arm.has_room
    run.arm.take(Point(0, joint_1(0.4), 1.0, 0.0))
    assert not run.arm.ready
    run.rest()
    assert run.at == pytest.approx(0.4)


def test_while_points_are_executed_no_setpoint_is_taken(run):
    run.arm.take(Point(0, joint_1(0.4), 1.0, 0.0))
    run.run(0.1)
    assert not run.arm.ready
    with pytest.raises(RuntimeError):
        run.arm.settle(HOME)


@pytest.mark.invariant(2)
def test_inv2_the_arm_uses_its_share_of_the_limits_also_to_catch_up(run):
    """As after a time in which the sender was held up: the target has gone on."""
    share = 0.25
    for way in (0.05, 0.5, 0.5, 0.5, 0.5, 0.5):
        run.arm.follow(joint_1(way), joint_1(1.0), share)
        run.run(0.02)
    run.arm.follow(joint_1(0.5), HOME, share)
    run.rest()
    steps = np.abs(np.diff([each[0] for each in run.ways]))
    assert steps.max() <= share * LIMITS.velocity[0] * CYCLE * SLACK
    assert run.at == pytest.approx(0.5, abs=1e-6)


@pytest.mark.invariant(2)
def test_inv2_at_low_power_the_low_limits_hold(run):
    run.arm.low_power = True
    low = CAPS.limits(LIMITS)
    for _ in range(50):
        run.arm.follow(joint_1(0.09), HOME)
        run.run(0.02, low)
    assert np.abs(np.diff([each[0] for each in run.ways])).max() <= low.velocity[0] * CYCLE * SLACK


def test_speed_and_acceleration_are_those_of_its_points(run):
    run.arm.speed, run.arm.accel = 0.25, 0.5
    assert (run.arm.speed, run.arm.accel) == (0.25, 0.5)
    run.arm.take(Point(0, joint_1(1.0), 0.0, 0.0))
    run.rest()
    fastest = np.abs(np.diff([way[0] for way in run.ways])).max() / CYCLE
    assert fastest == pytest.approx(0.25 * LIMITS.velocity[0], rel=0.01)
    with pytest.raises(ValueError, match='speed'):
        run.arm.speed = 1.5


def test_an_arm_that_follows_is_not_moved_by_hand(run):
    run.stream(lambda t: 0.2 * t, 0.2)
    with pytest.raises(RuntimeError, match='the arm follows setpoints'):
        run.arm.settle(joint_1(0.5))
    run.rest()
