# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The controller's own speed: plans that it executes slower are reported, faster ones rejected."""

import logging
from dataclasses import replace

import numpy as np
import pytest
from support.driver_harness import HOME, JOINTS, LIMITS, Harness, Submitted, pose, simulated

from epson_driver.driver.delivery.delivery import DeliveryRules, delivery_rules
from epson_driver.driver.delivery.streaming import trajectory_points
from epson_driver.driver.goal.goal import Goal, GoalSettings
from epson_driver.driver.goal.reference import Timing, TimingMonitor
from epson_driver.driver.outcome import End, ErrorCode, GoalRejectedError
from epson_driver.driver.state.joint_mapping import unmapped
from epson_driver.motion import Trajectory
from epson_driver.profiles import load_controller_profile
from epson_driver.profiles.profile_rules import FieldsUsed

OWN_SPEED = DeliveryRules(uses=FieldsUsed.NOTHING, speed=0.2)
SLOW = 3.0
"""How long the plan takes, s: the controllers' own speed takes much less."""


def plan(duration=SLOW, way=0.2):
    return Trajectory(LIMITS.names, np.array([0.0, duration]), np.array([HOME, pose(way)]))


async def executed(profile, trajectory, **settings):
    """Return harness and outcome of a plan on the simulated controller of a profile."""
    rules = delivery_rules(profile, 'streaming', 'joint_traj_pt')
    settings.setdefault('require_planned_speed', False)
    async with (
        simulated(profile=profile) as (controller, ports),
        Harness(
            ports,
            delivery=rules,
            usual_byte_order=profile.byte_order,
            settings=GoalSettings(**settings),
        ) as harness,
    ):
        await harness.ready()
        await harness.commands.enable()
        goal = Submitted(Goal(trajectory, np.full(JOINTS, 0.01), goal_time=0.0))
        harness.driver.goal_queue.submit(goal.handle)
        outcome = await goal.end()
        return harness, outcome, np.array(controller.joint_position().joints[:JOINTS])


@pytest.mark.invariant(5)
async def test_inv5_outcome_of_another_speed_than_planned_has_both_times(caplog):
    fanuc = load_controller_profile('fanuc')
    with caplog.at_level(logging.WARNING):
        harness, outcome, _ = await executed(fanuc, plan())
    assert outcome.end is End.SUCCEEDED
    assert 'instead of 3 s: this controller ignores point velocities' in outcome.text
    timing = harness.driver.goal_queue.last_timing
    assert timing.planned == SLOW
    assert timing.executed < SLOW / 2
    assert f'it took {timing.executed:.3g} s' in outcome.text
    assert 'instead of' not in caplog.text  # the outcome's receiver logs it, once
    assert harness.driver.goal_queue.other_speed == 1


async def test_goal_at_the_arm_position_gives_no_speed_warning():
    harness, outcome, _ = await executed(load_controller_profile('fanuc'), plan(1.0, way=0.0))
    assert outcome.end is End.SUCCEEDED
    assert 'instead of' not in outcome.text
    assert harness.driver.goal_queue.other_speed == 0


async def test_motion_at_the_planned_speed_gives_no_warning():
    harness, outcome, _ = await executed(load_controller_profile('generic'), plan(1.0))
    assert outcome.end is End.SUCCEEDED
    timing = harness.driver.goal_queue.last_timing
    assert timing.executed > 0.9
    if not timing.deviates:  # a busy machine may detect the standstill late
        assert 'instead' not in outcome.text
        assert harness.driver.goal_queue.other_speed == 0


@pytest.mark.invariant(10)
async def test_inv10_plan_slower_than_controller_is_rejected_before_sending():
    fanuc = load_controller_profile('fanuc')
    _, outcome, at = await executed(fanuc, plan(), require_planned_speed=True)
    assert outcome.code is ErrorCode.INVALID_GOAL
    assert 'of the velocity limits at most, the controller at 0.2: this controller' in outcome.text
    assert 'override of its pendant' in outcome.text
    np.testing.assert_array_equal(at, HOME)


@pytest.mark.parametrize(
    ('planned', 'executed_in', 'deviates'),
    [
        (4.0, 1.03, True),
        (4.0, 4.7, False),
        (4.0, 4.9, True),
        (0.1, 0.3, False),
        (0.4, 0.72, False),  # its start delay
        (1.0, 0.65, True),
        (1.0, 1.6, True),
    ],
)
def test_duration_deviation_is_reported_only_beyond_both_tolerances(
    planned, executed_in, deviates
):
    assert Timing(planned, executed_in).deviates is deviates


@pytest.mark.parametrize('uses', FieldsUsed)
def test_only_controller_that_ignores_times_rejects_slow_plans(uses):
    speed = TimingMonitor(replace(OWN_SPEED, uses=uses), LIMITS)
    if uses is FieldsUsed.NOTHING:
        with pytest.raises(GoalRejectedError, match=r'the controller at 0\.2'):
            speed.check(plan(), HOME, 1.0)
    else:
        speed.check(plan(), HOME, 1.0)
    its_own = 0.2 / LIMITS.velocity[0] / OWN_SPEED.speed
    speed.check(plan(its_own), HOME, 1.0)
    speed.check(plan(its_own / 2), HOME, 1.0)  # faster than the controller
    speed.check(plan(way=0.0), HOME, 1.0)
    full = replace(OWN_SPEED, point_message='joint_traj_pt_full')
    TimingMonitor(full, LIMITS).check(plan(), HOME, 1.0)


def test_velocities_of_points_reproduce_planned_time():
    """With the fastest velocity of each segment, the motion would take half of the time."""
    fraction = np.linspace(0.0, 1.0, 9)
    smooth, rate = 3 * fraction**2 - 2 * fraction**3, 6 * fraction - 6 * fraction**2
    way = pose(0.5, -0.2)
    made = Trajectory(
        LIMITS.names, fraction * 2.0, np.outer(smooth, way), np.outer(rate, way) / 2.0
    )

    def takes(uses):
        points = trajectory_points(made, HOME, LIMITS, unmapped(len(LIMITS.names)), uses=uses)
        steps = np.abs(np.diff(made.positions, axis=0)) / LIMITS.velocity
        return sum(
            step.max() / point.velocity for step, point in zip(steps, points[1:], strict=True)
        )

    assert takes(FieldsUsed.VELOCITY) == pytest.approx(2.0, rel=1e-6)
    assert takes(FieldsUsed.BOTH) < 1.9
