# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Conversion of the driver's values to ROS messages (docs/invariants.md, 8)."""

import struct
from itertools import product

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from hypothesis import given
from hypothesis import strategies as st
from industrial_msgs.msg import RobotMode, TriState
from support.goal_execution_harness import LINE, NAMES, Harness

from epson_driver.driver.outcome import End, ErrorCode, Outcome
from epson_driver.driver.state.robot_state import JointSample, RobotState
from epson_driver.node import messages
from epson_driver.simple_message import Status

pytestmark = pytest.mark.invariant(8)


def in_s(duration):
    return duration.sec + duration.nanosec * 1e-9


STAMP = Time(sec=12, nanosec=345)
FIELDS = ('drives_powered', 'e_stopped', 'in_error', 'in_motion', 'motion_possible')


@given(st.tuples(*[st.floats(width=32, allow_nan=False, allow_infinity=False)] * 10))
def test_inv8_joint_states_equal_the_measurement_bit_for_bit(values):
    """docs/invariants.md, 8."""
    names = ('f', 'a', 'e', 'b', 'd', 'c')
    sample = RobotState(6).on_joints(values, 1.0, values)
    message = messages.JointStateWriter(names, 'left_base_link').write(sample, STAMP)
    assert message.header.frame_id == 'left_base_link'
    assert tuple(message.name) == names
    assert message.header.stamp == STAMP
    assert struct.pack('6d', *message.position) == struct.pack('6d', *values[:6])
    assert struct.pack('6d', *message.velocity) == struct.pack('6d', *values[:6])
    assert len(message.effort) == 0


def test_each_joint_state_has_the_values_of_its_sample():
    writer = messages.JointStateWriter(('a', 'b'))
    state = RobotState(2)
    state.on_joints((0.0,) * 10, 0.995)
    first = writer.write(state.on_joints((1.0, 2.0) + (0.0,) * 8, 1.0), STAMP)
    assert list(first.position) == [1.0, 2.0]
    second = writer.write(state.on_joints((3.0, 4.0) + (0.0,) * 8, 2.0), Time(sec=13))
    assert list(second.position) == [3.0, 4.0]
    assert second.header.stamp.sec == 13
    assert len(second.velocity) == 2


def test_robot_status_maps_each_field():
    writer = messages.RobotStatusWriter()
    values = (-1, 0, 1, 1, 2, -2, 255, -(2**31))
    for second, (field, value) in enumerate(product(FIELDS, values)):
        fields = dict.fromkeys(FIELDS, 0) | {field: value}
        code = max(value, 0)
        status = writer.write(Status(**fields, error_code=code), Time(sec=second))
        expected = fields | {field: value if value in (0, 1) else TriState.UNKNOWN}
        assert {name: getattr(status, name).val for name in FIELDS} == expected
        assert list(status.error_codes) == [code][:code]
        assert status.header.stamp == Time(sec=second)


def test_enum_values_equal_industrial_msgs():
    assert (TriState.UNKNOWN, TriState.FALSE, TriState.TRUE) == (-1, 0, 1)
    assert (RobotMode.UNKNOWN, RobotMode.MANUAL, RobotMode.AUTO) == (-1, 1, 2)


@pytest.mark.parametrize(
    ('mode', 'expected'), [(-1, -1), (1, 1), (2, 2), (0, -1), (3, -1), (-2, -1), (2**31 - 1, -1)]
)
def test_undefined_mode_is_published_as_unknown(mode, expected):
    assert messages.robot_status(Status(mode=mode), STAMP).mode.val == expected


def test_result_has_code_and_text():
    outcome = Outcome(End.ABORTED, ErrorCode.GOAL_TOLERANCE_VIOLATED, 'beside the goal')
    result = messages.result(outcome)
    assert result.error_code == result.GOAL_TOLERANCE_VIOLATED
    assert result.error_string == 'beside the goal'


def test_feedback_has_desired_and_actual_state_and_their_difference():
    harness = Harness()
    harness.answer()
    harness.see(0.15)
    execution = harness.execution
    sample = JointSample(harness.now, np.array([0.4, -0.1]), np.array([1.5, -2.5]), harness.now)
    feedback = messages.feedback(execution, sample, STAMP)
    state = messages.controller_state(execution, sample, STAMP)
    elapsed = harness.now - execution.started
    planned = harness.robot.sample.measured - execution.started
    for message, desired, actual in (
        (feedback, feedback.desired, feedback.actual),
        (state, state.reference, state.feedback),
    ):
        assert tuple(message.joint_names) == NAMES
        assert message.header.stamp == STAMP
        on_plan = np.array(LINE[1]) * planned  # the first segment takes 1 s
        np.testing.assert_allclose(desired.positions, on_plan)
        np.testing.assert_allclose(desired.velocities, LINE[1])
        assert in_s(desired.time_from_start) == pytest.approx(planned, abs=1e-6)
        assert list(actual.positions) == [0.4, -0.1]
        assert list(actual.velocities) == [1.5, -2.5]
        assert in_s(actual.time_from_start) == pytest.approx(elapsed, abs=1e-6)
        np.testing.assert_allclose(message.error.positions, on_plan - [0.4, -0.1])
        np.testing.assert_allclose(message.error.velocities, [0.5 - 1.5, 0.25 + 2.5])
    assert list(state.output.positions) == list(LINE[1])  # the pending point
    assert state.speed_scaling_factor == 1.0


def test_feedback_after_the_plan_desires_the_last_point():
    harness = Harness(in_motion=TriState.TRUE)
    for _ in LINE:
        harness.answer()
    harness.see(2.1)
    sample = harness.robot.sample
    feedback = messages.feedback(harness.execution, sample, STAMP)
    assert list(feedback.desired.positions) == list(LINE[-1])
    assert in_s(feedback.desired.time_from_start) == 2.0
