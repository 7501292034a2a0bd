# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The models that EPSON's ROS 2 package lacks, compared with other sources."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import yaml
from test_published_arms import PUBLISHED

from epson_driver.motion import Array
from epson_driver.robots import RobotModel, load_robot_model, robot_models
from epson_driver.robots.kinematics import Kinematics
from epson_driver.robots.opw import opw_parameters

SHEET = yaml.safe_load(Path(__file__).with_name('sheet_arms.yaml').read_text('utf-8'))
SCARAS, SIX_AXES = SHEET['scara'], SHEET['six-axis']

CLOSE_MM = 1.0
NARROWER_DEG = 1.0
"""Tolerance of ranges, because some sources round to whole degrees."""

SLOWER = 0.95
"""Tolerance of speeds. The models have the lower one of different published speeds."""

each_scara = pytest.mark.parametrize('name', SCARAS)
each_six_axis = pytest.mark.parametrize('name', SIX_AXES)


def figures(row: str) -> tuple[Array, ...]:
    """Return reach, lengths, ranges (shape (n, 2)), speeds, and an optional height."""
    reach, lengths, ranges, *more = (
        np.array(item.split(), dtype=float) for item in row.split(';')
    )
    return reach, lengths, ranges.reshape(-1, 2), *more


def assert_limits(model: RobotModel, ranges: Array, speeds: Array) -> None:
    limits, shown = model.limits, model.shown_per_unit
    inwards = [
        limits.position_min * shown - ranges[:, 0],
        ranges[:, 1] - limits.position_max * shown,
    ]
    assert np.all(np.array(inwards) >= -1e-9)
    assert np.all(np.array(inwards) <= NARROWER_DEG)
    fraction = limits.velocity * shown / speeds
    assert np.all(fraction <= 1.0005)
    assert np.all(fraction >= SLOWER)


def test_every_model_is_published_or_in_the_data_sheets() -> None:
    names = [name.lower().replace('-', '_') for name in (*PUBLISHED, *SCARAS, *SIX_AXES)]
    assert sorted(names) == list(robot_models())


@each_scara
def test_scara_has_its_lengths_ranges_and_speeds(name: str) -> None:
    model = load_robot_model(name)
    reach, (one, two, stroke), turns, speeds, *height = figures(SCARAS[name])
    assert model.reach[0] * 1e3 == pytest.approx(reach[0], abs=CLOSE_MM)
    assert_limits(model, np.insert(turns, 2, (-stroke, 0.0), axis=0), speeds)

    arm, limits = Kinematics(model), model.limits
    for joints in np.random.default_rng(1).uniform(
        limits.position_min, limits.position_max, (8, 4)
    ):
        xyz, uvw = arm.epson_point(joints)
        elbow, both = joints[0], joints[0] + joints[1]
        expected = [
            one * np.cos(elbow) + two * np.cos(both),
            one * np.sin(elbow) + two * np.sin(both),
            1e3 * joints[2],
        ]
        np.testing.assert_allclose(xyz * 1e3, expected, rtol=0, atol=CLOSE_MM)
        assert np.cos(uvw[0] - both - joints[3]) == pytest.approx(1.0)
    if height:
        end = arm.forward(np.zeros(4))[2, 3]
        assert end * 1e3 == pytest.approx(height[0][0], abs=CLOSE_MM)


@each_six_axis
def test_six_axis_arm_has_its_lengths_ranges_and_speeds(name: str) -> None:
    model = load_robot_model(name)
    reach, lengths, turns, speeds = figures(SIX_AXES[name])
    wrist = model.reach[0] - model.reach[4]
    assert wrist * 1e3 == pytest.approx(reach[0], abs=CLOSE_MM)
    assert_limits(model, turns, speeds)
    result = opw_parameters(model).lengths
    shown = [result['c1'], result['a1'], result['c2'], -result['a2'], result['c3'], result['c4']]
    np.testing.assert_allclose(np.array(shown) * 1e3, lengths, rtol=0, atol=CLOSE_MM)

    # these points do not depend on the split of the chain
    arm, zero = Kinematics(model), np.zeros(6)
    links = arm.link_frames(zero)[:, :3, 3]
    points = [links[1], links[2], links[4], arm.forward(zero)[:3, 3]]
    steps = [np.linalg.norm(there - here) * 1e3 for here, there in pairwise(points)]
    expected = [lengths[2], np.hypot(lengths[3], lengths[4]), lengths[5]]
    assert steps == pytest.approx(expected, abs=CLOSE_MM)
