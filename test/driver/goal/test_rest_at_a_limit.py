# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""An arm at rest at a limit, with its position rounded to encoder pulses and float32.

MoveIt plans from there within the URDF's limits, and the driver accepts the plan. For any model.
"""

from xml.etree import ElementTree

import numpy as np
import pytest
from support.examples import one_in

from epson_driver.driver.goal.goal import Goal, checked_goal
from epson_driver.driver.outcome import GoalRejectedError
from epson_driver.motion import Array, Trajectory
from epson_driver.robots import RobotModel, load_robot_model, robot_models
from epson_driver.robots.urdf import urdf

each_model = pytest.mark.parametrize('name', one_in(5, robot_models()))

MAX_EXCESS = {'rad': 1e-4, 'm': 1e-5}
"""Maximum difference between a limit of the URDF and the arm's."""


def measured_at(model: RobotModel, limit: Array, outwards: float) -> Array:
    """Return possible measured joints at a limit, a pulse and a float32 step beyond it.

    An unknown pulse counts as 0.
    """
    pulse = np.nan_to_num(1.0 / np.abs(model.pulses_per_unit))
    beyond = (limit + np.copysign(pulse, outwards)).astype(np.float32)
    return np.nextafter(beyond, np.float32(outwards)).astype(float)


def goal(model: RobotModel, joints: Array) -> Goal:
    positions = np.array([joints, joints])
    return Goal(
        Trajectory(model.joint_names, np.array([0.0, 1.0]), positions),
        np.full(len(joints), 0.1),
        0,
    )


@each_model
def test_start_that_exceeds_a_limit_by_rounding_is_set_to_the_limit(name: str) -> None:
    model = load_robot_model(name)
    limits = model.limits
    root = ElementTree.fromstring(urdf(name))
    rows = {joint.get('name'): joint.find('limit') for joint in root.findall('joint')}
    for key, limit, outwards in (
        ('lower', limits.position_min, -np.inf),
        ('upper', limits.position_max, np.inf),
    ):
        wide = np.array([float(rows[joint].get(key)) for joint in model.joint_names])
        measured = measured_at(model, limit, outwards)
        beyond = np.abs(wide - limit)
        assert np.all(np.abs(measured - limit) <= beyond)
        assert np.all((wide <= measured) == (outwards < 0))
        assert np.all(beyond <= [MAX_EXCESS[unit] for unit in limits.units])
        for at in (measured, wide):
            taken = checked_goal(goal(model, at), limits).trajectory.positions
            assert np.all(taken == limit)


@each_model
def test_position_that_exceeds_a_limit_by_more_than_rounding_is_rejected(name: str) -> None:
    model = load_robot_model(name)
    limits = model.limits
    for joint, unit in enumerate(limits.units):
        joints = np.clip(np.zeros(len(limits.names)), limits.position_min, limits.position_max)
        joints[joint] = limits.position_max[joint] + MAX_EXCESS[unit]
        with pytest.raises(GoalRejectedError, match=f'{limits.names[joint]}: position'):
            checked_goal(goal(model, joints), limits)
