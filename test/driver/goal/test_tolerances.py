# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What the violation of a tolerance says."""

import numpy as np

from epson_driver.driver.goal.tolerances import Tolerances

NAMES = ('a', 'b', 'c')


def test_a_violation_names_joint_error_and_limit_of_the_worst():
    limits = Tolerances(np.array([0.1, 0.1, np.inf]), np.array([np.inf, 1.0, np.inf]))
    still = np.zeros(3)
    assert limits.checked
    assert limits.violation(NAMES, np.array([0.1, -0.1, 9.0]), still) is None
    text = limits.violation(NAMES, np.array([0.2, -0.3, 9.0]), still)
    assert text == 'b: the position error is 0.3 rad, the tolerance is 0.1 rad'
    text = limits.violation(NAMES, still, np.array([5.0, -1.5, 5.0]))
    assert text == 'b: the velocity error is 1.5 rad/s, the tolerance is 1 rad/s'


def test_nothing_is_checked_where_nothing_is_limited():
    unlimited = np.full(3, np.inf)
    assert not Tolerances(unlimited, unlimited).checked
