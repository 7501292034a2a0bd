# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The scene as triangles: closed surfaces whose outsides are outside."""

import numpy as np
import pytest
from support.planning_harness import LEFT, PART, scene

from epson_driver.planning.shapes import Box, Cylinder
from epson_driver.planning.triangles import Picture


def volume(corners):
    """Return the volume inside of a closed surface, positive if its outside is outside."""
    return float(np.einsum('ki,ki->', corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6)


@pytest.mark.parametrize(
    ('shape', 'expected'),
    [
        (Box('a', (0.1, 0.2, 0.3), (0.5, 0.1, 0.2), 0.7), 0.006),
        (Cylinder('b', 0.1, 0.5, (0.1, 0.2, 0.3)), np.pi * 0.005),
    ],
)
def test_shapes_are_closed_and_face_outwards(shape, expected):
    corners, colours = Picture(scene(shape)).obstacles()
    assert volume(corners) == pytest.approx(expected, rel=0.01)
    assert corners.reshape(-1, 3).mean(axis=0) == pytest.approx(shape.centre, abs=0.01)
    assert colours.shape == (len(corners), 3)


def test_the_part_is_under_the_tool_that_holds_it():
    world = scene()
    picture = Picture(world)
    tool = world.hand_pose(LEFT)
    part, _ = picture.part(tool)
    assert volume(part) == pytest.approx(np.prod(PART))
    with_part, without = picture.arm(LEFT, holds=True)[0], picture.arm(LEFT, holds=False)[0]
    assert len(with_part) == len(without) + len(part)
    assert with_part[-len(part) :] == pytest.approx(part)
    assert np.linalg.norm(without - tool[:3, 3], axis=-1).min() < 0.05
