# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A goal that is left on the way for another one, on a manual clock (driver/goal/splice.py)."""

from dataclasses import replace

import numpy as np
import pytest
from support.driver_harness import HOME, LIMITS, pose
from support.goal_execution_harness import LINE, FixedLead, Harness, goal_along

from epson_driver.driver.goal.goal import Tolerances
from epson_driver.driver.goal.goal_execution import GoalExecution
from epson_driver.driver.goal.splice import (
    SplicePoint,
    _from,
    from_rest,
    numbered,
    spliced,
)
from epson_driver.driver.outcome import End, ErrorCode, GoalRejectedError
from epson_driver.motion import JointLimits, Trajectory
from epson_driver.motion.segments import SPACING_S
from epson_driver.simple_message import JointTrajPt, joint_data

SLOW = JointLimits(
    ('joint_1', 'joint_2'),
    np.full(2, -3.0),
    np.full(2, 3.0),
    np.full(2, 2.0),
    np.full(2, 20.0),
    np.full(2, 200.0),
)
NEW = goal_along(((0.6, 0.3), (0.6, 0.8)))
NEW = replace(NEW, trajectory=replace(NEW.trajectory, times=NEW.trajectory.times + 0.6))
TOLERANCE = 0.05


class Replaced(Harness):
    """A goal that runs, and the one that goes on from there."""

    def __init__(self, *args, lead=1e3, **options):
        super().__init__(*args, start=False, lead=FixedLead(lead), **options)
        self.left = []
        self.joins = True
        self.new = None
        self.new_outcomes = []
        self.execution.start(self.goal.trajectory, self.wire, self.now)

    def replace(self):
        self.execution.replace(self.successor, self.now)

    def successor(self, left, now):
        self.left.append(left)
        if not self.joins:
            return False
        way = spliced(left, NEW.trajectory, SLOW, TOLERANCE)
        wire = [JointTrajPt(0, joint_data(q.tolist()), 0.5, 0.1) for q in way.trajectory.positions]
        self.new = GoalExecution(
            NEW, self.execution.settings, self._send, self.new_outcomes.append, now, self.scaling
        )
        self.new.go_on(way, numbered(wire, way.first, left.sequence), left, now)
        self.execution.end_spliced()
        return True


def test_the_rest_of_the_old_goal_is_not_sent_and_the_new_one_follows_with_the_next_number():
    harness = Replaced()
    harness.answer()
    harness.replace()
    assert harness.left == []  # point 1 is on its way
    harness.answer()
    assert harness.sequences == [0, 1, 2]
    assert harness.stops == 0
    assert harness.sent[2].joints[:2] != LINE[2]
    (left,) = harness.left
    assert (left.taken, left.sequence) == (1, 1)
    assert harness.outcome.end is End.ABORTED
    assert harness.outcome.code is ErrorCode.INVALID_GOAL
    assert 'replaced by a new goal on the way to point 2' in harness.outcome.text
    assert harness.execution.aftermath.spliced
    assert not harness.execution.aftermath.at_rest


@pytest.mark.invariant(5)
def test_inv5_a_goal_that_was_left_ends_once_whatever_comes_later():
    harness = Replaced()
    harness.replace()
    harness.answer()
    for event in (
        lambda: harness.execution.cancel(harness.now),
        lambda: harness.execution.stop('again', harness.now),
        lambda: harness.execution.fault('again'),
        lambda: harness.execution.on_unsolicited_failure(harness.now),
        lambda: harness.see(1.0),
        lambda: harness.refuse(0),
    ):
        event()
    assert len(harness.outcomes) == 1
    assert harness.stops == 0


@pytest.mark.parametrize('how', ['held', 'settling'])
def test_a_goal_without_a_point_on_its_way_is_left_at_once(how):
    harness = Replaced()
    harness.answer()
    if how == 'held':
        harness.scaling.set(0.0, harness.now - 1.0)
        harness.answer()
        assert harness.sequences == [0, 1]
    else:
        harness.answer()
        harness.answer()
        assert harness.state == 'settling'
    harness.replace()
    assert len(harness.left) == 1
    assert harness.outcome.end is End.ABORTED
    assert harness.sequences == ([0, 1] if how == 'held' else [0, 1, 2, 3])


def test_a_goal_of_which_nothing_was_taken_cannot_be_left_on_the_way():
    harness = Harness(start=False)
    assert harness.execution.reach is None
    harness.scaling.set(0.0, harness.now - 1.0)
    harness.start()
    assert harness.sequences == []
    assert harness.execution.reach is None


@pytest.mark.invariant(3)
@pytest.mark.parametrize('how', ['cancel', 'stop', 'fault', 'refuse', 'no link'])
def test_inv3_what_ends_the_goal_before_the_reply_ends_it_as_ever(how):
    harness = Replaced()
    harness.answer()
    harness.replace()
    if how == 'cancel':
        harness.execution.cancel(harness.now)
    elif how == 'stop':
        harness.execution.stop('for the test', harness.now)
    elif how == 'fault':
        harness.execution.fault('for the test')
    elif how == 'refuse':
        harness.refuse()
    else:
        harness.broken = True
        harness.execution.fault('the link is gone')
    harness.answer(message=1)
    assert harness.left == []
    assert harness.sequences == ([0, 1] if how == 'no link' else [0, 1, -4])


def test_a_goal_that_nobody_takes_over_goes_on():
    harness = Replaced()
    harness.joins = False
    harness.replace()
    harness.answer()
    assert len(harness.left) == 1
    assert harness.sequences == [0, 1]
    harness.replace()
    harness.execution.keep()
    harness.answer()
    assert len(harness.left) == 1
    assert harness.sequences == [0, 1, 2]


@pytest.mark.invariant(4)
def test_inv4_the_first_point_of_the_new_goal_refused_breaks_off_what_was_taken_before():
    harness = Replaced()
    harness.replace()
    harness.answer()
    harness.refuse()
    assert harness.new.state.value == 'rejected midway'
    harness.new.fault('the cause')
    assert harness.new.aftermath.broken_off
    assert harness.sequences == [0, 1, -4]


def test_the_plan_goes_on_without_a_jump_where_the_goals_meet():
    harness = Replaced()
    harness.answer()
    harness.see(0.3)
    before = harness.execution.desired
    harness.replace()
    harness.answer()
    time, positions, _ = harness.new.desired
    assert time == 0.0
    np.testing.assert_allclose(positions, before[1])
    trail = [positions]
    for _ in range(400):
        harness.now += 0.005
        harness.robot.on_joints(joint_data(trail[-1].tolist()), harness.now)
        harness.new.on_state(harness.robot, harness.now)
        trail.append(harness.new.desired[1])
    assert np.abs(np.diff(trail, axis=0)).max() <= 0.01 * SLOW.velocity.max()


def test_the_path_tolerance_of_the_new_goal_holds_on_what_is_left_of_the_old_one():
    """The arm is still on the old goal's points when the new one begins."""
    harness = Replaced()
    harness.answer()
    harness.see(0.3)
    harness.replace()
    harness.answer()
    limit = np.full(2, 0.02)
    harness.new.goal = replace(harness.new.goal, path_tolerance=Tolerances(limit, limit * np.inf))
    for _ in range(100):
        harness.now += 0.005
        at = harness.new.desired[1]
        harness.robot.on_joints(joint_data(at.tolist()), harness.now)
        harness.new.on_state(harness.robot, harness.now)
    assert harness.new.state.value == 'streaming'
    assert harness.stops == 0


def test_points_are_sent_so_far_ahead_of_the_clock_and_no_farther():
    line = tuple((0.01 * index, 0.0) for index in range(40))
    harness = Replaced(line, step=0.05, lead=0.31)
    for _ in line:
        harness.answer()
    assert len(harness.sequences) == 8  # point 7 begins 0.3 s ahead
    assert harness.execution.reach == pytest.approx(0.35)
    harness.see(0.5)
    assert len(harness.sequences) == 9  # the reply to that one lets the next go
    harness.answer()
    assert len(harness.sequences) == 10


def left_at(old, taken, time):
    """Return how a goal along `old` is left whose clock is at a time, s."""
    factors = [1.0] * (taken + 1)
    at = np.array([np.interp(time, old.times, column) for column in old.positions.T])
    return SplicePoint(old, taken, taken, 0.0, time, 0.0, at, np.zeros_like(at), factors)


def line_to(*places, step=0.1, first=0.0):
    times = first + step * np.arange(len(places))
    return Trajectory(LIMITS.names, times, np.array([pose(place) for place in places]))


OLD = line_to(*np.linspace(0.0, 1.0, 11).tolist())


@pytest.mark.invariant(2)
def test_inv2_the_way_into_the_new_goal_keeps_every_limit():
    random = np.random.default_rng(5)
    for _ in range(100):
        end = random.uniform(LIMITS.position_min, LIMITS.position_max)
        times = np.array([random.uniform(0.4, 1.0), 4.0])
        new = Trajectory(LIMITS.names, times, np.array([0.2 * end, end]))
        taken = int(random.integers(1, 9))
        way = spliced(left_at(OLD, taken, OLD.times[taken] - 0.05), new, LIMITS, 0.05)
        planned = way.trajectory
        steps = np.diff(planned.times)
        assert np.all(steps > 0.0)
        assert steps[way.first :].max() <= SPACING_S * 1.001
        speeds = np.abs(np.diff(planned.positions, axis=0)) / steps[:, None]
        assert np.all(speeds <= LIMITS.velocity * 1.000001)
        assert np.all(planned.positions >= LIMITS.position_min)
        assert np.all(planned.positions <= LIMITS.position_max)
        np.testing.assert_array_equal(planned.positions[way.first - 1], OLD.positions[taken])
        for point in new.positions:  # its own points are on the way
            assert np.abs(planned.positions - point).max(axis=1).min() == 0.0


def test_a_first_point_at_0_s_is_where_the_new_goal_begins_and_is_left_out():
    left = left_at(OLD, 5, 0.45)
    way = spliced(left, line_to(0.52, 0.6, 0.65), LIMITS, 0.05)
    assert way.trajectory.positions[way.first - 1][0] == 0.5
    assert 0.52 not in way.trajectory.positions[:, 0]
    assert way.trajectory.positions[-1][0] == 0.65


@pytest.mark.invariant(1)
def test_inv1_a_goal_that_begins_elsewhere_is_not_joined_and_the_reason_names_the_joint():
    with pytest.raises(GoalRejectedError, match=r'joint_1: the trajectory starts at 0\.7 rad'):
        spliced(left_at(OLD, 5, 0.45), line_to(0.7, 0.8), LIMITS, 0.05)
    far = line_to(2.5, first=0.1)
    with pytest.raises(GoalRejectedError, match=r'to be there after 0\.1 s it would need'):
        spliced(left_at(OLD, 5, 0.45), far, LIMITS, 0.05)


@pytest.mark.invariant(2)
def test_inv2_a_way_in_that_would_leave_the_joint_range_is_refused():
    """The old plan is about to turn round at the end of the range, faster than joints can."""
    top = float(LIMITS.position_max[0])
    old = replace(
        line_to(0.0, top - 0.01, step=0.5),
        velocities=np.array([HOME, pose(0.9 * LIMITS.velocity[0])]),
    )
    with pytest.raises(GoalRejectedError, match='no motion inside the limits'):
        spliced(left_at(old, 1, 0.45), line_to(top - 0.3, first=1.0), LIMITS, 0.05)


def test_the_new_goal_is_at_its_first_point_when_it_says_counted_from_its_beginning():
    left = left_at(OLD, 5, 0.2)  # 0.3 s of the old goal are to come
    way = spliced(left, line_to(0.9, 0.9, first=0.8), LIMITS, 0.05).trajectory
    first = int(np.argmin(np.abs(way.positions[:, 0] - 0.9)))
    assert way.times[first] == pytest.approx(0.8)
    assert way.duration == pytest.approx(0.9)


def test_the_way_in_is_at_most_twice_as_fast_as_from_where_the_arm_was():
    slow = line_to(*np.linspace(0.0, 1.0, 11).tolist(), step=0.5)
    left = left_at(slow, 5, 0.5)  # at 0.1 rad, and 2 s of the old goal are to come, to 0.5 rad
    way = spliced(left, line_to(0.9, 0.9, first=2.5), LIMITS, 0.05).trajectory
    first = int(np.argmin(np.abs(way.positions[:, 0] - 0.9)))
    assert way.times[first] == pytest.approx(2.0 + 0.5 * 2.5 * 0.4 / 0.8)


def test_a_plan_that_goes_on_as_the_old_one_does_is_not_delayed():
    left = left_at(OLD, 5, 0.1)
    way = spliced(left, line_to(0.6, 0.7, 0.8, first=0.5), LIMITS, 0.05).trajectory
    assert way.duration == pytest.approx(0.7, abs=0.03)


def test_a_way_that_needs_longer_than_planned_moves_the_rest_of_the_goal():
    left = left_at(OLD, 5, 0.5)  # at 1 rad/s in the other direction
    way = spliced(left, line_to(0.45, 0.4, 0.35, first=0.05), LIMITS, 0.05)
    times = way.trajectory.times
    assert times[-3] - times[way.first - 1] > 0.05  # which is how long the plan has for it
    np.testing.assert_allclose(np.diff(times[-3:]), 0.1)


def test_a_goal_from_rest_keeps_its_times_and_its_long_ways_get_points():
    far = Trajectory(LIMITS.names, np.array([2.0]), np.array([pose(1.0)]))
    made = from_rest(far, HOME, LIMITS)
    assert made.times[0] == 0.0
    assert made.duration == 2.0
    assert np.diff(made.times).max() <= SPACING_S * 1.001
    assert np.all(np.diff(made.positions[:, 0]) > 0.0)
    dense = line_to(*np.linspace(0.0, 0.1, 11).tolist(), step=0.02)
    np.testing.assert_array_equal(from_rest(dense, HOME, LIMITS).times, dense.times)


def test_a_goal_of_one_point_now_is_gone_to_from_where_the_old_one_is_left():
    """Its only point is at 0 s: there is no time for it, so it is as fast as that may be."""
    start, velocity, there = np.array([0.1, 0.2]), np.array([0.3, 0.0]), np.array([[0.4, 0.2]])
    new = Trajectory(SLOW.names, np.array([0.0]), there)
    way = _from(start, velocity, new, 0.7)
    assert way.times.tolist() == [0.0, 0.7]
    assert np.array_equal(way.positions, [start, there[0]])
    assert np.array_equal(way.velocities[0], velocity)


def test_a_way_in_keeps_the_velocities_of_the_new_goal_behind_its_first_point():
    times, positions = np.array([0.0, 0.5, 1.0]), np.array([[0.0, 0.0], [0.2, 0.1], [0.3, 0.2]])
    velocities = np.array([[0.0, 0.0], [0.4, 0.2], [0.0, 0.0]])
    new = Trajectory(SLOW.names, times, positions, velocities)
    way = _from(np.array([0.1, 0.0]), np.array([0.5, 0.1]), new, 0.25)
    assert way.times.tolist() == [0.0, 0.25, 0.75]
    assert way.velocities.tolist() == [[0.5, 0.1], [0.4, 0.2], [0.0, 0.0]]
    assert way.positions[1:].tolist() == positions[1:].tolist()
