# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The ray tracer of the pictures: what is where, lit from the right side, with a shadow."""

import numpy as np
import pytest

trimesh = pytest.importorskip('trimesh')
pytest.importorskip('embreex')

from generate.render import BACKGROUND, Body, Camera, corner_normals, render  # noqa: E402

SIZE = (80, 60)
CAMERA = Camera(eye=(0.0, -4.0, 1.5), target=(0.0, 0.0, 0.3), height=1.6)


def cube():
    return trimesh.creation.box(
        (0.4, 0.4, 0.6), trimesh.transformations.translation_matrix((0, 0, 0.3))
    )


def seen_at(point):
    """Return the pixel (right, down) at which CAMERA sees a point; it looks along y."""
    forward = np.subtract(CAMERA.target, CAMERA.eye)
    right = np.array([1.0, 0.0, 0.0])
    up = np.cross(right, forward) / np.linalg.norm(forward)
    ray = np.subtract(point, CAMERA.eye)
    scale = SIZE[1] / CAMERA.height * (forward @ forward) / (ray @ forward)
    return SIZE[0] / 2.0 + ray @ right * scale, SIZE[1] / 2.0 - ray @ up * scale


def test_a_red_box_stands_on_the_floor_and_throws_a_shadow():
    picture = render([Body(cube(), (0.9, 0.1, 0.1))], CAMERA, SIZE, samples=16)
    assert picture.shape == (60, 80, 3)
    assert picture.dtype == np.uint8
    u, v = seen_at((0.0, -0.2, 0.3))
    red, green, _ = (int(value) for value in picture[round(v), round(u)])
    assert red > 3 * green
    sky = picture[0, 0] / 255.0
    assert sky == pytest.approx(BACKGROUND ** (1 / 1.1), abs=0.01)
    lit, dark = (
        picture[round(place[1]), round(place[0])].sum()
        for place in (seen_at((x, 0.3, 0.0)) for x in (0.9, -0.35))
    )
    assert dark < 0.9 * lit  # the sun is to the right in front


def test_the_same_picture_twice():
    bodies = [Body(cube(), (0.5, 0.5, 0.5))]
    assert np.array_equal(render(bodies, CAMERA, SIZE, 4), render(bodies, CAMERA, SIZE, 4))


def test_corners_of_a_cube_are_sharp_and_a_cylinder_is_round():
    box = cube()
    assert corner_normals(box) == pytest.approx(np.repeat(box.face_normals[:, None], 3, axis=1))
    tube = trimesh.creation.cylinder(1.0, 2.0, sections=32)
    side = np.abs(tube.face_normals[:, 2]) < 0.5
    normals = corner_normals(tube)[side]
    corners = tube.triangles[side]
    radial = corners * (1.0, 1.0, 0.0)
    assert np.sum(normals * radial, axis=2) == pytest.approx(1.0, abs=0.01)
