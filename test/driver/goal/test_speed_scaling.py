# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The factor, its ramp, and what becomes of a point."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from epson_driver.driver.goal.speed_scaling import MIN_FACTOR, RAMP_PER_S, SpeedScaling, scaled
from epson_driver.simple_message import JointTrajPt, JointTrajPtFull, Ping, ValidFields, joint_data

FACTORS = st.one_of(st.just(0.0), st.floats(MIN_FACTOR, 1.0))


def test_it_begins_as_planned():
    scaling = SpeedScaling()
    assert scaling.factor(0.0) == scaling.factor(1e9) == scaling.target == 1.0
    assert scaling.time_for(0.3, 5.0) == 0.3


def test_it_goes_to_its_target_in_a_ramp_also_from_the_middle_of_one():
    scaling = SpeedScaling()
    scaling.set(0.0, 10.0)
    assert scaling.factor(10.0) == 1.0
    assert scaling.factor(10.0 + 0.25 / RAMP_PER_S) == pytest.approx(0.75)
    assert scaling.factor(10.0 + 1.0 / RAMP_PER_S) == 0.0
    scaling.set(0.5, 10.0 + 0.75 / RAMP_PER_S)
    assert scaling.factor(10.0 + 0.75 / RAMP_PER_S) == pytest.approx(0.25)
    assert scaling.factor(10.0 + 0.9 / RAMP_PER_S) == pytest.approx(0.4)
    assert scaling.factor(11.0) == 0.5


@pytest.mark.parametrize('bad', [-0.1, MIN_FACTOR / 2, 1.001, math.nan, math.inf, -math.inf])
def test_what_is_no_factor_is_refused_with_what_is(bad):
    scaling = SpeedScaling()
    with pytest.raises(ValueError, match=r'must be 0 \(pause\) or from 0.01 to 1'):
        scaling.set(bad, 1.0)
    assert scaling.target == 1.0


@given(FACTORS, FACTORS, st.floats(0.0, 1.0), st.floats(1e-3, 2.0))
def test_a_piece_of_a_plan_takes_as_long_as_the_factors_on_the_way_say(
    first, then, since, planned
):
    scaling = SpeedScaling()
    scaling.set(first, 0.0)
    scaling.set(then, 10.0)
    begin = 10.0 + since
    takes = scaling.time_for(planned, begin)
    if takes is None:
        assert then == 0.0
        left = scaling.factor(begin) ** 2 / 2 / RAMP_PER_S
        assert planned >= left - 1e-9
        return
    steps = 2000
    step = takes / steps
    done = sum(scaling.factor(begin + (index + 0.5) * step) for index in range(steps)) * step
    assert done == pytest.approx(planned, rel=1e-3)


def test_no_point_that_is_sent_at_the_end_of_a_pause_is_slow_for_long():
    scaling = SpeedScaling()
    scaling.set(0.0, 0.0)
    assert scaling.time_for(0.1, 5.0) is None
    scaling.set(1.0, 5.0)
    assert scaling.time_for(1.0, 5.0) == pytest.approx(1.0 + 0.5 / RAMP_PER_S)


POINT = JointTrajPt(3, joint_data([0.1, 0.2]), 0.6, 0.5)


def test_a_point_takes_longer_and_is_slower():
    slow = scaled(POINT, 0.5, 0.5)
    assert (slow.velocity, slow.duration) == (0.3, 1.0)
    assert (slow.sequence, slow.joints) == (POINT.sequence, POINT.joints)
    assert scaled(POINT, 0.001, 1.0).velocity == 1e-3


def test_a_full_point_comes_later_and_is_slower():
    fields = ValidFields.TIME | ValidFields.POSITION
    full = JointTrajPtFull(0, 3, fields, 2.0, (1.0,) * 10, (4.0,) * 10, (8.0,) * 10)
    slow = scaled(full, 0.5, 0.75)
    assert slow.time == 2.75
    assert slow.positions == full.positions
    assert slow.velocities == (2.0,) * 10
    assert slow.accelerations == (2.0,) * 10
    late = scaled(full, 1.0, 0.75)  # slower ones came before it
    assert (late.time, late.velocities) == (2.75, full.velocities)


def test_as_planned_nothing_changes():
    assert scaled(POINT, 1.0, 0.0) is POINT
    assert scaled(POINT, 1.0, 0.3) == POINT
    assert scaled(Ping(), 0.5, 1.0) == Ping()
