# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""One setpoint of a stream: what is wrong with it, as a sentence for people."""

import numpy as np
import pytest
from support.driver_harness import LIMITS

from epson_driver.driver.servo.setpoint import Setpoint, Window

TIMES = np.array([0.1, 0.2])
STILL = np.zeros((2, 6))


def changed(value):
    values = STILL.copy()
    values[0, 2] = value
    return values


@pytest.mark.parametrize(
    ('positions', 'velocities', 'said'),
    [
        (STILL, None, None),
        (STILL, STILL, None),
        (changed(np.nan), None, 'joint_3: positions = nan is not finite, in point 0'),
        (STILL, changed(np.inf), 'joint_3: velocities = inf is not finite, in point 0'),
        (STILL[:, :5], None, 'positions of shape (2, 5) for 6 joints'),
        (STILL, STILL[:1], 'velocities of shape (1, 6) for 6 joints'),
    ],
)
def test_a_window_may_have_velocities_and_all_of_it_is_looked_at(positions, velocities, said):
    window = Window(TIMES, positions, velocities)
    assert Setpoint('~/servo', np.zeros(6), window=window).problem(LIMITS) == said


def test_a_setpoint_of_nothing_is_wrong_but_beyond_no_limit():
    nothing = Setpoint('~/servo')
    assert nothing.problem(LIMITS) == 'it has neither positions nor velocities'
    assert nothing.beyond(LIMITS, LIMITS.velocity) is None
