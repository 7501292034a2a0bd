# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A controller that takes velocities in another unit is a profile: no code knows of it."""

from dataclasses import replace

import numpy as np
import pytest
from support.driver_harness import HOME, LIMITS, Harness, pose, simulated
from support.event_loop import run, until
from support.program_harness import ProgramHarness, point

from epson_driver.driver.delivery.delivery_factory import delivery_rules
from epson_driver.driver.delivery.trajectory_points import trajectory_points
from epson_driver.driver.goal.speed_scaling import scaled
from epson_driver.driver.outcome import End
from epson_driver.motion import Trajectory
from epson_driver.profiles import load_controller_profile
from epson_driver.profiles.point_fields import VelocityUnit
from epson_driver.simple_message import JointTrajPt, decode

WAY = np.array([HOME, pose(0.8), pose(0.8, 0.3), pose(0.8, 0.3, 0.0, 1.5), pose(0.0, 0.0, 0.2)])
STEP = 1.0

PROFILE = """
like: generic
name: radians
description: takes the velocity of the fastest joint in rad/s, and no duration
program:
  uses: velocity
  velocity_unit: {unit}
"""


@pytest.fixture(params=[unit.value for unit in VelocityUnit])
def profile(request, tmp_path):
    """Return the profile of a new file."""
    file = tmp_path / 'radians.yaml'
    file.write_text(PROFILE.format(unit=request.param))
    return load_controller_profile(str(file))


def points_for(profile, way=WAY, start=HOME):
    trajectory = Trajectory(LIMITS.names, np.arange(len(way)) * STEP, np.array(way))
    unit = profile.program.velocity_unit
    return trajectory_points(trajectory, start, LIMITS, velocity_unit=unit)


def durations(profile, points):
    """Return how long the simulated program moves for each point, s, by its manual clock."""
    harness = ProgramHarness('generic', **vars_of(profile.program))
    harness.arm.speed = harness.arm.accel = 1.0
    took = []
    for each in points:
        joints = each.joints[: len(LIMITS.names)]
        harness.send(point(each.sequence, joints, velocity=each.velocity))
        took.append(harness.rest())
        assert harness.codes() == [(each.sequence, 1)]
        assert harness.joints == pytest.approx(list(joints), abs=1e-6)
    return took


def vars_of(program):
    return {'uses': program.uses, 'velocity_unit': program.velocity_unit, 'acknowledge': 'done'}


def test_the_velocity_is_that_of_the_fastest_joint_in_its_unit():
    of = {unit: trajectory_points_in(unit) for unit in VelocityUnit}
    steps = np.abs(np.diff(WAY, axis=0)) / STEP
    in_radians = [each.velocity for each in of[VelocityUnit.RAD_PER_S]][1:]
    fractions = [each.velocity for each in of[VelocityUnit.FRACTION]][1:]
    assert in_radians == pytest.approx(steps.max(axis=1))
    assert fractions == pytest.approx((steps / LIMITS.velocity).max(axis=1))


def trajectory_points_in(unit, way=WAY, start=HOME, step=STEP):
    trajectory = Trajectory(LIMITS.names, np.arange(len(way)) * step, np.array(way))
    return trajectory_points(trajectory, start, LIMITS, velocity_unit=unit)


def test_each_segment_takes_its_planned_time_whatever_the_unit(profile):
    """Besides the time in which the arm accelerates: it is not faster, and not much slower."""
    took = durations(profile, points_for(profile))
    assert all(STEP <= each <= 1.2 * STEP for each in took[1:]), took


def test_points_that_are_sent_ahead_are_measured_from_the_one_before(profile):
    points = points_for(profile)
    harness = ProgramHarness('generic', **vars_of(profile.program))
    harness.arm.speed = harness.arm.accel = 1.0
    for each in points:
        joints = each.joints[: len(LIMITS.names)]
        harness.send(point(each.sequence, joints, velocity=each.velocity))
    assert harness.rest() == pytest.approx(sum(durations(profile, points)), abs=0.02)


def test_a_fast_plan_in_rad_per_s_is_not_cut_at_1():
    fast = trajectory_points_in(VelocityUnit.RAD_PER_S, [HOME, pose(2.0)], step=0.5)
    assert fast[1].velocity == pytest.approx(4.0)
    assert scaled(fast[1], 0.5, 0.0).velocity == pytest.approx(2.0)


def test_a_first_point_without_a_time_is_gone_to_slowly_in_every_unit():
    start = pose(0.0, 0.02)
    for unit in VelocityUnit:
        first = trajectory_points_in(unit, start=start)[0]
        limit = LIMITS.velocity[1] if unit is VelocityUnit.RAD_PER_S else 1.0
        assert first.velocity == pytest.approx(0.1 * limit)
        assert first.duration == pytest.approx(0.02 / LIMITS.velocity[1] / 0.1)


def test_the_driver_moves_a_simulated_controller_with_the_new_profile(profile):
    rules = delivery_rules(profile, profile.program.interface, 'joint_traj_pt')
    profile = replace(profile, motion=replace(profile.motion, cp=False))

    async def scenario():
        async with (
            simulated(profile=profile) as (controller, ports),
            Harness(ports, delivery=rules) as harness,
        ):
            taken = []
            receive = controller.program.receive

            def record(frame):
                taken.append(decode(frame).message)
                receive(frame)

            controller.program.receive = record
            await harness.ready()
            await harness.commands.enable()
            goal = harness.submit(pose(0.3), pose(0.3, 0.2), step=0.5)
            await until(lambda: goal.outcomes)
            assert goal.outcome.end is End.SUCCEEDED, goal.outcome.text
            velocities = [each.velocity for each in taken if isinstance(each, JointTrajPt)]
            in_radians = profile.program.velocity_unit is VelocityUnit.RAD_PER_S
            limits = np.ones(6) if in_radians else LIMITS.velocity
            expected = [0.6 / limits[0], 0.4 / limits[1]]
            assert velocities[-2:] == pytest.approx(expected, rel=1e-5)

    run(scenario())
