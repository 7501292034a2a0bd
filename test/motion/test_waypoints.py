# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Waypoints of the smoother, and the places and times at which known motions pass them."""

import numpy as np
import pytest
from support.examples import one_in
from support.smoother_harness import CURVE, LIMITS, PLAN, motion_of

from epson_driver.motion import closest_samples
from epson_driver.motion.closest_samples import closest_sample_indices, passed
from epson_driver.motion.smoothed import smoothed
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


def test_passages_of_waypoints_are_found_between_samples_in_order():
    times = np.arange(0.0, 2.005, 0.01)
    motion = motion_of(times, lambda times: np.sin(np.pi * times))  # up, down, and up again
    a = [0.0, 0.5, 1.0, 0.5, -1.0, 0.0]
    waypoints = np.stack([a, [0.0, 0.0, 0.0, 0.0, 0.1, 0.0]], axis=1)
    errors, when = passed(waypoints, motion)
    expected = np.array([0.0, 1 / 6, 0.5, 5 / 6, 1.5, 2.0])
    assert np.abs(when - expected)[[0, 1, 2, 3, 5]].max() < 0.02
    assert abs(when[4] - 1.5) < 0.15  # 0.1 rad away during that time
    assert errors[[0, 1, 2, 3, 5]].max() < 1e-4
    assert errors[4] == pytest.approx(0.1)
    assert closest_sample_indices(waypoints, motion.positions)[0] == 0


def test_sparse_search_of_long_motions_gives_the_same_result(monkeypatch):
    motion = smoothed(PLAN, LIMITS, period=0.001)
    expected = passed(CURVE, motion)
    monkeypatch.setattr(closest_samples, 'MAX_COMPARED_PAIRS', 1000)
    errors, times = passed(CURVE, motion)
    assert errors == pytest.approx(expected[0])
    assert times == pytest.approx(expected[1])
