# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Moves that overlap in time respect every limit."""

from itertools import pairwise

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.examples import examples

from epson_driver.motion import Array, JointLimits, LineMotion, go
from epson_driver.robots import load_robot_model
from epson_driver.sim_controller.arm.overlap import blend_start

LIMITS = load_robot_model('c3_a601s').limits
LOW, HIGH = LIMITS.position_min, LIMITS.position_max
JOINTS = len(LIMITS.names)
FRACTIONS = st.floats(0.0, 1.0)
PERCENTAGES = st.floats(0.01, 1.0)
STARTS = st.tuples(*[st.sampled_from([0.0, 1.0]) | FRACTIONS] * JOINTS).map(
    lambda shares: LOW + np.array(shares) * (HIGH - LOW)
)
STEPS = st.sampled_from([0.0, 1e-12, -1e-12, 1e-9, -1e-8, 1e-6]) | st.floats(-15.0, 15.0)
TARGETS = st.tuples(*[STEPS | st.floats(-0.1, 0.1)] * JOINTS)


def check_blend(
    first: LineMotion, second: LineMotion, begin: float, speed: float, accel: float
) -> None:
    """Assert the limits for the sum of two moves, from `begin` to the end of the first."""
    count = 800
    times = np.linspace(begin, first.duration, count)
    states = [
        [one + other for one, other in zip(first.at(t), second.at(t - begin), strict=True)]
        for t in times
    ]
    p, v, a = (np.array(column) for column in zip(*states, strict=True))
    p -= second.origin
    slack = 1.0 + 1e-8
    assert np.all((p >= LOW - 1e-11) & (p <= HIGH + 1e-11))
    assert np.all(np.abs(v) <= speed * LIMITS.velocity * slack)
    assert np.all(np.abs(a) <= accel * LIMITS.acceleration * slack)
    step = times[1] - times[0]
    if step < 1e-9:
        return  # too short for differences
    jerks = np.abs(np.diff(a, axis=0)) / step
    assert np.all(jerks <= accel * LIMITS.jerk * slack + 1e-11 / step)


@pytest.mark.invariant(2)
@settings(max_examples=examples(80))
@given(
    corner=STARTS,
    before=TARGETS,
    after=TARGETS,
    speeds=st.tuples(PERCENTAGES, PERCENTAGES),
    accels=st.tuples(PERCENTAGES, PERCENTAGES),
    full=st.booleans(),
    late=FRACTIONS,
)
def test_inv2_blend_stays_within_every_limit(
    corner: Array,
    before: tuple[float, ...],
    after: tuple[float, ...],
    speeds: tuple[float, float],
    accels: tuple[float, float],
    full: bool,
    late: float,
) -> None:
    start, end = (np.clip(corner + np.array(steps), LOW, HIGH) for steps in (before, after))
    first = go(LIMITS, start, corner, speeds[0], accels[0])
    second = go(LIMITS, corner, end, speeds[1], accels[1])
    earliest = first.braking + late * (first.duration - first.braking)
    speed, accel = max(speeds), 1.0 if full else max(accels)
    begin = blend_start(first, second, LIMITS, earliest, speed=speed, accel=accel)
    assert earliest <= begin <= first.duration
    if begin < first.duration:
        check_blend(first, second, begin, speed, accel)


def moves(*points: npt.ArrayLike, speed: float = 1.0, accel: float = 1.0) -> list[LineMotion]:
    return [go(LIMITS, *pair, speed, accel) for pair in pairwise(map(np.array, points))]


def test_moves_of_different_joints_overlap_fully() -> None:
    corner = np.array([0.5, 0, 0, 0, 0, 0])
    first, second = moves(np.zeros(JOINTS), corner, [0.5, 0.5, 0, 0, 0, 0])
    assert blend_start(first, second, LIMITS, first.braking) == first.braking


def test_equal_moves_on_a_line_blend_at_full_speed() -> None:
    step = np.array([0.9, 0.3, 0, 0, 0, 0])
    first, second = moves(0 * step, step, 2 * step, speed=0.3)
    assert blend_start(first, second, LIMITS, first.braking, speed=0.3) == first.braking
    _, velocity, acceleration = first.at(first.braking + 0.02)
    _, onward, opposite = second.at(0.02)
    np.testing.assert_allclose(velocity + onward, first.at(first.braking)[1], rtol=1e-9)
    np.testing.assert_allclose(acceleration + opposite, 0.0, atol=1e-6)


@pytest.mark.invariant(2)
def test_inv2_reversal_at_full_acceleration_starts_later() -> None:
    there, back = np.zeros(JOINTS), np.array([1.0, 0, 0, 0, 0, 0])
    first, second = moves(there, back, there)
    start = blend_start(first, second, LIMITS, first.braking)
    assert first.braking + 0.05 < start < first.duration
    check_blend(first, second, start, 1.0, 1.0)
    # at half the acceleration, both together reach the joint's limit
    first, second = moves(there, back, there, accel=0.5)
    assert blend_start(first, second, LIMITS, first.braking) == first.braking


@pytest.mark.invariant(2)
def test_inv2_blend_does_not_exceed_a_position_limit() -> None:
    # From the limit, and back by a short move that ends before the first move.
    top, below = np.array([HIGH[0], 0, 0, 0, 0, 0]), np.array([HIGH[0] - 0.02, 0, 0, 0, 0, 0])
    far = np.array([HIGH[0], 0, 0, -3.0, 0, 0])
    first, second = moves(far, below)[0], moves(below, top, accel=0.5)[0]
    start = blend_start(first, second, LIMITS, first.braking)
    assert start > first.braking
    check_blend(first, second, start, 1.0, 1.0)
    wide = JointLimits(
        LIMITS.names, LOW, HIGH + 1.0, LIMITS.velocity, LIMITS.acceleration, LIMITS.jerk
    )
    assert blend_start(first, second, wide, first.braking) < start


@pytest.mark.invariant(2)
def test_inv2_blend_respects_the_tool_speed() -> None:
    reach = np.array([0.5, 0.5, 0, 0, 0, 0])
    corner = np.array([0.5, 0, 0, 0, 0, 0])
    fastest = 0.5 * 0.1 * LIMITS.velocity[0]
    _, second = moves(0 * corner, corner, [0.5, 0.5, 0, 0, 0, 0], speed=0.1)
    (slow,) = moves(0 * corner, corner, speed=0.1, accel=0.1)
    assert blend_start(slow, second, LIMITS, slow.braking) == slow.braking
    start = blend_start(slow, second, LIMITS, slow.braking, tool=(reach, fastest * 1.1))
    assert slow.braking < start < slow.duration
    for time in np.linspace(start, slow.duration, 500):
        sum_of_both = slow.at(time)[1] + second.at(time - start)[1]
        assert np.abs(sum_of_both) @ reach <= fastest * 1.1 * (1.0 + 1e-9)


def test_blend_needs_a_second_move_before_the_first_ends() -> None:
    corner = np.array([0.5, 0, 0, 0, 0, 0])
    first, second = moves(0 * corner, corner, [0.5, 0.5, 0, 0, 0, 0])
    (nothing,) = moves(corner, corner)
    assert blend_start(first, nothing, LIMITS, first.braking) == first.duration
    for late in (first.duration, first.duration + 1.0):
        assert blend_start(first, second, LIMITS, late) == first.duration
