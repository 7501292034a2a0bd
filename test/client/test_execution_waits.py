# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A goal against its plan: path tolerance, a controller that is paused, and the speed scaling."""

import numpy as np
import pytest
from execution_bench import CYCLE, DT, LINE, Bench

from epson_driver.client.execution import SETTLE_TIME, Settings
from epson_driver.client.goal import End, ErrorCode
from epson_driver.client.speed_scaling import RAMP
from epson_driver.client.tolerances import Tolerances
from epson_driver.simple_message import TriState

PATIENT = Settings(reply_timeout=2.0)
INF = np.inf


def tolerance(position=(INF, INF), velocity=(INF, INF)):
    return Tolerances(np.array(position), np.array(velocity))


def on_plan(bench):
    """Let the arm be where the plan is, until the next call."""
    time, positions, _ = bench.execution.desired
    return time, positions


def follow(bench, seconds, *, offset=(0.0, 0.0)):
    """Let time pass while the arm is that far from the plan."""
    for _ in range(round(seconds / DT)):
        bench.now += DT
        _, positions = on_plan(bench)
        bench.joints(positions + offset)


# --- path tolerance ---------------------------------------------------------------------------


def test_an_arm_on_its_path_violates_nothing():
    bench = Bench(path_tolerance=tolerance((0.05, 0.05)))
    for _ in LINE:
        bench.answer()
    follow(bench, 1.9, offset=(0.04, -0.04))
    assert bench.state == 'settling'
    bench.move_to(LINE[-1])
    bench.see(0.3)
    assert bench.outcome.end is End.SUCCEEDED


def test_a_joint_beside_the_path_stops_the_arm_and_the_text_says_which():
    bench = Bench(path_tolerance=tolerance((INF, 0.05)))
    bench.answer()
    follow(bench, 0.3, offset=(0.5, 0.0))
    assert bench.stops == 0
    bench.now += DT
    bench.joints(on_plan(bench)[1] + (0.5, 0.1))
    assert bench.stops == 1
    assert not bench.outcomes  # when it stands
    bench.answer()
    bench.see(0.3)
    assert bench.outcome.end is End.ABORTED
    assert bench.outcome.code is ErrorCode.PATH_TOLERANCE_VIOLATED
    assert 'on the way to point 1' in bench.outcome.text
    assert 'joint_2: the position error is 0.09' in bench.outcome.text
    assert 'the tolerance is 0.05 rad' in bench.outcome.text
    assert bench.execution.at_rest
    assert bench.stops == 1


def test_the_velocity_has_its_tolerance_too():
    bench = Bench(path_tolerance=tolerance(velocity=(0.6, INF)))
    bench.answer()
    follow(bench, 0.3)
    assert bench.stops == 0
    bench.see(0.3, moving=0.0)  # it stands, and should go at 0.5 rad/s: still allowed
    assert bench.stops == 0
    bench.see(0.1, moving=-0.3)
    assert bench.stops == 1
    bench.answer()
    bench.see(0.3)
    assert 'joint_1: the velocity error is' in bench.outcome.text


def test_without_a_path_tolerance_nothing_is_checked():
    bench = Bench()
    bench.answer()
    follow(bench, 0.5, offset=(3.0, 3.0))
    assert not bench.stops


def test_a_controller_that_rests_at_each_point_is_late_against_the_plan():
    bench = Bench(path_tolerance=tolerance((0.2, 0.2)))
    bench.go_and_answer()
    bench.see(0.7)  # the plan goes on
    assert bench.stops == 1


def test_after_the_end_of_the_plan_only_the_goal_tolerance_counts():
    bench = Bench(path_tolerance=tolerance((0.6, 0.6)))
    for _ in LINE:
        bench.answer()
    follow(bench, 1.5)
    bench.at = np.array([0.5, 0.25])
    bench.in_motion = TriState.TRUE
    bench.see(1.0)
    assert bench.state == 'settling'
    bench.move_to((5.0, 5.0))
    assert bench.stops == 0


def test_a_status_between_two_samples_compares_nothing_old():
    bench = Bench(path_tolerance=tolerance((0.05, 0.05)))
    bench.answer()
    follow(bench, 0.3)
    bench.now += 0.3  # the plan is 0.15 rad further
    bench.status()
    assert bench.stops == 0
    bench.joints(bench.execution.desired[1])
    assert bench.stops == 0


def test_a_violation_is_not_forgotten_if_the_stop_fails():
    bench = Bench(path_tolerance=tolerance((0.05, 0.05)), settings=PATIENT)
    bench.answer()
    follow(bench, 0.1, offset=(0.3, 0.0))
    bench.see(3.0)
    assert bench.outcome.code is ErrorCode.PATH_TOLERANCE_VIOLATED
    assert 'joint_1' in bench.outcome.text
    assert 'standstill' in bench.outcome.text


def test_a_tight_velocity_at_the_goal_holds_for_its_joint():
    bench = Bench(goal_velocity=np.array([0.001, INF]), in_motion=TriState.UNKNOWN, step=0.1)
    bench.finish_points()
    bench.at = np.array([0.995, 0.5])
    bench.see(0.5, moving=0.005)  # below what holds for all joints
    assert bench.state == 'settling'
    bench.see(0.3)
    assert bench.outcome.end is End.SUCCEEDED


# --- the controller is paused -----------------------------------------------------------------


def status(bench, possible, in_motion=TriState.FALSE, **fields):
    bench.now += DT
    bench.in_motion = in_motion
    bench.status(motion_possible=possible, **fields)


def pause(bench):
    status(bench, TriState.FALSE, TriState.TRUE)
    status(bench, TriState.FALSE)


def stand(bench, seconds):
    """Let time pass in which the arm stands and the status says nothing new."""
    bench.see(seconds, status=False)


@pytest.mark.parametrize('acknowledged', [1, 3], ids=['while streaming', 'while settling'])
def test_a_paused_controller_is_waited_for_and_the_clock_stands(acknowledged):
    bench = Bench(settings=PATIENT, goal_time=0.5, path_tolerance=tolerance((0.05, 0.05)))
    status(bench, TriState.TRUE)
    for _ in range(acknowledged):
        bench.answer()
    follow(bench, 0.5)
    pause(bench)
    assert bench.execution.paused
    assert bench.execution.speed(bench.now) == 0.0
    before = bench.execution.desired[0]
    stand(bench, 60.0)
    time, _, velocities = bench.execution.desired
    assert time == before
    assert velocities.tolist() == [0.0, 0.0]
    assert not bench.outcomes
    status(bench, TriState.TRUE)
    assert not bench.execution.paused
    while bench.state == 'streaming':
        follow(bench, 0.5)
        bench.answer()
    follow(bench, 2.0 - bench.execution.desired[0])
    bench.move_to(LINE[-1])
    status(bench, TriState.TRUE)
    bench.see(0.3)
    assert bench.outcome.end is End.SUCCEEDED, bench.outcome.text


def test_a_paused_goal_does_not_succeed_before_the_controller_goes_on():
    bench = Bench(step=0.1)
    status(bench, TriState.TRUE)
    bench.finish_points()
    pause(bench)
    stand(bench, 1.0)
    assert not bench.outcomes
    status(bench, TriState.TRUE)
    stand(bench, 0.3)
    assert bench.outcome.end is End.SUCCEEDED


def test_after_a_pause_the_usual_patience_holds():
    bench = Bench(settings=PATIENT, step=0.25)
    status(bench, TriState.TRUE)
    for _ in LINE:
        bench.answer()
    follow(bench, 0.125)
    pause(bench)
    stand(bench, 10.0)
    status(bench, TriState.TRUE)
    stand(bench, SETTLE_TIME - 0.1)
    assert not bench.outcomes
    stand(bench, 0.3)
    assert bench.outcome.code is ErrorCode.GOAL_TOLERANCE_VIOLATED


def test_a_paused_goal_can_be_canceled():
    bench = Bench()
    status(bench, TriState.TRUE)
    bench.answer()
    pause(bench)
    bench.execution.cancel(bench.now)
    assert bench.sequences[-1] == -4
    bench.answer()
    status(bench, TriState.FALSE)
    stand(bench, 0.3)
    assert bench.outcome.end is End.CANCELED


@pytest.mark.parametrize('before', [TriState.UNKNOWN, TriState.FALSE])
def test_a_controller_that_never_says_that_motion_is_possible_is_not_paused(before):
    bench = Bench(settings=PATIENT)
    status(bench, before)
    bench.answer()
    status(bench, TriState.FALSE)
    assert not bench.execution.paused
    stand(bench, 3.2)
    assert 'no reply' in bench.outcome.text


@pytest.mark.parametrize(
    'fields', [{'in_error': TriState.TRUE}, {'error_code': 4001}], ids=['in error', 'number']
)
def test_an_error_is_no_pause(fields):
    bench = Bench(settings=PATIENT)
    status(bench, TriState.TRUE)
    bench.answer()
    status(bench, TriState.FALSE, **fields)
    assert not bench.execution.paused


# --- speed scaling ----------------------------------------------------------------------------


def test_points_that_are_not_sent_yet_get_slower_and_the_clock_with_them():
    bench = Bench(path_tolerance=tolerance((0.05, 0.05)), goal_time=0.1)
    bench.answer()
    assert [point.duration for point in bench.sent] == [1.0, 1.0]
    bench.scaling.set(0.5, bench.now)
    follow(bench, 1.0)  # what was sent goes on as it was sent
    assert bench.execution.desired[0] == pytest.approx(1.0)
    bench.answer()
    assert bench.sent[-1].duration == pytest.approx(2.0)
    assert bench.sent[-1].velocity == pytest.approx(0.25)
    bench.answer()
    follow(bench, 1.0)
    assert bench.execution.desired[0] == pytest.approx(1.5)
    follow(bench, 1.0)
    bench.see(0.3)
    assert bench.outcome.end is End.SUCCEEDED


def test_at_0_no_point_is_sent_and_at_more_it_goes_on():
    bench = Bench(CYCLE, settings=PATIENT, goal_time=0.5)
    bench.answer()
    bench.scaling.set(0.0, bench.now)
    follow(bench, 1.0)
    bench.answer()
    assert bench.sequences == [0, 1]
    stand(bench, 60.0)
    assert bench.state == 'streaming'
    assert bench.sequences == [0, 1]
    assert bench.execution.desired[0] == pytest.approx(1.0)
    bench.scaling.set(1.0, bench.now)
    stand(bench, DT)
    assert bench.sequences == [0, 1, 2]
    assert bench.sent[-1].duration == pytest.approx(1.0 + 0.5 / RAMP, rel=0.02)
    bench.go_and_answer()
    bench.see(1.5)
    assert bench.outcome.end is End.SUCCEEDED


def test_a_goal_that_is_held_can_be_canceled_and_sends_nothing_more():
    bench = Bench()
    bench.scaling.set(0.0, bench.now)
    stand(bench, 1.0)
    bench.answer()
    bench.execution.cancel(bench.now)
    bench.scaling.set(1.0, bench.now)
    stand(bench, 1.0)
    assert bench.sequences == [0, -4]
    bench.answer()
    bench.see(0.3)
    assert bench.outcome.end is End.CANCELED


def test_a_goal_that_begins_at_0_waits_before_its_first_point():
    bench = Bench(start=False, settings=PATIENT, goal_time=0.5)
    bench.scaling.set(0.0, bench.now)
    stand(bench, 1.0)
    bench.start()
    stand(bench, 30.0)
    assert bench.sequences == []
    assert bench.execution.desired[0] == 0.0
    bench.scaling.set(0.5, bench.now)
    stand(bench, DT)
    assert bench.sequences == [0]


def test_patience_for_a_reply_knows_how_slow_the_point_is():
    bench = Bench(settings=PATIENT)
    bench.scaling.set(0.1, bench.now - 10.0)
    bench.answer()
    stand(bench, 11.5)
    assert not bench.outcomes
    stand(bench, 0.8)
    assert 'no reply' in bench.outcome.text


@pytest.mark.invariant(9)
def test_a_process_that_was_not_scheduled_has_not_waited_for_a_reply():
    """docs/invariants.md, 9: the reply came meanwhile, and is read after the state."""
    bench = Bench(settings=PATIENT)
    bench.go_and_answer()
    bench.pass_time(60.0)
    stand(bench, DT)
    assert not bench.outcomes
    bench.answer()
    assert bench.sequences[-1] == 2
    stand(bench, 4.0)
    assert 'no reply' in bench.outcome.text
