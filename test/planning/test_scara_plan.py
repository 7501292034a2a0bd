# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Tasks and plans of SCARAs, and of six-axis arms of other sizes than the C3."""

import dataclasses

import numpy as np
import pytest

pytest.importorskip('ompl')  # no wheel for Python 3.14

from epson_driver.motion import problems
from epson_driver.motion.motion_figures import measure
from epson_driver.planning.path import dense
from epson_driver.planning.plan import MOTION_MARGIN_M, plan_task
from epson_driver.planning.scene import Scene
from epson_driver.planning.task import draw_task, raised
from epson_driver.planning.verdict import judge
from epson_driver.planning.workspace import TABLE, workspace
from epson_driver.robots import RobotModel, load_robot_model, robot_models
from epson_driver.robots.kinematics import Kinematics
from epson_driver.robots.model import SCARA

MODELS = [load_robot_model(name) for name in robot_models()]
SCARAS = [model for model in MODELS if model.kind == SCARA]


SOME = ('gx8_c652s', 'rs6_c552s', 'c8_c901s')
"""One that stands, one that hangs, one with six axes; the others are slow tests."""


def named(model: RobotModel) -> str:
    return model.name


def some_at_once(models: list[RobotModel]) -> list[object]:
    return [
        model if model.name in SOME else pytest.param(model, marks=pytest.mark.slow)
        for model in models
    ]


@pytest.mark.parametrize('model', some_at_once(MODELS), ids=named)
def test_home_is_free_and_the_hand_points_down(model: RobotModel) -> None:
    task = draw_task(1, model)
    scene = Scene(model, task.obstacles, task.part, task.supports)
    home = scene.workspace.home
    assert np.all(home > model.limits.position_min)
    assert np.all(home < model.limits.position_max)
    assert scene.check(task.pick, margin=0.01, self_margin=0.002).valid(home)
    pose = scene.hand_pose(home)
    assert pose == pytest.approx(Kinematics(model, scene.workspace.hand.frame).forward(home))
    assert pose[2, 2] < -0.5


@pytest.mark.parametrize('model', some_at_once(SCARAS), ids=named)
def test_a_scara_reaches_every_part_and_has_to_go_around_every_pillar(model: RobotModel) -> None:
    work = workspace(model)
    arm = Kinematics(model, work.hand.frame)
    tip = work.table + work.pillars[0] + work.hand.length  # of a tool0 whose gripper is above them
    assert tip > arm.forward(work.home)[2, 3]
    for seed in range(1, 30):
        task = draw_task(seed, model)
        for pose in (task.pick, task.place):
            for height in (0.0, work.approach):
                assert len(arm.inverse(raised(pose, height), work.home)), (seed, height)
        for shape in task.obstacles:
            tall = shape.length if hasattr(shape, 'length') else shape.size[2]
            assert shape.centre[2] - tall / 2 >= work.table - 1e-9


def test_the_table_of_a_scara_is_below_its_foot_or_far_below_a_base_that_hangs() -> None:
    for model in SCARAS:
        work = workspace(model)
        hangs = bool(model.chain.origins[:, 2].sum() < 0.0)
        assert (work.table < -0.3) == hangs
        assert work.table <= 0.0
        assert {shape.name for shape in work.fixed} <= {TABLE, 'stand', 'beam', 'post'}


def test_an_arm_of_another_kind_is_refused() -> None:
    model = dataclasses.replace(SCARAS[0], joint_types=('revolute',) * 4)
    with pytest.raises(ValueError, match='tasks are drawn for six-axis or SCARA arms'):
        draw_task(1, model)


@pytest.mark.parametrize(
    'name',
    ['gx8_c652s', *(pytest.param(n, marks=pytest.mark.slow) for n in ('rs6_c552s', 'gx4_c251s'))],
)
def test_a_scara_carries_the_part_around_the_pillars(name: str) -> None:
    """Within all limits of range, velocity, acceleration and jerk, and clear of everything."""
    model = load_robot_model(name)
    plan = plan_task(draw_task(1, model), model)
    for motion in plan.motions:
        assert list(problems(motion.sent, model.limits)) == []
        figures = measure(motion.expected, None, model.limits)
        assert max(figures.velocity, figures.acceleration) <= 1.0
        assert figures.jerk <= 1.02
        check = plan.scene.check(motion.standing)
        nearest = min(check.clearance(joints).obstacles for joints in motion.expected.positions)
        assert nearest >= MOTION_MARGIN_M - 1e-6
        verdict = judge(plan, motion, motion.expected.times, motion.expected.positions)
        assert not verdict.collides
        assert verdict.reached
        assert verdict.stops == 0
    straight = plan.motions[1].expected.positions[[0, -1]]  # with the part, without the pillars
    metric = plan.scene.workspace.metric
    assert not plan.scene.check(None).path_valid(dense(straight, metric))


@pytest.mark.parametrize(
    'model',
    [
        pytest.param(model, marks=pytest.mark.slow if model.name in SOME else pytest.mark.soak)
        for model in MODELS
    ],
    ids=named,
)
def test_every_model_has_plans(model: RobotModel) -> None:
    for seed in (2, 3):
        plan = plan_task(draw_task(seed, model), model)
        for motion in plan.motions:
            assert judge(plan, motion, motion.expected.times, motion.expected.positions).reached
