# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What collides in the planner's world, and its triangles."""

import numpy as np
import pytest
from support.planning_harness import LEFT, MODEL, PART, PILLAR, scene

from epson_driver.planning.scene import MAX_CONTACT_DEPTH_M
from epson_driver.planning.shapes import Box, Cylinder, tray
from epson_driver.planning.task import gripping, raised
from epson_driver.planning.triangles import Picture
from epson_driver.planning.workspace import HOME_RAD
from epson_driver.robots.kinematics import Kinematics

ELSEWHERE = gripping(-0.3, 0.5, PART[2], 0.0)


def test_tool0_is_where_the_kinematics_have_it():
    arm, world = Kinematics(MODEL), scene()
    for joints in np.random.default_rng(1).uniform(-1.0, 1.0, (20, 6)):
        assert world.hand_pose(joints) == pytest.approx(arm.forward(joints), abs=1e-9)


def test_an_arm_at_home_is_free():
    check = scene(PILLAR).check(ELSEWHERE, margin=0.01, self_margin=0.002)
    assert check.valid(np.array(HOME_RAD))
    clearance = check.clearance(np.array(HOME_RAD))
    assert not clearance.collides
    assert clearance.obstacles > 0.01


def test_a_wall_through_the_arm_is_a_collision():
    wall = Box('wall', (0.02, 2.0, 2.0), (0.15, 0.0, 0.5))
    check = scene(wall).check(ELSEWHERE)
    assert not check.valid(np.array(HOME_RAD))
    clearance = check.clearance(np.array(HOME_RAD))
    assert clearance.collides
    assert 'wall' in clearance.pair


@pytest.mark.parametrize(
    ('gap', 'margin', 'valid'),
    [(0.005, 0.0, True), (0.005, 0.01, False), (0.012, 0.01, True), (-0.001, 0.0, False)],
)
def test_the_margin_is_kept_to_the_part_in_the_hand(gap, margin, valid):
    arm, world = Kinematics(MODEL), None
    pose = gripping(0.3, 0.3, 0.2, 0.0)
    joints = arm.inverse(pose, LEFT)[0]
    post = Cylinder('post', 0.02, 0.1, (0.3, 0.3, 0.2 - PART[2] - gap - 0.05))
    world = scene(post)
    assert world.check(None, margin=margin).valid(joints) == valid
    assert world.check(None).clearance(joints).obstacles == pytest.approx(gap, abs=1e-4)


def test_what_folds_into_itself_collides():
    world = scene()
    world.obstacles = ()  # nor a table
    clearance = world.check(ELSEWHERE).clearance(np.array([0.0, -2.75, -0.85, 0.0, 0.0, 0.0]))
    assert clearance.links < 0.0
    assert clearance.collides


def test_the_part_may_stand_on_its_support_but_not_in_it():
    arm = Kinematics(MODEL)
    pose = gripping(0.3, 0.3, PART[2], 0.0)
    for depth, touching in (
        (0.0, True),
        (MAX_CONTACT_DEPTH_M / 2, True),
        (2 * MAX_CONTACT_DEPTH_M, False),
    ):
        joints = arm.inverse(raised(pose, -depth), LEFT)[0]
        check = scene().check(None)
        assert check.valid(joints) == touching
        assert check.clearance(joints).collides != touching
    joints = arm.inverse(pose, LEFT)[0]
    assert not scene(supports=()).check(None, margin=0.01).valid(joints)
    assert not scene().check(None, margin=0.01, touching=False).valid(joints)
    assert scene().check(pose, margin=0.01).valid(joints)  # the gripper on the standing part


def test_a_part_that_stands_in_the_way_is_an_obstacle():
    arm = Kinematics(MODEL)
    pose = gripping(0.3, 0.3, PART[2], 0.0)
    joints = arm.inverse(raised(pose, -0.03), LEFT)[0]  # the gripper inside of the part
    assert scene().check(ELSEWHERE).valid(joints)
    assert scene().check(pose).clearance(joints).pair == ('gripper', 'part')


def test_the_robot_may_stand_on_its_table():
    clearance = scene().check(ELSEWHERE).clearance(np.array(HOME_RAD))
    assert clearance.obstacles > 0.05  # all links but the base


def test_a_tray_is_open_above_and_closed_around():
    floor, *walls = tray('tray', 0.2, 0.08, 0.01, 0.3, 0.1, 0.5)
    assert floor.size == (0.2, 0.2, 0.01)
    assert len(walls) == 4
    distances = {
        round(float(np.hypot(wall.centre[0] - 0.3, wall.centre[1] - 0.1)), 6) for wall in walls
    }
    assert distances == {0.105}
    assert {wall.centre[2] for wall in walls} == {0.04}


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
