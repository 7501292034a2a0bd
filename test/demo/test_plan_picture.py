# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The picture of an executed plan, whose triangles become an image."""

import numpy as np
import pytest

pytest.importorskip('pinocchio')
pytest.importorskip('ompl')

from epson_driver.demo.plan_picture import halved, rasterised, view

RED, BLUE = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)

FROM_ABOVE = view(0.0, np.pi / 2)

EXTENT = (-1.0, 1.0, -1.0, 1.0)


def flat(height, half):
    """Return two triangles, a square at this height, seen from above."""
    a, b, c, d = ((x * half, y * half, height) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1)))
    return np.array([(a, b, c), (a, c, d)], dtype=float)


def drawn(*squares):
    corners = np.concatenate([square for square, _ in squares])
    colours = np.array([colour for _, colour in squares for _ in range(2)])
    return rasterised(corners, colours, FROM_ABOVE, EXTENT, 40)


@pytest.mark.parametrize('order', [1, -1])
def test_the_nearer_one_is_seen_whatever_comes_first(order):
    squares = [(flat(0.0, 0.8), RED), (flat(0.5, 0.3), BLUE)][::order]
    image = drawn(*squares)
    assert image.shape == (40, 40, 4)
    assert image[20, 20, 2] > 0.5
    assert image[20, 20, 0] == 0.0
    assert image[20, 8, 0] > 0.5
    assert image[1, 1, 3] == 0.0


def test_what_is_seen_from_behind_is_not_drawn():
    image = drawn((flat(0.0, 0.8)[:, ::-1], RED))
    assert not image.any()


def test_triangles_without_area_and_outside_of_the_picture_are_left_out():
    beside = flat(0.0, 0.5) + np.array([5.0, 5.0, 0.0])
    image = drawn((np.zeros((2, 3, 3)), RED), (beside, RED), (flat(0.0, 9.0), BLUE))
    assert (image[..., 3] == 1.0).all()
    assert (image[..., 0] == 0.0).all()


def test_half_the_size_keeps_colours_and_softens_edges():
    image = np.zeros((4, 4, 4))
    image[:, 1:] = (1.0, 0.0, 0.0, 1.0)
    small = halved(image)
    assert small.shape == (2, 2, 4)
    assert small[0, 0] == pytest.approx((1.0, 0.0, 0.0, 0.5))
    assert small[0, 1] == pytest.approx((1.0, 0.0, 0.0, 1.0))


def test_the_eye_looks_along_its_direction():
    axes = view(0.3, 0.4)
    assert axes @ axes.T == pytest.approx(np.eye(3), abs=1e-12)
    assert axes[0, 2] == 0.0
    assert axes[1, 2] > 0.0
