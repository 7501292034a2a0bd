# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Feedback at a set rate from samples at another."""

import numpy as np
import pytest

from epson_driver.node.throttle import Throttle


@pytest.mark.parametrize('period', [0.004, 0.0055, 0.007, 0.013, 0.05])
@pytest.mark.parametrize('rate', [5.0, 20.0])
def test_the_mean_rate_is_the_one_that_was_set(period, rate):
    throttle = Throttle()
    times = 1000.0 + np.arange(0.0, 20.0, period)
    passed = [time for time in times if throttle.passes(float(time), rate)]
    assert len(passed) == pytest.approx(20.0 * rate, abs=2)
    assert np.diff(passed).max() < 1.0 / rate + period + 1e-9


def test_slower_samples_all_pass():
    throttle = Throttle()
    assert all(throttle.passes(1000.0 + index * 0.1, 20.0) for index in range(50))


def test_after_a_silence_there_is_no_burst():
    throttle = Throttle()
    assert throttle.passes(1000.0, 20.0)
    assert throttle.passes(1010.0, 20.0)
    assert not throttle.passes(1010.01, 20.0)


def test_another_rate_holds_from_the_next_sample_on():
    throttle = Throttle()
    assert throttle.passes(1000.0, 20.0)
    assert throttle.passes(1000.06, 1.0)
    assert not throttle.passes(1000.9, 1.0)
    assert throttle.passes(1001.1, 1.0)
