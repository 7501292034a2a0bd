# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Paths of blended lines and arcs: smooth seams, corners and refusals."""

import numpy as np
import pytest

from epson_driver.tool_motion.pose_path import BlendError, arc, line, runs
from epson_driver.tool_motion.tool_pose import homogeneous, rotation


def pose(*place, turn=(0.0, 0.0, 0.0)):
    """Return a pose at x y z, m, turned by a rotation vector, rad."""
    return homogeneous(rotation(np.array(turn, dtype=float)), np.array(place, dtype=float))


START = pose(0.0, 0.0, 0.0)
CORNER = pose(0.2, 0.0, 0.0, turn=(0.0, 0.4, 0.0))
END = pose(0.2, 0.2, 0.05, turn=(0.3, 0.0, 0.2))
SEGMENTS = {
    'line, line': [line(START, CORNER), line(CORNER, END)],
    'line, arc': [line(START, CORNER), arc(CORNER, np.array([0.25, 0.1, 0.0]), END)],
    'arc, line': [arc(START, np.array([0.1, 0.04, 0.0]), CORNER), line(CORNER, END)],
    'there and back': [line(START, CORNER), line(CORNER, pose(0.05, 0.0, 0.0))],
}


@pytest.mark.parametrize('segments', SEGMENTS.values(), ids=SEGMENTS)
def test_seams_have_two_continuous_derivatives(segments):
    (run,) = runs(segments, [0.03])
    assert len(run.parts) == 3
    for before, after in zip(run.parts[:-1], run.parts[1:], strict=True):
        np.testing.assert_allclose(before.pose(1.0), after.pose(0.0), atol=1e-12)
        scales = [path.length ** np.arange(1, 4)[:, None] for path in (before, after)]
        there = before.derivatives(1.0) / scales[0]
        here = after.derivatives(0.0) / scales[1]
        np.testing.assert_allclose(there[:2], here[:2], atol=1e-9)


@pytest.mark.parametrize('segments', SEGMENTS.values(), ids=SEGMENTS)
def test_derivatives_match_the_poses(segments):
    (run,) = runs(segments, [0.03])
    step = 1e-4
    for part in run.parts:
        for fraction in (0.2, 0.5, 0.7):
            first, second, third = part.derivatives(fraction)[:, :3]
            places = [part.pose(fraction + k * step)[:3, 3] for k in (-2, -1, 0, 1, 2)]
            assert np.allclose((places[3] - places[1]) / (2 * step), first, atol=1e-6)
            assert np.allclose(
                (places[3] - 2 * places[2] + places[1]) / step**2, second, atol=1e-5
            )
            by_third = (places[4] - 2 * places[3] + 2 * places[1] - places[0]) / (2 * step**3)
            assert np.allclose(by_third, third, atol=1e-2)


@pytest.mark.parametrize('radius', [0.001, 0.05, 0.19])
def test_blend_is_within_its_radius_and_path_speed(radius):
    (run,) = runs(SEGMENTS['line, line'], [radius])
    corner = CORNER[:3, 3]
    blend = run.parts[1]
    places = np.array([blend.pose(fraction)[:3, 3] for fraction in np.linspace(0, 1, 200)])
    away = np.linalg.norm(places - corner, axis=1)
    assert away.max() <= radius * (1 + 1e-9)
    assert 0.1 * radius < away.min() < radius
    for fraction in np.linspace(0.0, 1.0, 50):
        assert np.linalg.norm(blend.derivatives(fraction)[0, :3]) <= blend.length * (1 + 1e-9)
    # the path outside the blend equals the segments
    assert run.seams[-1] == pytest.approx(0.2 + SEGMENTS['line, line'][1].length)


def test_blend_longer_than_the_segment_is_refused():
    with pytest.raises(
        BlendError, match=r'the motion is 0\.2 m long, shorter than the blend of 0\.21 m'
    ):
        runs(SEGMENTS['line, line'], [0.21])
    back = [*SEGMENTS['line, line'], line(END, START)]
    with pytest.raises(
        BlendError, match=r'shorter than the blend of 0\.15 m and 0\.06 m'
    ) as caught:
        runs(back, [0.15, 0.06])
    assert caught.value.index == 1
    spot = [line(START, pose(0.0, 0.0, 0.0, turn=(0.5, 0.0, 0.0))), line(START, CORNER)]
    with pytest.raises(BlendError, match=r'the motion is 0 m long'):
        runs(spot, [0.01])


def test_pure_rotation_is_a_separate_run():
    turned = pose(0.2, 0.0, 0.0, turn=(0.0, 0.4, 0.5))
    result = runs([line(START, CORNER), line(CORNER, turned)], [0.0])
    assert result[1].seams[-1] == pytest.approx(result[1].parts[0].angle)
