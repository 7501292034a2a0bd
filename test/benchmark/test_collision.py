# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The collision benchmark compares two checks that answer the same questions."""

import numpy as np
import pytest

from benchmark.collision import (
    CELL,
    MARGIN_M,
    MIN_DISTANCE_RATIO,
    QUESTIONS,
    Checker,
    Result,
    measure,
)
from epson_driver.robots import load_robot_model

pytest.importorskip('pinocchio')

MODEL = load_robot_model('c3_a601s')


@pytest.fixture(scope='module')
def checkers() -> tuple[Checker, Checker]:
    return Checker(MODEL, False, CELL), Checker(MODEL, True, CELL)


def test_collision_meshes_are_nowhere_farther_apart_than_the_visual_ones(
    checkers: tuple[Checker, Checker],
) -> None:
    visual, collision = checkers
    limits = MODEL.limits
    positions = np.random.default_rng(3).uniform(limits.position_min, limits.position_max, (25, 6))
    for position in positions:
        seen, checked = visual.distance(position), collision.distance(position)
        assert checked <= seen + 1e-6
        if seen > 0.0:
            assert checked > seen - 0.03  # they enclose closely
        assert visual.touches(position) <= collision.touches(position)
        assert collision.touches(position) == (checked <= 0.0)
        assert collision.near(position) == (checked <= MARGIN_M)


def test_the_cell_is_there_and_only_the_moving_links_meet_it(
    checkers: tuple[Checker, Checker],
) -> None:
    down = np.radians([0.0, -100.0, 0.0, 0.0, 0.0, 0.0])  # the arm lies on the table
    for checker in checkers:
        assert checker.touches(down)
        assert not checker.touches(np.zeros(6))
    assert not Checker(MODEL, True).touches(down)


def test_what_is_measured() -> None:
    results = measure(configurations=3)
    assert results.keys() == QUESTIONS.keys()
    assert all(result.visual > 0.0 and result.collision > 0.0 for result in results.values())
    assert Result(6.0, 0.2, (0, 0)).ratio == pytest.approx(30.0)
    assert MIN_DISTANCE_RATIO in {least for _, least in QUESTIONS.values()}
