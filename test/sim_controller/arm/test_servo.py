# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Servos and encoders: lag, limits and the final position."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.examples import examples

from epson_driver.motion import go
from epson_driver.robots import load_robot_model
from epson_driver.sim_controller.arm.simulated_arm import Servo

MODEL = load_robot_model('c3_a601s')
LIMITS = MODEL.limits
START = np.array([0.1, -0.2, 0.3, 0.4, -0.5, 0.6])
TARGET = np.array([0.5, -1.2, 1.3, -0.4, 0.5, 2.6])
DT = 0.004


def servo(lag=0.008, encoder=False, start=START):
    return Servo(start, MODEL.pulses_per_unit, lag, encoder)


def follow(one, motion, dt=DT, most=2.0):
    """Return commands, positions and velocities until the servo has settled."""
    rows = [(motion.at(0.0)[0], one.position, one.velocity)]
    for number in range(1, round((motion.duration + most) / dt)):
        command = motion.at(number * dt)[0]
        one.step(command, dt)
        rows.append((command, one.position, one.velocity))
        if one.settled:
            return [np.array(column) for column in zip(*rows, strict=True)]
    raise AssertionError('the servo does not settle')


def in_pulses(position):
    per_rad = MODEL.pulses_per_unit
    return np.rint(position * per_rad) / per_rad


def test_without_lag_and_encoder_the_position_is_the_command():
    one = servo(lag=0.0)
    commands, positions, velocities = follow(one, go(LIMITS, START, TARGET))
    np.testing.assert_array_equal(positions, commands)
    np.testing.assert_allclose(velocities[1:], np.diff(commands, axis=0) / DT)
    assert not velocities[-1].any()


@pytest.mark.parametrize('lag', [0.0, 0.002, 0.02])
@pytest.mark.parametrize('encoder', [False, True])
def test_servo_settles_exactly_at_the_command(lag, encoder):
    one = servo(lag, encoder)
    motion = go(LIMITS, START, TARGET)
    _, positions, velocities = follow(one, motion)
    assert one.settled
    np.testing.assert_array_equal(positions[-1], in_pulses(TARGET) if encoder else TARGET)
    assert not velocities[-1].any()
    assert len(positions) * DT < motion.duration + 15 * lag + 3 * DT


@pytest.mark.invariant(2)
@pytest.mark.parametrize('dt', [0.001, 0.004])
@pytest.mark.parametrize('lag', [0.001, 0.008, 0.05])
def test_inv2_no_derivative_exceeds_that_of_the_command(lag, dt):
    commands, positions, velocities = follow(servo(lag), go(LIMITS, START, TARGET), dt)
    for order in (1, 2, 3):
        asked, made = (
            np.abs(np.diff(column, order, axis=0)).max(axis=0) / dt**order
            for column in (commands, positions)
        )
        assert np.all(made <= asked * (1.0 + 1e-6) + 1e-14 / dt**order)
    assert np.all(np.abs(velocities) <= LIMITS.velocity)
    low, high = np.minimum(START, TARGET), np.maximum(START, TARGET)
    assert np.all((positions >= low) & (positions <= high))
    means = (velocities[1:] + velocities[:-1]) / 2.0
    np.testing.assert_allclose(np.diff(positions, axis=0) / dt, means, atol=dt / lag)


def test_position_is_one_lag_behind_at_constant_speed():
    one, speed = servo(lag=0.02), np.array([0.1, -0.2, 0.3, 0.0, 0.5, 1.0])
    for number in range(1, 200):
        one.step(START + speed * number * DT, DT)
    assert not one.settled
    np.testing.assert_allclose(one.position, START + speed * (199 * DT - 0.02), atol=1e-9)
    np.testing.assert_allclose(one.velocity, speed, atol=1e-9)


def test_step_size_does_not_change_a_linear_motion():
    fine, coarse = servo(lag=0.02), servo(lag=0.02)
    for number in range(1, 41):
        fine.step(START + 0.01 * number, 0.001)
    for number in range(1, 11):
        coarse.step(START + 0.04 * number, 0.004)
    np.testing.assert_allclose(fine.position, coarse.position, atol=1e-12)
    np.testing.assert_allclose(fine.velocity, coarse.velocity, atol=1e-9)


def test_encoders_report_whole_pulses():
    one = servo(encoder=True)
    _, positions, _ = follow(one, go(LIMITS, START, TARGET))
    pulses = positions * MODEL.pulses_per_unit
    np.testing.assert_allclose(pulses, np.rint(pulses), atol=1e-6)
    assert len(np.unique(pulses[:, 0])) > 50


def test_pushed_joint_returns_and_a_placed_joint_stays():
    one = servo(encoder=True)
    one.jump(START + 0.01)
    assert not one.settled
    for _ in range(100):
        one.step(START, DT)
    assert one.settled
    np.testing.assert_array_equal(one.actual, START)
    one.set_position(START + 0.01)
    assert one.settled
    one.freeze(0)
    np.testing.assert_array_equal(one.actual, START + 0.01)


def test_position_does_not_change_at_rest():
    one = servo(encoder=True)
    before = one.position
    for _ in range(3):
        one.step(START.copy(), DT)
    assert one.settled
    np.testing.assert_array_equal(one.position, before)
    assert not one.velocity.any()


def test_frozen_encoder_reports_its_last_value():
    one, free = servo(), servo()
    motion = go(LIMITS, START, TARGET)
    for number in range(1, 40):
        if number == 20:
            one.freeze(2)
            held = one.position[2]
            one.freeze(4)
        for item in (one, free):
            item.step(motion.at(number * DT)[0], DT)
    others = [0, 1, 3, 5]
    np.testing.assert_array_equal(one.position[others], free.position[others])
    assert one.position[2] == held
    assert one.velocity[2] == one.velocity[4] == 0.0
    assert free.position[2] != held
    one.freeze(2)  # the value stays
    assert one.position[2] == held
    one.freeze(None)
    np.testing.assert_array_equal(one.position, free.position)
    np.testing.assert_array_equal(one.velocity, free.velocity)


@pytest.mark.parametrize('lag', [0.0, 0.008])
def test_pushed_joint_returns_to_its_command(lag):
    one = servo(lag)
    pushed = START + np.array([0.05, 0, 0, 0, 0, 0])
    one.jump(pushed)
    np.testing.assert_array_equal(one.position, pushed)
    assert not one.settled
    one.step(START, DT)
    assert START[0] <= one.position[0] < pushed[0]
    for _ in range(60):
        one.step(START, DT)
    assert one.settled
    np.testing.assert_array_equal(one.position, START)


@pytest.mark.parametrize('lag', [0.0, 0.008])
def test_joint_without_power_stays_where_it_was_pushed(lag):
    one = servo(lag)
    pushed = START + 0.05
    one.jump(pushed)
    for _ in range(3):
        one.step(pushed, DT)
        np.testing.assert_array_equal(one.position, pushed)
        assert not one.velocity.any()
    assert one.settled


@settings(max_examples=examples(40))
@given(
    steps=st.lists(st.tuples(st.floats(-1.0, 1.0), st.floats(0.0, 0.1)), max_size=30),
    lag=st.sampled_from([0.0, 0.001, 0.01, 0.1]),
)
def test_position_stays_within_the_range_of_the_commands(steps, lag):
    one = servo(lag)
    commands = [START[0]]
    for angle, dt in steps:
        command = START.copy()
        command[0] = angle
        one.step(command, dt)
        commands.append(angle)
        assert min(commands) - 1e-12 <= one.position[0] <= max(commands) + 1e-12
    for _ in range(1000):
        one.step(TARGET, DT)
    assert one.settled
    np.testing.assert_array_equal(one.position, TARGET)
