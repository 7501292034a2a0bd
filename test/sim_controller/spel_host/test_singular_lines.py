# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Lines past a singularity, with the initial AvoidSingularity (SPEL+ reference, p. 157)."""

import logging

import numpy as np
import pytest
from support.examples import one_in
from support.spel_program_harness import SpelProgramHarness

from epson_driver.robots import load_robot_model
from epson_driver.robots.kinematics import Kinematics
from epson_driver.sim_controller.spel_host.lines import (
    MAX_JOINT_STEP,
    MAX_TURN_RAD,
    NEAR_HAND_M,
    NEAR_WRIST_RAD,
)
from epson_driver.sim_controller.spel_host.robot_points import RobotPoints
from epson_driver.spel import Point, SpelError


def across(arm, random, side):
    """Return joints on both sides of a singularity: of the wrist (4), or of the hand (0)."""
    while True:
        start = random.uniform(-0.5, 0.5, 6)
        start[4] = random.choice([-0.3, 0.3])
        end = start + random.uniform(-0.6, 0.6, 6)
        if side == 4:
            end[4] = -start[4]
            return start, end
        start[1:3], end[1:3] = random.uniform((-1.0, 0.5), (0.5, 2.5), (2, 2))
        one, other = arm.sides(start)[0], arm.sides(end)[0]
        if one * other < 0.0 and max(abs(one), abs(other)) < 0.15:
            return start, end


def random_lines(name, count, side):
    """Yield the joints along lines past a singularity, and where the tool should be."""
    model = load_robot_model(name)
    points, random = RobotPoints(model), np.random.default_rng(7)
    arm = Kinematics(model)
    for _ in range(count):
        start, end = across(arm, random, side)
        place = points.place(end)
        try:
            joints, path = points.path_to(Point('xy', place.values, ('ljm',)), start)
        except SpelError:  # out of reach, or too far from the singularity to go through it
            continue
        shares = np.linspace(0.0, 1.0, len(joints)).tolist()
        expected = np.array([path.pose(fraction) for fraction in shares])
        yield joints, expected, np.array([arm.forward(joint) for joint in joints])


@pytest.mark.parametrize(('side', 'limit'), [(0, NEAR_HAND_M), (4, NEAR_WRIST_RAD)])
@pytest.mark.parametrize('name', one_in(4, ['vt6_a901s', 'c4_a601s', 'cx4_a601sr', 'n2_a450sr']))
def test_tool_stays_on_its_line_but_changes_orientation(name, side, limit):
    passed = 0
    arm = Kinematics(load_robot_model(name))
    limits = arm.model.limits
    for joints, expected, reached in random_lines(name, 6, side):
        assert np.max(np.abs(np.diff(joints, axis=0))) <= MAX_JOINT_STEP + 1e-12
        assert np.all((joints >= limits.position_min) & (joints <= limits.position_max))
        np.testing.assert_allclose(reached[:, :3, 3], expected[:, :3, 3], atol=1e-8)
        np.testing.assert_allclose(reached[[0, -1]], expected[[0, -1]], atol=1e-8)
        cosine = (np.einsum('kij,kij->k', reached[:, :3, :3], expected[:, :3, :3]) - 1.0) / 2.0
        turned = np.arccos(np.clip(cosine, -1.0, 1.0))
        assert np.max(turned) <= MAX_TURN_RAD
        turning = turned > 1e-6
        through = [arm.sides(joint)[side // 2] for joint in joints]
        passed += turning.any() and through[0] * through[-1] < 0.0
        near = np.abs(through) < limit
        if side == 4:
            assert np.all((near[1:-1] | near[:-2] | near[2:])[turning[1:-1]])
    assert passed == 0 if name.startswith('n2') else passed > 0


@pytest.mark.invariant(2)
def test_inv2_line_past_a_singularity_respects_all_limits(caplog):
    """An exact orientation would be error 4007, because joint 4 would have to jump."""
    caplog.set_level(logging.INFO)
    harness = SpelProgramHarness(
        'Function main\n  Motor On; Power High; SpeedS 500; AccelS 5000; P1 = Here +Z(100)\n'
        '  Move P1; Print "there", Dist(Here, P1) < 0.01\nFend\n',
        caplog,
        start=np.radians([0.0, -10.0, 20.0, 5.0, 12.0, 0.0]),
    )
    harness.until(lambda: harness.printed or harness.controller.error_number)
    assert harness.printed == ['there -1'], caplog.text
    harness.assert_within_limits()
    assert min(position[4] for position in harness.positions) < -0.1  # straight through
