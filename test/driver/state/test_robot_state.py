# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What was reported last: exact positions, velocities, nothing stale.

What networks do to it is in test_state_through_networks.py.
"""

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from epson_driver.driver.state.joint_mapping import joint_mapping
from epson_driver.driver.state.joint_velocity import VELOCITY_WINDOW_S
from epson_driver.driver.state.robot_state import RobotState
from epson_driver.simple_message import Status, TriState, joint_data

DT = 0.005
ZEROS = (0.0,) * 10


def feed(state, position_at, seconds, begin=50.0, dt=DT, jitter=None):
    """Feed one-joint positions for a while; return the samples, which begin with the second."""
    samples = []
    for count in range(round(seconds / dt) + 1):
        time = begin + count * dt
        arrived = time if jitter is None else time + jitter.uniform(0.0, 0.002)
        samples.append(state.on_joints(joint_data([position_at(time - begin)]), arrived))
    return [sample for sample in samples if sample is not None]


@pytest.mark.invariant(8)
@given(st.tuples(*[st.floats(width=32, allow_nan=False, allow_infinity=False)] * 10))
def test_inv8_positions_are_what_came_bit_for_bit(values):
    """docs/invariants.md, 8."""
    state = RobotState(6)
    assert state.on_joints(ZEROS, 0.995) is None
    sample = state.on_joints(values, 1.0)
    assert sample.positions.dtype == np.float64
    assert sample.positions.tobytes() == struct.pack('6d', *values[:6])
    assert sample.time == 1.0


def test_velocity_of_a_constant_motion_is_exact():
    samples = feed(RobotState(1), lambda t: 0.3 - 1.7 * t, 1.0)
    for sample in samples[9:]:
        assert sample.velocities == pytest.approx([-1.7], rel=1e-9)


def test_velocity_with_a_jittering_network():
    generator = np.random.default_rng(1)
    samples = feed(RobotState(1), lambda t: 2.0 * t, 2.0, jitter=generator)
    errors = np.array([sample.velocities[0] - 2.0 for sample in samples])
    assert abs(errors).max() < 0.02  # single differences would be off by 1


def test_velocity_of_an_accelerating_motion_lags_by_half_the_window():
    acceleration = 20.0
    samples = feed(RobotState(1), lambda t: 0.5 * acceleration * t * t, 0.5)
    for sample in samples[20:]:
        true = acceleration * (sample.time - 50.0)
        lag = true - sample.velocities[0]
        assert 0.0 < lag < acceleration * (VELOCITY_WINDOW_S / 2 + DT)


def test_velocity_of_an_arm_that_stands_is_exactly_zero():
    state = RobotState(1)
    for sample in feed(state, lambda t: 0.1 + 0.2, 1.0):
        assert sample.velocities[0] == 0.0


def test_velocity_is_zero_soon_after_the_arm_stopped():
    state = RobotState(1)
    for sample in feed(state, lambda t: min(t, 0.5), 1.0):
        if sample.time > 50.0 + 0.5 + VELOCITY_WINDOW_S + DT:
            assert sample.velocities[0] == 0.0


def test_velocity_at_a_slow_rate_and_after_a_gap():
    samples = feed(RobotState(1), lambda t: 0.25 * t, 10.0, dt=1.0)
    assert [sample.velocities[0] for sample in samples] == pytest.approx([0.25] * 10)
    state = RobotState(1)
    feed(state, lambda t: 0.5 * t, 0.1)
    after_gap = state.on_joints(joint_data([0.05 + 0.5 * 0.9]), 51.0)
    assert after_gap.velocities == pytest.approx([0.5], rel=1e-6)


def test_velocity_of_several_joints_each_its_own():
    state = RobotState(3)
    for count in range(40):
        sample = state.on_joints(joint_data([count * 0.01, -count * 0.02, 5.0]), count * DT)
    assert sample.velocities == pytest.approx([2.0, -4.0, 0.0], abs=1e-12)


def test_positions_that_come_in_one_burst_make_no_velocity_out_of_nothing():
    state = RobotState(1)
    feed(state, lambda t: t, 0.1)
    for count in range(4):  # 20 ms late, all together
        sample = state.on_joints(joint_data([0.105 + count * DT]), 50.12 + count * 1e-5)
    assert 0.5 < sample.velocities[0] < 1.5


def test_measured_velocities_are_taken_as_they_are():
    velocities = (0.125, -1.5, 1e-9, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0)
    sample = RobotState(4).on_joints(ZEROS, 1.0, velocities)
    assert sample.velocities.tolist() == [0.125, -1.5, 1e-9, 4.0]


@pytest.mark.parametrize('bad', [float('nan'), float('inf'), float('-inf')])
@pytest.mark.parametrize('joint', [0, 3])
def test_a_position_that_is_not_finite_is_refused(joint, bad):
    state = RobotState(4)
    state.on_joints(ZEROS, 0.995)
    good = state.on_joints(ZEROS, 1.0)
    values = list(ZEROS)
    values[joint] = bad
    with pytest.raises(ValueError, match=rf'joint {joint + 1}: position .* is not finite'):
        state.on_joints(tuple(values), 1.005)
    assert state.sample is good
    assert state.on_joints(ZEROS, 1.01).velocities.tolist() == [0.0] * 4


@pytest.mark.parametrize('bad', [float('nan'), float('inf')])
def test_a_velocity_that_is_not_finite_is_refused(bad):
    """A NaN is not below any tolerance, but not above one either: the arm would seem to stand."""
    state = RobotState(4)
    with pytest.raises(ValueError, match=r'joint 2: velocity .* is not finite'):
        state.on_joints(ZEROS, 1.0, (0.0, bad) + (0.0,) * 8)
    assert state.sample is None


def test_what_is_not_finite_in_an_unused_joint_does_not_matter():
    values = (0.0, 0.0, float('nan')) + (0.0,) * 7
    assert RobotState(2).on_joints(values, 1.0, values).positions.tolist() == [0.0, 0.0]


@pytest.mark.invariant(6)
def test_inv6_clear_forgets_everything():
    """docs/invariants.md, 6."""
    state = RobotState(1)
    feed(state, lambda t: 3.0 * t, 1.0)
    state.on_status(Status(in_motion=TriState.TRUE), 51.0)
    assert state.in_motion == TriState.TRUE
    assert state.status_time == 51.0
    state.clear()
    assert state.sample is None
    assert state.status is None
    assert state.in_motion == TriState.UNKNOWN
    # the history is gone as well: no velocity across the time without a link
    assert state.on_joints(joint_data([0.0]), 51.1) is None
    assert state.why_not_ready(51.1) == 'no joint state from the controller'


def test_memory_is_bounded():
    state = RobotState(1)
    feed(state, lambda t: t, 60.0)
    assert len(state._velocity.in_window()) <= VELOCITY_WINDOW_S / DT + 2
    assert len(state._clock._envelope) < 10


def test_positions_and_velocities_are_counted_as_ros_does():
    """The controller's joint 3 goes against its joint 2; joint 1 turns the other way."""
    mapping = joint_mapping(3, [-1, 1, 1], [0.5, 0.0, 0.0], 1)
    state = RobotState(3, mapping=mapping)
    for count in range(20):  # fitted velocities
        t = count * DT
        sample = state.on_joints(joint_data([0.1 * t, 0.2 * t, 0.3 * t]), 50.0 + t)
    np.testing.assert_allclose(sample.positions, [0.5 - 0.1 * t, 0.2 * t, 0.5 * t])
    np.testing.assert_allclose(sample.velocities, [-0.1, 0.2, 0.5], rtol=1e-9)
    sample = state.on_joints(joint_data([0.0, 1.0, 2.0]), 51.0, joint_data([0.1, 0.2, 0.3]))
    np.testing.assert_allclose(sample.positions, [0.5, 1.0, 3.0])
    np.testing.assert_allclose(sample.velocities, [-0.1, 0.2, 0.5])
