# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""How far an arm is taken to be behind what was sent."""

import numpy as np
import pytest

from epson_driver.driver.servo.lead import Lead
from epson_driver.driver.state.robot_state import JointSample

PERIOD_S = 0.01
SPEED = 0.5
"""rad/s"""


def seen(lead, time, position):
    here = np.array([position])
    lead.see(JointSample(time, here, np.zeros(1), time))


def test_an_arm_that_follows_at_a_distance_is_so_far_behind():
    lead = Lead()
    for time in np.arange(0.0, 3.0, PERIOD_S):
        lead.sent(time, np.array([SPEED * time]))
        seen(lead, time, SPEED * max(time - 0.3, 0.0))
    assert lead.behind == pytest.approx(0.3, abs=0.02)
    assert lead.lag == pytest.approx(0.3, abs=0.02)


def test_an_arm_that_gets_the_next_point_when_it_is_at_the_last_is_behind_all_the_same():
    """Whenever a point is sent, the arm is where it was sent before."""
    lead = Lead()
    step = 0.2
    time = at = 0.0
    lead.sent(time, np.array([at]))
    for _ in range(20):
        assert lead.lag == 0.0
        lead.sent(time, np.array([at + SPEED * step]))
        for share in np.arange(PERIOD_S, step + PERIOD_S / 2.0, PERIOD_S) / step:
            seen(lead, time + share * step, at + share * SPEED * step)
        time += step
        at += SPEED * step
    assert 0.5 * step < lead.behind < 1.5 * step
