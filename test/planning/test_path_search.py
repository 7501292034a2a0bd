# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Ways around a pillar, the same for the same seed, and their corners."""

from itertools import pairwise

import numpy as np
import pytest
from support.planning_harness import LEFT, MODEL, PILLAR, RIGHT, scene

pytest.importorskip('ompl')  # no wheel for Python 3.14

from epson_driver.planning.path import dense, line, rounded, thinned
from epson_driver.planning.path_search import CHECK_SPACING_RAD, find_path
from epson_driver.planning.shapes import standing
from epson_driver.planning.task import gripping

AWAY = gripping(-0.3, 0.5, 0.05, 0.0)
FREE = scene(PILLAR).check(AWAY, margin=0.01, self_margin=0.002)
BARE = scene(PILLAR).check(AWAY)


def test_the_straight_line_goes_through_the_pillar_and_is_caught():
    straight = line(LEFT, RIGHT)
    assert FREE.valid(LEFT)
    assert FREE.valid(RIGHT)
    assert not BARE.path_valid(straight)


def test_the_way_found_goes_around_it():
    way = find_path(LEFT, RIGHT, MODEL.limits, FREE.valid, 1)
    assert way is not None
    assert way[0] == pytest.approx(LEFT)
    assert way[-1] == pytest.approx(RIGHT)
    finer = np.concatenate([np.linspace(a, b, 400) for a, b in pairwise(way)])
    assert BARE.path_valid(finer)  # the margin covers what lies between the places checked
    assert (finer >= MODEL.limits.position_min).all()
    assert (finer <= MODEL.limits.position_max).all()


@pytest.mark.slow
def test_the_same_seed_gives_the_same_way_whatever_came_before():
    ways = [find_path(LEFT, RIGHT, MODEL.limits, FREE.valid, seed) for seed in (1, 2, 1)]
    assert np.array_equal(ways[0], ways[2])
    assert not np.array_equal(ways[0], ways[1])


def test_no_way_out_of_a_cage():
    def caged(joints):
        return bool(np.abs(joints - LEFT).max() < 0.1 or np.abs(joints - RIGHT).max() < 0.1)

    assert find_path(LEFT, RIGHT, MODEL.limits, caged, 1) is None


def test_a_goal_that_is_not_free_has_no_way():
    assert find_path(LEFT, np.zeros(6), MODEL.limits, lambda q: bool(q[0] > 0.5), 1) is None


CORNERS = np.array([[0, 0, 0, 0, 0, 0], [1, 0, 0, 0, 0, 0], [1, 1, 0, 0, 0, 0]], dtype=float)


def turns(path):
    steps = np.diff(path, axis=0)
    steps /= np.linalg.norm(steps, axis=1)[:, None]
    return np.arccos(np.clip(np.sum(steps[1:] * steps[:-1], axis=1), -1.0, 1.0))


def test_corners_become_round_and_the_ends_stay():
    pieces = [line(a, b) for a, b in pairwise(CORNERS)]
    path = rounded(pieces, lambda _: True)
    assert path[0] == pytest.approx(CORNERS[0])
    assert path[-1] == pytest.approx(CORNERS[-1])
    assert turns(path).max() < 0.1
    assert np.linalg.norm(path - CORNERS[1], axis=1).min() > 0.05
    assert np.abs(np.diff(path, axis=0)).max() <= 1.01 * CHECK_SPACING_RAD


def test_a_corner_without_room_stays():
    pieces = [line(a, b) for a, b in pairwise(CORNERS)]
    path = rounded(pieces, lambda _: False)
    assert np.linalg.norm(path - CORNERS[1], axis=1).min() == pytest.approx(0.0, abs=1e-9)


def test_a_corner_is_rounded_as_far_as_there_is_room():
    def near_the_corner(bend):
        return bool(np.linalg.norm(bend - CORNERS[1], axis=1).max() < 0.2)

    path = rounded([line(a, b) for a, b in pairwise(CORNERS)], near_the_corner)
    nearest = np.linalg.norm(path - CORNERS[1], axis=1).min()
    assert 0.0 < nearest < 0.1
    assert turns(path).max() < 0.5


def test_points_for_the_smoother_are_even_and_hold_both_ends():
    path = thinned(dense(CORNERS), 0.3)
    assert path[0] == pytest.approx(CORNERS[0])
    assert path[-1] == pytest.approx(CORNERS[-1])
    assert len(path) == 8
    assert np.linalg.norm(np.diff(path, axis=0), axis=1).max() <= 0.3


def test_a_second_pillar_is_no_part_of_the_first_scene():
    both = scene(PILLAR, standing('other', (0.3, 0.3, 0.9), 0.25, 0.3)).check(AWAY)
    assert not both.valid(LEFT)
    assert BARE.valid(LEFT)
