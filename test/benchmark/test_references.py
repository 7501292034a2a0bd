# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The references that the smoother is held against are right where the truth is known."""

import json
from pathlib import Path

import numpy as np
import pytest

from benchmark.joint_splines import joint_spline
from benchmark.limit_sets import limit_set
from benchmark.references import ReferenceFile, ReferenceTimes, digest
from benchmark.stop_and_go import stop_and_go

LIMITS = limit_set('full')
LINE = np.array([[0.0, 0.0, 0.5, 0.0, -1.0, 0.0], [1.0, -0.5, 1.0, 0.5, -0.5, 1.0]])
CURVE = np.array([LINE[0], [0.5, -0.4, 1.0, 0.3, -0.9, 0.2], [0.7, -0.6, 0.6, 0.6, -0.5, 0.9]])
TIMES = ReferenceTimes(2.0, 3, 0.8, 1.0, 0.9, 0.9, 1.0, 1.1, 0.9, 0.9, 1.0)


def test_a_repeated_point_takes_ptp_no_time() -> None:
    one, other = stop_and_go(LINE, LIMITS), stop_and_go(LINE[[0, 0, 1, 1]], LIMITS)
    assert one == other
    assert one.stops == 0


def test_splines_in_time_of_a_known_motion() -> None:
    """A quintic from rest to rest: its largest velocity is 15/8 of the mean one."""
    use = joint_spline(LINE, np.array([0.0, 0.5]), LIMITS, quintic=True)
    mean = np.max(np.abs(LINE[1] - LINE[0]) / LIMITS.velocity) / 0.5
    assert use.velocity == pytest.approx(15 / 8 * mean, rel=1e-4)
    use = joint_spline(LINE, np.array([0.0, 0.5]), LIMITS, quintic=False)
    assert use.velocity == pytest.approx(3 / 2 * mean, rel=1e-4)


def test_references_are_found_again(tmp_path: Path) -> None:
    path = tmp_path / 'results' / 'reference.json'
    ReferenceFile(path).put('a key', 'a trajectory', 'full', TIMES)
    assert json.loads(path.read_text(encoding='utf-8'))['a key']['name'] == 'a trajectory'
    assert ReferenceFile(path)['a key'] == TIMES
    assert 'a key' not in ReferenceFile(path, forget=True)
    assert TIMES.sound()


def test_the_digest_knows_points_and_limits() -> None:
    keys = {
        digest(LINE, LIMITS),
        digest(LINE[::-1], LIMITS),
        digest(LINE, limit_set('half')),
    }
    assert len(keys) == 3


def test_the_optimum_of_a_straight_line_is_ruckigs() -> None:
    pytest.importorskip('scipy')
    from benchmark.optimum import jerk_limited_optimum
    from benchmark.spline_path import spline_path

    optimum = jerk_limited_optimum(spline_path(LINE, LIMITS.velocity), LIMITS)
    truth = stop_and_go(LINE, LIMITS).duration
    assert truth <= optimum.profile.duration <= 1.01 * truth


def test_the_optimum_keeps_the_limits_when_it_is_sampled_in_time() -> None:
    pytest.importorskip('scipy')
    from benchmark.optimum import jerk_limited_optimum
    from benchmark.spline_path import spline_path

    path = spline_path(CURVE, LIMITS.velocity)
    optimum = jerk_limited_optimum(path, LIMITS)
    times = np.arange(0.0, optimum.profile.duration, 1e-3)
    positions, *_ = path.at(optimum.profile.parameters_at(times))
    for order, limit in ((1, LIMITS.velocity), (2, LIMITS.acceleration), (3, LIMITS.jerk)):
        use = np.abs(np.diff(positions, order, axis=0)) / 1e-3**order / limit
        assert use.max() <= 1.005
    assert max(optimum.velocity, optimum.acceleration) <= 1.001
    assert optimum.jerk <= 1.01
    for point in CURVE:
        assert np.min(np.max(np.abs(positions - point), axis=1)) < 0.02


@pytest.mark.slow
def test_the_optimum_on_a_free_path_is_faster_and_within_the_limits() -> None:
    pytest.importorskip('scipy')
    from benchmark.optimum import free_path_optimum, jerk_limited_optimum
    from benchmark.spline_path import spline_path

    points = np.vstack([CURVE, CURVE[:1]])
    spline = jerk_limited_optimum(spline_path(points, LIMITS.velocity), LIMITS)
    free = free_path_optimum(points, LIMITS)
    assert free is not None
    assert free.duration < 0.99 * spline.profile.duration
    assert max(free.velocity, free.acceleration) <= 1.001
    assert free.jerk <= 1.01
    assert free_path_optimum(LINE, LIMITS) is None


def test_topp_ra_is_a_bound() -> None:
    pytest.importorskip('scipy')
    pytest.importorskip('toppra')
    from benchmark.references import compute

    for points in (LINE, CURVE):
        times = compute(points, LIMITS)
        assert times.sound()
        assert times.toppra < times.opt <= 1.01 * times.ptp
