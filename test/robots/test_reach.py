# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The reach that is computed from the chain is an upper bound that is nearly attained."""

import numpy as np
import pytest
from support.examples import one_in

from epson_driver.robots import load_robot_model, robot_models
from epson_driver.robots.kinematics import Kinematics

NEAR = {'six-axis': 0.995, 'SCARA': 0.999}
"""Fraction of the reach that the tool must attain in some pose."""


@pytest.mark.parametrize('name', one_in(25, robot_models()))
def test_reach_is_a_tight_upper_bound(name: str) -> None:
    model = load_robot_model(name)
    arm = Kinematics(model)
    types = model.joint_types
    random = np.random.default_rng(0)
    bends = np.array([0.0, np.pi / 2, -np.pi / 2, np.pi])
    most = np.zeros(len(types))
    for number in range(600):  # every second pose has right angles only, where extremes are
        angles = random.uniform(-np.pi, np.pi, len(types))
        if number % 2:
            angles = random.choice(bends, len(types))
            angles[2:3] += random.uniform(-0.5, 0.5, 1)  # elbows with an offset
        for joint, kind in enumerate(types):
            if kind == 'prismatic':
                angles[joint] = model.limits.position_min[joint]
        frames = arm.link_frames(angles)
        tool = arm.forward(angles)[:3, 3]
        for joint, kind in enumerate(types):
            axis = frames[joint, :3, :3] @ model.chain.axes[joint]
            away = axis if kind == 'prismatic' else np.cross(axis, tool - frames[joint, :3, 3])
            most[joint] = max(most[joint], float(np.linalg.norm(away)))
    assert np.all(most <= model.reach + 1e-12)
    assert np.all(most >= NEAR[model.kind] * model.reach - 1e-12)


def test_reach_of_the_c3_is_the_sum_of_its_lengths() -> None:
    model = load_robot_model('c3_a601s')
    # 100, 250 and 250 mm to the wrist (the published 600 mm), and 65 mm to the flange
    np.testing.assert_allclose(model.reach, [0.665, 0.565, 0.315, 0.065, 0.065, 0.0], atol=1e-12)
