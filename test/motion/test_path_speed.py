# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The speed along a path of parts: as fast as one part allows, and inside the limits of all."""

import numpy as np
import pytest

from epson_driver.motion import JointLimits, go
from epson_driver.motion.path_speed import PartLimits, fastest


@pytest.mark.parametrize('length', [1e-6, 1e-3, 0.05, 0.3, 2.0])
def test_one_part_is_the_fastest_move_from_rest_to_rest(length):
    motion = fastest([PartLimits(length, 0.5, 2.0, 20.0)])
    one = np.ones(1)
    limits = JointLimits(('way',), -one, 3 * one, 0.5 * one, 2.0 * one, 20.0 * one)
    assert motion.duration == pytest.approx(go(limits, np.zeros(1), length * one).duration)


@pytest.mark.invariant(2)
def test_random_parts_keep_their_limits_and_join_without_a_jump():
    random = np.random.default_rng(18)
    for _ in range(200):
        parts = [
            PartLimits(*(10.0 ** random.uniform((-4, -2, -1, 0), (0, 0.5, 1, 2.5))))
            for _ in range(random.integers(1, 8))
        ]
        motion = fastest(parts)
        seams = np.cumsum([0.0, *(part.length for part in parts)])
        assert motion.ways[-1] == pytest.approx(seams[-1])
        assert motion.speeds[-1] == motion.accelerations[-1] == 0.0
        times = np.sort([*np.linspace(0.0, motion.duration, 2000), *motion.times])
        way, speed, acceleration, jerk = motion.at(times)
        part = np.clip(np.searchsorted(seams, way - 1e-12) - 1, 0, len(parts) - 1)
        slack = 1.0 + 1e-9
        most = np.array([[p.speed, p.acceleration, p.jerk] for p in parts])
        # a moment at a seam belongs to either side
        most = np.maximum(most[part], most[np.clip(part + 1, 0, len(parts) - 1)])
        inside = np.min(np.abs(way[:, None] - seams), axis=1) > 1e-9
        exact = np.array([[p.speed, p.acceleration, p.jerk] for p in parts])[part]
        bounds = np.where(inside[:, None], exact, most)
        assert np.all(speed <= bounds[:, 0] * slack)
        assert np.all(np.abs(acceleration) <= bounds[:, 1] * slack + 1e-9)
        assert np.all(np.abs(jerk) <= bounds[:, 2] * slack)
        assert np.all(speed >= -1e-9)
        assert np.all(np.diff(way) >= -1e-9)
        ends = np.array([motion.at(motion.times[1:] - 1e-12)[k] for k in range(3)])
        begins = np.array([motion.ways[1:], motion.speeds[1:], motion.accelerations[1:]])
        assert np.abs(ends - begins).max() < 1e-6


def test_a_slow_part_does_not_slow_down_the_others():
    fast, slow = PartLimits(0.5, 0.5, 2.0, 20.0), PartLimits(0.02, 0.05, 2.0, 20.0)
    motion = fastest([fast, slow, fast])
    way, speed, _, _ = motion.at(np.linspace(0.0, motion.duration, 5000))
    assert speed.max() == pytest.approx(0.5)
    assert speed[(way > 0.5) & (way < 0.52)] == pytest.approx(0.05, abs=1e-9)
