# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The measured control cycle of a controller."""

import numpy as np
import pytest

from epson_driver.rtmc.cycle import MAX_FILLING, SAMPLES, CycleMeter

EXPECTED = 0.002


def measured(times, meter=None):
    meter = meter or CycleMeter(EXPECTED)
    meter.restart()
    for _ in range(10):
        meter.add(0.0, full=False)
    for time in times:
        meter.add(time, full=True)
    return meter


@pytest.mark.parametrize('cycle', [0.0005, 0.001, 0.002, 0.004, 0.008])
def test_cycle_is_measured_in_spite_of_delayed_answers(cycle):
    noise = np.random.default_rng(1).exponential(0.0001, SAMPLES)
    noise[[5, 17]] += 0.02
    assert measured(np.arange(SAMPLES) * cycle + noise).cycle == pytest.approx(cycle)


def test_expected_cycle_remains_if_the_answers_are_irregular():
    times = np.cumsum(np.random.default_rng(1).uniform(0.0, 0.02, SAMPLES))
    meter = measured(times)
    assert meter.ready
    assert meter.cycle == EXPECTED


def test_one_measurement_is_enough():
    meter = measured(np.arange(SAMPLES - 1) * 0.004)
    assert not meter.ready
    meter = measured(np.arange(SAMPLES) * 0.004)
    assert measured([0.0], meter).ready
    assert meter.cycle == pytest.approx(0.004)


def test_buffer_that_never_reports_to_be_full_counts_as_full():
    meter = CycleMeter(EXPECTED)
    for index in range(MAX_FILLING + SAMPLES - 1):
        assert not meter.ready
        meter.add(index * 0.002, full=False)
    assert meter.ready


@pytest.mark.invariant(2)
@pytest.mark.parametrize(
    ('held', 'period', 'count', 'cycle'),
    [(5, 0.0055, 60, 0.004), (0, 0.0055, 150, EXPECTED), (5, 0.001, 150, 0.001)],
)
def test_inv2_pace_of_this_side_is_not_taken_for_a_longer_cycle(held, period, count, cycle):
    meter = measured(np.arange(held) * 0.004)
    for time in 1.0 + np.arange(count) * period:
        meter.add(time, full=False)
    assert meter.ready is (count > MAX_FILLING)
    for time in 2.0 + np.arange(SAMPLES) * 0.004:
        meter.add(time, full=True)
    assert meter.ready
    assert meter.cycle == pytest.approx(cycle)


@pytest.mark.parametrize('cycle', [0.0005, 0.002, 0.008])
def test_answers_of_a_drained_buffer_are_not_too_fast(cycle):
    meter = measured(np.arange(SAMPLES) * cycle)
    measured([0.0], meter)
    for _ in range(10):
        meter.add(0.0, full=False)
    with pytest.raises(ValueError, match='its cycle was'):
        meter.add(0.0, full=False)


@pytest.mark.invariant(2)
def test_inv2_shorter_cycle_than_measured_is_an_error_and_is_measured_again():
    meter = measured(np.arange(SAMPLES) * 0.002)
    with pytest.raises(ValueError, match=r'each 1 ms, but its cycle was 2 ms'):
        measured(np.arange(100) * 0.001, meter)
    assert measured(np.arange(SAMPLES) * 0.001, meter).cycle == pytest.approx(0.001)
    with pytest.raises(ValueError, match='each 0 ms'):
        measured(np.zeros(SAMPLES))
