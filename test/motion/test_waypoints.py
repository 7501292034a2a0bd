# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Merged, repeated and reversed points never leave two path points at one position."""

import numpy as np
import pytest
from support.examples import one_in
from support.smoother_harness import LIMITS

from epson_driver.motion.smoother.waypoints import MERGE_TOLERANCE, MIN_MOVE, Mode, Waypoints

STEP = MERGE_TOLERANCE / 5.0


@pytest.mark.parametrize('mode', Mode)
@pytest.mark.parametrize('seed', one_in(4, range(8)))
def test_path_has_no_two_points_at_one_position(mode, seed):
    random = np.random.default_rng(seed)
    waypoints = Waypoints(LIMITS, np.zeros(2), mode)
    start, place = waypoints.origin, 0
    for _ in range(2000):
        place += int(random.choice([-9, -4, -3, -2, -1, 0, 1, 2, 3, 4, 9]))
        last = STEP * np.array([place, -place])
        duration = random.choice([None, 0.02, 0.2, 0.5])
        waypoints.append(last, duration, 0.0, in_motion=True)
        if random.random() < 0.05:
            waypoints.finish()
        path = np.array([point.position for point in (start, *waypoints.ahead)])
        assert (np.abs(np.diff(path, axis=0)).max(axis=1) > MIN_MOVE).all()
        assert np.abs(waypoints.last.position - last).max() == 0.0
        if len(waypoints.ahead) > 20:
            start = waypoints.ahead[10]
            waypoints.passed(start)
