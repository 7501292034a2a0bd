# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Whole plans: the same for a seed, inside every limit, clear of everything."""

from itertools import pairwise

import numpy as np
import pytest
from support.planning_harness import MODEL, PART, PILLAR, scene, task

pytest.importorskip('ompl')  # no wheel for Python 3.14

from epson_driver.motion import problems
from epson_driver.motion.motion_figures import measure
from epson_driver.planning import plan as plan_module
from epson_driver.planning.path import dense
from epson_driver.planning.plan import LIMIT_SHARE, MOTION_MARGIN_M, PlanningError, plan_task
from epson_driver.planning.shapes import Box, tray
from epson_driver.planning.task import draw_task, gripping, quarter_turns, raised
from epson_driver.planning.verdict import apart, judge, stops
from epson_driver.planning.workspace import HOME_RAD


@pytest.fixture(scope='module', params=[1, pytest.param(2, marks=pytest.mark.slow)])
def plan(request):
    return plan_task(draw_task(request.param, MODEL), MODEL)


def test_a_seed_is_one_task():
    one, again, other = (draw_task(seed, MODEL) for seed in (7, 7, 8))
    assert one.obstacles == again.obstacles
    assert np.array_equal(one.pick, again.pick)
    assert one.obstacles != other.obstacles
    assert not np.array_equal(one.place, other.place)


def test_every_task_has_pillars_and_its_places_apart():
    for seed in range(1, 200):
        drawn = draw_task(seed, MODEL)
        assert any('pillar' in shape.name for shape in drawn.obstacles)
        assert drawn.pick[1, 3] * drawn.place[1, 3] < 0.0  # one on each side


@pytest.mark.slow
def test_a_seed_is_one_plan(plan):
    plan_task(draw_task(3, MODEL), MODEL)  # what was planned before makes no difference
    again = plan_task(draw_task(plan.task.seed, MODEL), MODEL)
    for motion, same in zip(plan.motions, again.motions, strict=True):
        assert np.array_equal(motion.sent.positions, same.sent.positions)
        assert np.array_equal(motion.sent.times, same.sent.times)


def test_every_limit_is_kept(plan):
    for motion in plan.motions:
        assert list(problems(motion.sent, MODEL.limits)) == []
        figures = measure(motion.expected, None, MODEL.limits)
        assert figures.velocity <= LIMIT_SHARE * 1.2  # 1 is the limit
        assert figures.acceleration <= 1.0
        assert figures.jerk <= 1.02
        assert figures.stops == 0
        assert (motion.expected.positions >= MODEL.limits.position_min).all()
        assert (motion.expected.positions <= MODEL.limits.position_max).all()


def test_the_motions_are_one_way_from_home_to_home(plan):
    ends = [motion.sent.positions[[0, -1]] for motion in plan.motions]
    assert ends[0][0] == pytest.approx(HOME_RAD)
    assert ends[-1][1] == pytest.approx(HOME_RAD)
    for one, other in pairwise(ends):
        assert one[1] == pytest.approx(other[0], abs=1e-9)
    tools = [plan.scene.hand_pose(end[1]) for end in ends]
    assert apart(tools[0], plan.task.pick) == pytest.approx((0.0, 0.0), abs=1e-6)
    assert apart(tools[1], plan.task.place) == pytest.approx((0.0, 0.0), abs=1e-6)


def test_the_motion_keeps_its_distance(plan):
    for motion in plan.motions:
        check = plan.scene.check(motion.standing)
        nearest = min(check.clearance(joints).obstacles for joints in motion.expected.positions)
        assert nearest >= MOTION_MARGIN_M - 1e-6
        assert check.path_valid(dense(motion.expected.positions))


@pytest.mark.slow
def test_the_same_motion_without_the_pillar_in_mind_hits_it():
    free = plan_task(task(), MODEL)
    world = scene(PILLAR)
    carried = free.motions[1].expected.positions
    assert not world.check(None).path_valid(dense(carried))
    around = plan_task(task(PILLAR), MODEL)
    assert world.check(None).path_valid(dense(around.motions[1].expected.positions))


def test_a_part_out_of_reach_is_said_so():
    with pytest.raises(PlanningError, match='the part is out of reach'):
        plan_task(task(pick=gripping(0.9, 0.3, PART[2], 0.0)), MODEL)


def test_a_part_in_a_narrow_shaft_is_out_of_reach():
    shaft = tray('shaft', 0.05, 0.12, 0.01, 0.25, 0.3, 0.1)
    with pytest.raises(PlanningError, match='the part is out of reach'):
        plan_task(task(*shaft), MODEL)


def test_an_arm_that_would_collide_where_it_begins_is_said_so():
    here = scene().hand_pose(np.array(HOME_RAD))[:3, 3]
    wall = Box('wall', (0.1, 0.1, 0.1), tuple(here))
    with pytest.raises(PlanningError, match='the arm would collide where it begins'):
        plan_task(task(wall), MODEL)


@pytest.mark.parametrize(
    ('blocked', 'said'),
    [
        ('to the part', 'no way to the part'),
        pytest.param('to its place', 'no way from the part to its place', marks=pytest.mark.slow),
        pytest.param('home', 'no way home', marks=pytest.mark.slow),
    ],
)
def test_a_way_that_is_not_found_is_named_and_every_way_down_is_tried(monkeypatch, blocked, said):
    asked = []

    def motion(_planner, name, _begin, _end, **_):
        asked.append(name)
        return None if name == blocked else object()

    monkeypatch.setattr(plan_module._Planner, '_motion', motion)
    with pytest.raises(PlanningError, match=f'^{said}$'):
        plan_task(task(), MODEL)
    there, down = asked.count('to the part'), asked.count('to its place')
    assert 1 < there <= plan_module.MAX_GOALS
    assert blocked == 'to the part' or there < down <= there * plan_module.MAX_GOALS
    assert asked.count('home') == (down if blocked == 'home' else 0)


@pytest.mark.parametrize(
    'found', ['nothing', pytest.param('what comes too near', marks=pytest.mark.slow)]
)
def test_a_search_is_given_up_after_so_many(monkeypatch, found):
    told = []
    if found == 'nothing':
        monkeypatch.setattr(plan_module, 'find_path', lambda *_: None)
    else:
        monkeypatch.setattr(plan_module._Planner, '_keeps_away', lambda *_: False)
    planner = plan_module._Planner(task(), MODEL, told.append)
    home = np.array(HOME_RAD)[None, :]
    pick = planner._task.pick
    assert planner._motion('there', home, home + 0.1, standing=pick, reaches=pick) is None
    assert told == [f'there: search {n}' for n in range(1, plan_module.MAX_SEARCHES + 1)]


def test_a_straight_way_down_ends_at_the_pose_or_is_none():
    planner = plan_module._Planner(task(), MODEL, str)
    pose = planner._task.pick
    above = planner._arm.inverse(raised(pose, planner._approach), np.array(HOME_RAD))[0]
    way = planner._straight(above, pose)
    assert apart(planner._scene.hand_pose(way[-1]), pose) == pytest.approx((0.0, 0.0), abs=1e-6)
    assert planner._straight(above, gripping(2.0, 0.3, PART[2], 0.0)) is None


def test_an_arm_that_does_not_move_makes_no_stop():
    assert stops(np.arange(100) * 0.01, np.zeros((100, 6))) == 0


def test_the_verdict_on_the_motion_as_planned(plan):
    for motion in plan.motions:
        verdict = judge(plan, motion, motion.expected.times, motion.expected.positions)
        assert not verdict.collides
        assert verdict.reached
        assert verdict.stops == 0
        assert verdict.clearances.shape == motion.expected.times.shape


@pytest.mark.slow
def test_the_verdict_sees_a_pillar_between_two_joint_states():
    plan = plan_task(task(PILLAR), MODEL)
    motion = plan.motions[1]
    ends = motion.expected.positions[[0, -1]]
    verdict = judge(plan, motion, np.array([0.0, 1.0]), ends)
    assert (verdict.clearances > 0.0).all()
    assert verdict.collides


@pytest.mark.slow
def test_the_verdict_sees_a_collision_a_missed_pose_and_a_stop():
    plan = plan_task(task(PILLAR), MODEL)
    motion = plan.motions[1]
    times, positions = motion.expected.times, motion.expected.positions.copy()
    straight = np.linspace(positions[0], positions[-1], len(positions))
    verdict = judge(plan, motion, times, straight)
    assert verdict.collides
    assert verdict.clearances.min() < 0.0
    assert 'pillar' in verdict.pair
    short = judge(plan, motion, times[:-40], positions[:-40])
    assert not short.reached
    assert short.missed > 1e-3
    middle = len(positions) // 2
    stood = np.concatenate([positions[:middle], [positions[middle]] * 20, positions[middle:]])
    clock = 0.005 * np.arange(len(stood))
    assert judge(plan, motion, clock, stood).stops == 1
    late = clock.copy()
    late[middle : middle + 20] = clock[middle + 20]  # all at once: the network was late
    assert judge(plan, motion, late, stood).stops == 0


def test_quarter_turns_of_the_hand_are_the_same_pose():
    pose = gripping(0.3, 0.1, 0.05, 0.4)
    for turned in quarter_turns(pose):
        assert apart(turned, pose) == pytest.approx((0.0, 0.0), abs=1e-9)
    missed, turned = apart(gripping(0.3, 0.101, 0.05, 0.5), pose)
    assert missed == pytest.approx(0.001)
    assert turned == pytest.approx(0.1)
