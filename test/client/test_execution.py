# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A goal's way to its one outcome, on a manual clock (docs/invariants.md, 5)."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from execution_bench import CYCLE, DT, LINE, Bench

from epson_driver.client.execution import CAUSE_TIME, SETTLE_TIME, Settings
from epson_driver.client.goal import End, ErrorCode
from epson_driver.client.goal_states import FINAL, TRANSITIONS, Event, State
from epson_driver.client.standstill import DOUBTFUL_REST, REST_TIME
from epson_driver.simple_message import TriState

pytestmark = pytest.mark.invariant(5)

TABLE = """
preparing  prepared     streaming
preparing  cancel       canceling
preparing  stop         stopping
preparing  fault        aborted
streaming  last reply   settling
streaming  refusal      refused
streaming  cancel       canceling
streaming  stop         stopping
streaming  fault        aborted
settling   at the goal  succeeded
settling   refusal      refused
settling   cancel       canceling
settling   stop         stopping
settling   fault        aborted
refused    fault        aborted
canceling  at rest      canceled
canceling  fault        aborted
stopping   cancel       canceling
stopping   at rest      aborted
stopping   fault        aborted
"""

ROWS = {
    (State(line[:11].strip()), Event(line[11:24].strip())): State(line[24:])
    for line in TABLE.strip().split('\n')
}


def test_the_table_is_the_one_that_was_agreed():
    assert TRANSITIONS == ROWS


def test_final_states_have_no_way_out_and_all_others_end_by_a_fault():
    assert {state.value for state in FINAL} == {'succeeded', 'canceled', 'aborted'}
    assert not {pair for pair in product(FINAL, Event) if pair in TRANSITIONS}
    for state in set(State) - FINAL:
        assert TRANSITIONS[state, Event.FAULT] is State.ABORTED


# --- success ----------------------------------------------------------------------------------


def test_points_go_one_at_a_time_and_the_goal_succeeds_when_the_arm_stands_there():
    bench = Bench(step=0.1)
    for count in range(1, 4):
        assert bench.sequences == list(range(count))
        bench.see(0.3)
        assert bench.sequences == list(range(count))  # nothing before the reply
        bench.go_and_answer()
    assert bench.state == 'settling'
    bench.see(0.3)
    assert bench.outcome.end is End.SUCCEEDED
    assert bench.outcome.code is ErrorCode.SUCCESSFUL
    assert 'at the goal' in bench.outcome.text
    assert bench.execution.ended
    assert bench.execution.at_rest
    assert bench.stops == 0


def test_success_needs_every_reply():
    bench = Bench(step=0.1)
    bench.go_and_answer()
    bench.go_and_answer()
    bench.move_to(LINE[-1])
    bench.see(1.0)
    assert not bench.outcomes
    bench.answer()
    bench.see(0.3)
    assert bench.outcome.end is End.SUCCEEDED


def test_success_needs_a_status_that_is_newer_than_the_last_reply():
    bench = Bench(step=0.1)
    bench.go_and_answer()
    bench.go_and_answer()
    bench.move_to(LINE[-1])
    bench.status()  # "not in motion", but from before the reply
    bench.answer()
    bench.see(0.5, status=False)
    assert bench.state == 'settling'
    bench.now += DT
    bench.status(in_motion=TriState.FALSE)
    bench.see(REST_TIME + 2 * DT, status=False)
    assert bench.outcome.end is End.SUCCEEDED


def test_success_waits_while_the_controller_says_that_it_moves():
    bench = Bench(step=0.1)
    bench.finish_points()
    bench.in_motion = TriState.TRUE
    bench.see(0.5)
    assert bench.state == 'settling'
    bench.in_motion = TriState.FALSE
    bench.see(0.2)
    assert bench.outcome.end is End.SUCCEEDED


@pytest.mark.parametrize('status', [True, False], ids=['UNKNOWN', 'no status at all'])
def test_where_in_motion_is_unknown_the_measured_standstill_decides(status):
    bench = Bench(in_motion=TriState.UNKNOWN, step=0.1)
    if not status:
        bench.robot.status = None
    for point in LINE:
        bench.move_to(point)
        bench.answer()
    assert bench.state == 'settling'
    bench.see(REST_TIME - 2 * DT, status=status)
    assert bench.state == 'settling'
    bench.see(0.15, status=status)
    assert bench.outcome.end is End.SUCCEEDED


def test_an_arm_that_passes_the_goal_is_not_at_the_goal():
    bench = Bench(in_motion=TriState.UNKNOWN, step=0.1)
    bench.finish_points()
    bench.at = np.array((0.985, 0.5))
    for _ in range(200):  # 0.02 rad/s, through the tolerance and out again
        bench.now += DT
        bench.joints(bench.at + np.array([0.02 * DT, 0.0]))
        assert not bench.outcomes
    bench.see(0.2)
    assert bench.outcome.end is End.SUCCEEDED


def at_the_last_point(seconds_after_the_joints):
    """Return a bench whose last reply came so long after the joints that showed the goal."""
    bench = Bench(in_motion=TriState.UNKNOWN, step=0.1)
    bench.go_and_answer()
    bench.go_and_answer()
    bench.move_to(LINE[-1])
    bench.see(0.1)
    bench.now += seconds_after_the_joints
    bench.answer()
    return bench


def test_joints_from_before_the_last_reply_do_not_count():
    """At 10 Hz: a status comes between the reply and the next joints."""
    bench = at_the_last_point(0.001)
    for _ in range(10):
        bench.now += 0.03
        bench.status()
        assert not bench.outcomes
    bench.joints()
    assert not bench.outcomes  # the first ones after the reply: perhaps it is about to move
    for _ in range(2):  # what comes later than it should may have been held up on its way
        bench.now += 0.1
        bench.joints()
    assert bench.outcome.end is End.SUCCEEDED


def test_one_look_at_the_arm_is_no_standstill():
    bench = at_the_last_point(0.1)
    bench.now += 0.005
    bench.joints()
    for _ in range(10):
        bench.now += 0.03
        bench.status()
        assert not bench.outcomes
    bench.see(0.1)
    assert bench.outcome.end is End.SUCCEEDED


@pytest.mark.parametrize('in_motion', [TriState.FALSE, TriState.UNKNOWN])
def test_a_path_that_ends_where_it_began_does_not_succeed_early(in_motion):
    """A controller that acknowledges before it moves: the arm stands at the goal at first."""
    bench = Bench(CYCLE, in_motion=in_motion, step=0.1)
    for _ in CYCLE:
        bench.answer()
    bench.see(0.5)
    assert bench.state == 'settling'
    bench.move_to(CYCLE[1])
    bench.see(0.3)
    assert bench.state == 'settling'
    bench.move_to(CYCLE[2])
    bench.see(0.3)
    assert bench.outcome.end is End.SUCCEEDED


def test_a_path_that_ends_where_it_began_and_never_happened_fails():
    bench = Bench(CYCLE, step=0.1)
    for _ in CYCLE:
        bench.answer()
    bench.see(SETTLE_TIME + 0.2)
    assert bench.outcome.end is End.ABORTED
    assert bench.outcome.code is ErrorCode.GOAL_TOLERANCE_VIOLATED
    assert 'did not move' in bench.outcome.text


def test_a_goal_where_the_arm_stands_already_succeeds():
    bench = Bench(((0.2, 0.1), (0.2, 0.1)), step=0.1)
    bench.answer()
    bench.answer()
    bench.see(0.2)
    assert bench.outcome.end is End.SUCCEEDED


def test_a_tolerance_that_is_off_is_not_checked():
    bench = Bench(tolerance=(0.01, np.inf), step=0.1)
    for _ in LINE:
        bench.answer()
    bench.move_to((1.0, -3.0))
    bench.see(0.3)
    assert bench.outcome.end is End.SUCCEEDED


def test_an_arm_that_rests_beside_the_goal_names_joint_distance_and_tolerance():
    bench = Bench(tolerance=(0.01, 0.02), step=0.1)
    bench.go_and_answer()
    bench.go_and_answer()
    bench.move_to((1.005, 0.475))
    bench.answer()
    bench.see(SETTLE_TIME - 0.1)
    assert not bench.outcomes
    bench.see(0.4)
    assert bench.outcome.end is End.ABORTED
    assert bench.outcome.code is ErrorCode.GOAL_TOLERANCE_VIOLATED
    assert 'joint_2 is 0.025 rad from the goal' in bench.outcome.text
    assert 'the tolerance is 0.02 rad' in bench.outcome.text
    assert 'joint_1' not in bench.outcome.text


# --- what the controller refuses --------------------------------------------------------------


@pytest.mark.parametrize('index', [0, 1, 2])
def test_a_failure_reply_sends_stop_and_ends_the_goal_with_the_controllers_error(index):
    bench = Bench()
    for _ in range(index):
        bench.go_and_answer()
    bench.refuse()
    assert bench.sequences == [*range(index + 1), -4]
    assert not bench.outcomes  # the next status says why
    bench.now += 0.03
    bench.status(error_code=4001)
    assert bench.outcome.end is End.ABORTED
    assert f'point {index} of 3' in bench.outcome.text
    assert 'FAILURE' in bench.outcome.text
    assert '4001' in bench.outcome.text
    assert not bench.execution.at_rest
    bench.see(1.0)
    assert bench.sequences == [*range(index + 1), -4]


def test_a_status_from_before_the_refusal_says_nothing_about_it():
    bench = Bench()
    bench.status(error_code=1234)
    bench.refuse()
    bench.see(CAUSE_TIME / 2, status=False)
    assert not bench.outcomes
    bench.see(CAUSE_TIME, status=False)
    assert bench.outcome.end is End.ABORTED
    assert '1234' not in bench.outcome.text
    assert 'FAILURE' in bench.outcome.text


def test_while_the_arm_brakes_after_a_refusal_the_reason_may_be_yet_to_come():
    bench = Bench(in_motion=TriState.TRUE)
    bench.go_and_answer()
    bench.refuse()
    bench.in_motion = TriState.TRUE
    bench.pass_time(0.03)
    bench.status(drives_powered=TriState.FALSE)
    bench.see(1.0, status=False)
    assert not bench.outcomes
    bench.execution.fault('the motors are off')  # what the driver makes of such a status
    assert 'FAILURE' in bench.outcome.text
    assert 'the motors are off' in bench.outcome.text


@pytest.mark.parametrize(('acknowledged', 'broken'), [(0, False), (1, True)])
def test_a_refusal_after_points_that_were_taken_breaks_the_goal_off(acknowledged, broken):
    bench = Bench()
    for _ in range(acknowledged):
        bench.go_and_answer()
    bench.refuse()
    bench.pass_time(0.03)
    bench.status(error_code=4001)
    assert bench.outcome.end is End.ABORTED
    assert bench.execution.broken_off is broken
    assert not bench.execution.unanswered


def test_a_missing_reply_breaks_the_goal_off():
    bench = Bench()
    bench.see(Settings().reply_timeout + 2.0)
    assert 'no reply' in bench.outcome.text
    assert bench.execution.broken_off
    assert bench.execution.unanswered


def test_a_stop_that_is_not_answered_breaks_the_goal_off():
    bench = Bench()
    bench.go_and_answer()
    bench.execution.cancel(bench.now)
    bench.see(Settings().reply_timeout + 0.1)
    assert 'standstill' in bench.outcome.text
    assert bench.execution.broken_off
    assert bench.execution.unanswered


def test_a_goal_that_was_canceled_in_time_does_not_break_off():
    bench = Bench()
    bench.execution.cancel(bench.now)
    bench.answer()
    bench.see(0.2)
    assert bench.outcome.end is End.CANCELED
    assert not bench.execution.broken_off


def test_a_refusal_ends_the_goal_within_a_tenth_of_a_second():
    bench = Bench()
    bench.refuse()
    before = bench.now
    while not bench.outcomes:
        bench.now += DT
        bench.joints()
    assert bench.now - before <= 0.1


def test_nothing_changes_a_refusal():
    bench = Bench()
    bench.refuse()
    bench.execution.cancel(bench.now)
    bench.execution.stop('replaced', bench.now)
    bench.execution.on_unsolicited_failure(bench.now)
    bench.answer(message=0)
    assert bench.state == 'refused'
    bench.execution.fault('the E-stop is pressed')
    assert 'FAILURE' in bench.outcome.text
    assert 'the E-stop is pressed' in bench.outcome.text
    assert bench.stops == 1


@pytest.mark.parametrize('acknowledged', [1, 3], ids=['while streaming', 'while settling'])
def test_an_acknowledgement_that_is_taken_back_ends_the_goal(acknowledged):
    """FANUC answers SUCCESS, and FAILURE for the same point later."""
    bench = Bench()
    for _ in range(acknowledged):
        bench.answer()
    bench.execution.on_unsolicited_failure(bench.now)
    assert bench.stops == 1
    bench.now += 0.03
    bench.status()
    assert bench.outcome.end is End.ABORTED
    assert 'withdrew' in bench.outcome.text


def test_a_failure_nobody_waits_for_does_not_disturb_a_cancel():
    bench = Bench()
    bench.execution.cancel(bench.now)
    bench.execution.on_unsolicited_failure(bench.now)
    bench.answer()
    bench.see(0.3)
    assert bench.outcome.end is End.CANCELED


def test_a_reply_to_a_point_that_is_not_on_its_way_changes_nothing():
    bench = Bench()
    bench.answer()
    bench.refuse(message=0)  # a second reply to point 0
    bench.answer(message=0)
    assert bench.sequences == [0, 1]
    assert bench.state == 'streaming'


# --- patience ---------------------------------------------------------------------------------

PATIENT = Settings(reply_timeout=2.0)


def test_a_reply_that_does_not_come_ends_the_goal():
    bench = Bench(settings=PATIENT)
    bench.go_and_answer()
    bench.see(2.9)  # patience and the planned duration of the point, 1 s
    assert not bench.outcomes
    bench.see(0.3)
    assert bench.outcome.end is End.ABORTED
    assert 'no reply to point 1 of 3' in bench.outcome.text
    assert bench.stops == 1


def test_patience_counts_from_the_last_reply():
    bench = Bench(settings=PATIENT)
    bench.see(2.5)
    bench.answer()
    bench.see(2.5)
    assert not bench.outcomes


def test_a_reply_is_waited_for_as_long_as_the_arm_moves():
    bench = Bench(((0.0, 0.0), (1.0, 0.0)), settings=PATIENT)
    bench.answer()
    bench.see(20.0, moving=0.03)
    assert not bench.outcomes
    bench.see(2.9)
    assert not bench.outcomes
    bench.see(0.3)
    assert 'no reply' in bench.outcome.text


def test_noise_of_the_encoders_is_no_sign_of_life():
    bench = Bench(settings=PATIENT)
    rest = bench.at
    for count in range(2000):
        bench.now += DT
        bench.joints(rest + 4e-5 * (-1) ** count)
    assert 'no reply to point 0' in bench.outcome.text


def test_a_standstill_that_the_controller_never_confirms_ends_the_goal():
    bench = Bench(settings=PATIENT)
    bench.finish_points()
    bench.in_motion = TriState.TRUE
    bench.see(2.5)
    assert bench.outcome.end is End.ABORTED
    assert 'standstill' in bench.outcome.text


def test_goal_time_ends_a_goal_that_takes_too_long():
    bench = Bench(goal_time=0.5)
    bench.see(2.4)
    assert not bench.outcomes
    bench.see(0.2)  # the plan takes 2 s
    assert bench.outcome.end is End.ABORTED
    assert bench.outcome.code is ErrorCode.GOAL_TOLERANCE_VIOLATED
    assert 'the plan takes 2 s' in bench.outcome.text
    assert '0.5 s' in bench.outcome.text
    assert bench.stops == 1


def test_goal_time_counts_while_settling_too():
    bench = Bench(goal_time=0.5)
    bench.finish_points()
    bench.in_motion = TriState.TRUE
    bench.see(2.5)
    assert bench.outcome.code is ErrorCode.GOAL_TOLERANCE_VIOLATED


def test_without_goal_time_a_slow_motion_is_no_failure():
    bench = Bench()
    bench.see(100.0, moving=0.002)
    assert not bench.outcomes


# --- cancel, stop, fault ----------------------------------------------------------------------


def test_cancel_sends_stop_at_once_and_ends_when_the_arm_stands():
    bench = Bench()
    bench.answer()
    bench.see(0.1, moving=0.5)
    bench.execution.cancel(bench.now)  # point 1 is not answered yet
    assert bench.sequences == [0, 1, -4]
    bench.refuse(message=1)
    bench.answer()
    bench.in_motion = TriState.TRUE
    bench.see(0.3, moving=0.3)
    assert bench.state == 'canceling'
    bench.in_motion = TriState.FALSE
    bench.see(0.3)
    assert bench.outcome.end is End.CANCELED
    assert bench.outcome.code is ErrorCode.SUCCESSFUL
    assert bench.execution.at_rest
    assert bench.sequences == [0, 1, -4]


def test_cancel_needs_the_reply_to_stop():
    bench = Bench()
    bench.execution.cancel(bench.now)
    bench.see(1.0)
    assert not bench.outcomes
    bench.answer()
    bench.see(0.3)
    assert bench.outcome.end is End.CANCELED


def test_cancel_while_settling():
    bench = Bench()
    for _ in LINE:
        bench.answer()
    bench.see(0.1, moving=1.0)
    bench.execution.cancel(bench.now)
    bench.answer()
    bench.see(0.3)
    assert bench.outcome.end is End.CANCELED


def test_stop_ends_as_aborted_with_its_reason():
    bench = Bench()
    bench.execution.stop('replaced by a new goal', bench.now)
    assert bench.sequences == [0, -4]
    bench.execution.stop('another reason', bench.now)
    bench.answer()
    bench.see(0.3)
    assert bench.outcome.end is End.ABORTED
    assert bench.outcome.text == 'replaced by a new goal; the arm stands'
    assert bench.stops == 1


def test_a_stop_that_is_canceled_ends_as_canceled_with_one_stop():
    bench = Bench()
    bench.execution.stop('replaced by a new goal', bench.now)
    bench.execution.cancel(bench.now)
    bench.answer()
    bench.see(0.3)
    assert bench.outcome.end is End.CANCELED
    assert bench.stops == 1


def test_a_cancel_that_is_stopped_stays_a_cancel():
    bench = Bench()
    bench.execution.cancel(bench.now)
    bench.execution.stop('replaced by a new goal', bench.now)
    bench.answer()
    bench.see(0.3)
    assert bench.outcome.end is End.CANCELED
    assert bench.stops == 1


def test_a_stop_that_is_refused_is_a_fault():
    bench = Bench()
    bench.execution.cancel(bench.now)
    bench.refuse()
    assert bench.outcome.end is End.ABORTED
    assert 'refused STOP' in bench.outcome.text
    assert not bench.execution.at_rest


def test_a_stop_that_is_not_answered_ends_the_goal():
    bench = Bench(settings=PATIENT)
    bench.execution.cancel(bench.now)
    bench.see(1.9)
    assert not bench.outcomes
    bench.see(0.3)
    assert bench.outcome.end is End.ABORTED
    assert 'standstill' in bench.outcome.text
    assert not bench.execution.at_rest


def test_replies_after_cancel_send_no_more_points():
    bench = Bench()
    bench.execution.cancel(bench.now)
    bench.answer(message=0)
    assert bench.sequences == [0, -4]
    assert bench.state == 'canceling'


def test_a_fault_ends_at_once_and_tries_to_stop():
    bench = Bench()
    bench.execution.fault('the E-stop is pressed')
    assert bench.outcome.end is End.ABORTED
    assert bench.outcome.text == 'the E-stop is pressed'
    assert bench.sequences == [0, -4]
    bench.execution.fault('again')
    bench.execution.cancel(bench.now)
    bench.execution.stop('again', bench.now)
    bench.execution.on_unsolicited_failure(bench.now)
    bench.answer()
    bench.see(3.0)
    assert bench.outcome.text == 'the E-stop is pressed'
    assert bench.sequences == [0, -4]


def test_a_lost_link_at_the_first_point():
    bench = Bench(start=False)
    bench.broken = True
    bench.start()
    assert bench.outcome.end is End.ABORTED
    assert 'point 0 of 3 could not be sent: test link is backing_off' in bench.outcome.text
    assert not bench.sent


def test_a_lost_link_in_the_middle():
    bench = Bench()
    bench.go_and_answer()
    bench.broken = True
    bench.answer()
    assert 'point 2 of 3 could not be sent' in bench.outcome.text
    assert bench.sequences == [0, 1]


@pytest.mark.parametrize('how', ['cancel', 'stop', 'fault', 'refuse'])
def test_a_lost_link_at_stop(how):
    bench = Bench()
    bench.go_and_answer()
    bench.broken = True
    if how == 'cancel':
        bench.execution.cancel(bench.now)
    elif how == 'stop':
        bench.execution.stop('replaced', bench.now)
    elif how == 'fault':
        bench.execution.fault('lost')
    else:
        bench.refuse()
        bench.see(0.2)
    assert bench.outcome.end is End.ABORTED
    assert not bench.execution.at_rest


def test_the_target_is_the_point_on_its_way():
    bench = Bench()
    assert bench.execution.target == 0
    bench.answer()
    assert bench.execution.target == 1
    bench.answer()
    bench.answer()
    assert bench.execution.target == 2


def test_a_state_without_joints_decides_nothing():
    bench = Bench(settings=PATIENT)
    bench.robot.clear()
    bench.pass_time(60.0)
    bench.execution.on_state(bench.robot, bench.now)
    assert not bench.outcomes


# --- before it is prepared --------------------------------------------------------------------


def test_nothing_is_sent_before_the_goal_is_prepared_and_that_may_take_its_time():
    bench = Bench(start=False, goal_time=1.0, settings=Settings(reply_timeout=1.0), step=0.1)
    bench.see(10.0)
    assert bench.state == 'preparing'
    assert bench.execution.target == 0
    assert not bench.sent
    began = bench.now
    bench.start()
    assert bench.execution.started == began
    assert bench.sequences == [0]
    bench.finish_points()
    bench.see(0.3)
    assert bench.outcome.end is End.SUCCEEDED


def test_what_was_prepared_is_what_is_executed():
    bench = Bench(start=False)
    planned = replace(bench.goal.trajectory, times=np.array([0.0, 0.1, 0.2]))
    bench.start(planned)
    assert bench.execution.goal.trajectory is planned
    assert bench.execution.goal.goal_tolerance is bench.goal.goal_tolerance


@pytest.mark.parametrize(('how', 'end'), [('cancel', End.CANCELED), ('stop', End.ABORTED)])
def test_inv5_a_goal_that_is_stopped_before_it_is_prepared_ends_at_rest(how, end):
    """docs/invariants.md, 5."""
    bench = Bench(start=False)
    if how == 'cancel':
        bench.execution.cancel(bench.now)
    else:
        bench.execution.stop('replaced', bench.now)
    assert bench.sequences == [-4]
    bench.start()  # the plan comes too late
    bench.answer()
    bench.see(0.3)
    assert bench.outcome.end is end
    assert bench.execution.at_rest
    assert bench.sequences == [-4]


def test_inv5_a_fault_before_it_is_prepared_ends_the_goal_and_nothing_is_sent():
    """docs/invariants.md, 5."""
    bench = Bench(start=False)
    assert bench.execution.where == 'before its first point'
    bench.execution.fault('the E-stop is pressed')
    bench.start()
    bench.see(1.0)
    assert bench.outcome.text == 'the E-stop is pressed'
    assert not bench.sent


# --- what the state alone can say -------------------------------------------------------------


@pytest.mark.invariant(9)
def test_inv9_a_way_shorter_than_the_tolerance_is_no_success_before_its_time():
    """docs/invariants.md, 9: all is acknowledged, and the arm has not begun to move."""
    bench = Bench(((0.0, 0.0), (0.009, 0.0)), in_motion=TriState.UNKNOWN)
    bench.answer()
    bench.answer()
    bench.see(0.8)
    assert bench.state == 'settling'
    bench.move_to((0.009, 0.0), 0.1)
    bench.see(0.2)
    assert bench.outcome.end is End.SUCCEEDED
    assert bench.now - bench.execution.started >= 1.0


@pytest.mark.invariant(9)
def test_inv9_a_rest_on_the_way_at_the_goals_place_is_no_success():
    """docs/invariants.md, 9: a plan that passes its end, waits there, and goes round once more."""
    path = ((0.0, 0.0), (1.0, 0.5), (1.0, 0.5), (0.5, 0.2), (1.0, 0.5))
    bench = Bench(path)
    for _ in path:
        bench.answer()
    bench.move_to(path[1], 1.0)
    bench.see(1.0)
    assert bench.state == 'settling'
    bench.move_to(path[3], 1.0)
    bench.move_to(path[4], 1.0)
    bench.see(0.3)
    assert bench.outcome.end is End.SUCCEEDED


@pytest.mark.invariant(9)
def test_inv9_a_reply_to_a_point_may_be_the_one_to_stop_and_the_state_decides():
    """docs/invariants.md, 9: one of the two never comes."""
    bench = Bench()
    bench.go_and_answer()
    bench.execution.cancel(bench.now)
    bench.answer(message=1)  # the point's, or STOP's in its place
    bench.see(1.0, moving=0.1)
    assert not bench.outcomes
    bench.see(DOUBTFUL_REST - 0.2)
    assert not bench.outcomes
    bench.see(0.5)
    assert bench.outcome.end is End.CANCELED
    assert 'a reply is missing' in bench.outcome.text
    assert bench.execution.broken_off
    assert bench.execution.unanswered


def test_a_reply_to_a_point_does_not_delay_a_stop_that_is_answered():
    bench = Bench()
    bench.go_and_answer()
    bench.execution.cancel(bench.now)
    bench.answer(message=1)
    bench.see(0.02)
    bench.answer()
    bench.see(0.2)
    assert bench.outcome.end is End.CANCELED
    assert bench.outcome.text == 'canceled; the arm stands'
    assert not bench.execution.broken_off
