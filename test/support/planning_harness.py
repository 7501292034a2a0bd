# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A small world for the planner's tests."""

import numpy as np
import pytest

pytest.importorskip('pinocchio')

from epson_driver.motion import Array
from epson_driver.planning.scene import Scene
from epson_driver.planning.shapes import Shape, standing
from epson_driver.planning.task import Task, gripping
from epson_driver.robots import load_robot_model

MODEL = load_robot_model('c3_a601s')
PART = (0.04, 0.04, 0.05)
PILLAR = standing('pillar', (0.08, 0.08, 0.6), 0.40, 0.0)

# the tool down beside the pillar, at the same height on both sides
LEFT = np.array([0.8, -0.3, 0.2, 0.0, -1.47, 0.0])
RIGHT = LEFT * (-1, 1, 1, 1, 1, 1)


def scene(*obstacles: Shape, supports: tuple[str, ...] = ('table',)) -> Scene:
    return Scene(MODEL, obstacles, PART, supports)


def task(*obstacles: Shape, pick: Array | None = None) -> Task:
    """Return a task from the left to the right."""
    pick = gripping(0.25, 0.3, PART[2], 0.1) if pick is None else pick
    return Task(1, PART, pick, gripping(0.25, -0.3, PART[2], 0.0), obstacles, ('table',))
