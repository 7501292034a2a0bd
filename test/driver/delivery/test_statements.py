# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Plans for a controller without a program: only a line of the tool is one statement, `Move`."""

from dataclasses import replace
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from epson_driver.driver.delivery.delivery import delivery_rules
from epson_driver.driver.delivery.statements import Statement, StatementDelivery
from epson_driver.driver.outcome import GoalRejectedError
from epson_driver.driver.state.joint_mapping import unmapped
from epson_driver.motion import Trajectory
from epson_driver.panel.jog import Jog
from epson_driver.profiles import load_controller_profile
from epson_driver.robots import load_robot_model
from epson_driver.robots.kinematics import Kinematics

C3, T6 = load_robot_model('c3_a601s'), load_robot_model('t6_602s')
HERE = {
    'c3_a601s': np.array([0.3, -0.2, 0.1, 0.2, -1.2, 0.4]),
    't6_602s': np.array([0.4, 0.6, -0.05, 0.2]),
}
FAR = 0.08  # m or rad: joints move more than `AT_START`


def text_of(model: Any, trajectory: Trajectory, *, arm: bool = True) -> str:
    rules = delivery_rules(load_controller_profile('remote'), 'statements', 'joint_traj_pt')
    delivery = StatementDelivery(Mock(), model.limits, unmapped(len(model.joint_names)), rules)
    delivery.arm = Kinematics(model) if arm else None
    prepared = delivery.prepare(trajectory, HERE[model.name])
    (message,) = prepared.messages
    assert isinstance(message, Statement)
    return message.text


def step(model: Any, axis: str, size: float = FAR) -> Trajectory:
    return Jog(model).step(HERE[model.name], axis, 'world', size, 1.0)


@pytest.mark.parametrize('model', [C3, T6], ids=['c3', 't6'])
def test_line_of_the_tool_is_one_move_no_faster_than_the_plan(model: Any) -> None:
    plan = step(model, 'X', -FAR)
    text = text_of(model, plan)
    assert 'Move JA(' in text
    speed = float(text.partition('SpeedS ')[2].partition(';')[0]) / 1e3
    assert speed == pytest.approx(FAR / plan.duration, rel=1e-3)


def test_turn_of_the_tool_in_place_is_one_move_with_the_parameter_rot() -> None:
    plan = step(C3, 'U')
    text = text_of(C3, plan)
    assert text.endswith(' ROT')
    turn = np.radians(float(text.partition('SpeedR ')[2].partition(';')[0]))
    assert turn == pytest.approx(FAR / plan.duration, rel=1e-3)


def test_plan_that_is_no_line_of_the_tool_is_rejected() -> None:
    plan = step(C3, 'X')
    share = np.linspace(0.0, 1.0, len(plan.times))
    bend = np.outer(np.sin(np.pi * share), [2e-3, 0, 0, 0, 0, 0])
    forth = plan.positions[: len(plan.times) * 3 // 4]
    cases = {
        'a bend of 2 mrad': replace(plan, positions=plan.positions + bend, velocities=None),
        'forth and back': Trajectory(
            plan.joint_names,
            np.arange(1.0, 2 * len(forth)),
            np.vstack([forth, forth[: len(forth) // 2 : -1], forth])[: 2 * len(forth) - 1],
        ),
        'few points': Trajectory(
            plan.joint_names, plan.times[[0, 5, -1]], plan.positions[[0, 5, -1]]
        ),
    }
    for trajectory in cases.values():
        with pytest.raises(GoalRejectedError, match='a plan of'):
            text_of(C3, trajectory)
    with pytest.raises(GoalRejectedError, match='a plan of'):
        text_of(C3, plan, arm=False)
