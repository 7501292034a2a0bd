# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A goal's way to its one outcome, on a manual clock (docs/invariants.md, 5)."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from support.goal_execution_harness import CYCLE, DT, LIMITS, LINE, Harness

from epson_driver.driver.goal.goal import CAUSE_TIMEOUT_S, GoalSettings
from epson_driver.driver.goal.goal_execution import SETTLE_TIME_S
from epson_driver.driver.goal.goal_states import (
    AFTERMATH,
    FINAL_STATES,
    TRANSITIONS,
    GoalEvent,
    GoalState,
)
from epson_driver.driver.outcome import End, ErrorCode
from epson_driver.driver.state.standstill import (
    REST_TIME_S,
    UNCONFIRMED_REST_TIME_S,
    UNSAID_REST_TIME_S,
)
from epson_driver.simple_message import TriState

pytestmark = pytest.mark.invariant(5)

SUCCESSES = (GoalState.SUCCEEDED, GoalState.CANCELED)


def test_a_goal_succeeds_and_is_canceled_in_one_way_each():
    ways = {(state, event) for (state, event), end in TRANSITIONS.items() if end in SUCCESSES}
    assert ways == {
        (GoalState.SETTLING, GoalEvent.AT_GOAL),
        (GoalState.CANCELING, GoalEvent.AT_REST),
        (GoalState.CANCELING_CONFIRMED, GoalEvent.AT_REST),
    }


def test_points_are_sent_before_and_never_after_anything_else():
    before = {pair for pair, state in TRANSITIONS.items() if state is GoalState.STREAMING}
    assert before == {(GoalState.PREPARING, GoalEvent.PREPARED)}


def test_a_cancel_and_a_stop_are_heard_until_the_arm_brakes_and_a_cancel_then_too():
    for state in (GoalState.PREPARING, GoalState.STREAMING, GoalState.SETTLING):
        assert TRANSITIONS[state, GoalEvent.CANCEL] is GoalState.CANCELING
        assert TRANSITIONS[state, GoalEvent.STOP] is GoalState.STOPPING
    assert TRANSITIONS[GoalState.STOPPING, GoalEvent.CANCEL] is GoalState.CANCELING
    confirmed = TRANSITIONS[GoalState.STOPPING_CONFIRMED, GoalEvent.CANCEL]
    assert confirmed is GoalState.CANCELING_CONFIRMED


def test_final_states_have_no_way_out_and_all_others_end_by_a_fault():
    assert {state.value for state in FINAL_STATES} == {'succeeded', 'canceled', 'aborted'}
    assert not {pair for pair in product(FINAL_STATES, GoalEvent) if pair in TRANSITIONS}
    for state in set(GoalState) - FINAL_STATES:
        assert TRANSITIONS[state, GoalEvent.FAULT] is GoalState.ABORTED


def test_what_is_known_afterwards_is_said_of_every_change_that_ends_a_goal_but_faults():
    ends = {pair for pair, state in TRANSITIONS.items() if state in FINAL_STATES}
    assert set(AFTERMATH) <= ends
    faults = {pair for pair in ends if pair[1] is GoalEvent.FAULT}
    assert ends - set(AFTERMATH) == faults - {(GoalState.REJECTED_MIDWAY, GoalEvent.FAULT)}
    for (state, event), known in AFTERMATH.items():
        assert known.at_rest == (event in (GoalEvent.AT_REST, GoalEvent.AT_GOAL))
        assert known.unanswered <= known.broken_off
        confirmed = state in (GoalState.CANCELING_CONFIRMED, GoalState.STOPPING_CONFIRMED)
        if event is GoalEvent.AT_REST:
            assert known.broken_off is not confirmed


# --- success ----------------------------------------------------------------------------------


def test_points_go_one_at_a_time_and_the_goal_succeeds_when_the_arm_stands_there():
    harness = Harness(step=0.1)
    for count in range(1, 4):
        assert harness.sequences == list(range(count))
        harness.see(0.3)
        assert harness.sequences == list(range(count))  # nothing before the reply
        harness.go_and_answer()
    assert harness.state == 'settling'
    harness.see(0.3)
    assert harness.outcome.end is End.SUCCEEDED
    assert harness.outcome.code is ErrorCode.SUCCESSFUL
    assert 'at the goal' in harness.outcome.text
    assert harness.execution.ended
    assert harness.execution.aftermath.at_rest
    assert harness.stops == 0


def test_success_needs_every_reply():
    harness = Harness(step=0.1)
    harness.go_and_answer()
    harness.go_and_answer()
    harness.move_to(LINE[-1])
    harness.see(1.0)
    assert not harness.outcomes
    harness.answer()
    harness.see(0.3)
    assert harness.outcome.end is End.SUCCEEDED


def test_success_needs_a_status_that_is_newer_than_the_last_reply():
    harness = Harness(step=0.1)
    harness.go_and_answer()
    harness.go_and_answer()
    harness.move_to(LINE[-1])
    harness.status()  # "not in motion", but from before the reply
    harness.answer()
    harness.see(0.5, status=False)
    assert harness.state == 'settling'
    harness.now += DT
    harness.status(in_motion=TriState.FALSE)
    harness.see(REST_TIME_S + 2 * DT, status=False)
    assert harness.outcome.end is End.SUCCEEDED


def test_success_waits_while_the_controller_says_that_it_moves():
    harness = Harness(step=0.1)
    harness.finish_points()
    harness.in_motion = TriState.TRUE
    harness.see(0.5)
    assert harness.state == 'settling'
    harness.in_motion = TriState.FALSE
    harness.see(0.2)
    assert harness.outcome.end is End.SUCCEEDED


@pytest.mark.parametrize('status', [True, False], ids=['UNKNOWN', 'no status at all'])
def test_where_in_motion_is_unknown_the_measured_standstill_decides(status):
    harness = Harness(in_motion=TriState.UNKNOWN, step=0.1)
    if not status:
        harness.robot.status = None
    for point in LINE:
        harness.move_to(point)
        harness.answer()
    assert harness.state == 'settling'
    harness.see(UNSAID_REST_TIME_S - 2 * DT, status=status)
    assert harness.state == 'settling'
    harness.see(0.15, status=status)
    assert harness.outcome.end is End.SUCCEEDED


def test_an_arm_that_passes_the_goal_is_not_at_the_goal():
    harness = Harness(in_motion=TriState.UNKNOWN, step=0.1)
    harness.finish_points()
    harness.at = np.array((0.985, 0.5))
    for _ in range(200):  # 0.02 rad/s, through the tolerance and out again
        harness.now += DT
        harness.joints(harness.at + np.array([0.02 * DT, 0.0]))
        assert not harness.outcomes
    harness.see(UNSAID_REST_TIME_S + 0.1)
    assert harness.outcome.end is End.SUCCEEDED


@pytest.mark.invariant(9)
def test_inv9_an_arm_that_creeps_is_not_at_the_goal_yet():
    """docs/invariants.md, 9: slower than what counts as standing; nobody says it."""
    harness = Harness(in_motion=TriState.UNKNOWN, step=0.1)
    harness.finish_points()
    harness.at = np.array((0.993, 0.5))
    harness.see(1.0, moving=0.005)
    assert not harness.outcomes
    harness.see(UNSAID_REST_TIME_S + 0.1)
    assert harness.outcome.end is End.SUCCEEDED


def at_the_last_point(seconds_after_the_joints):
    """Return a harness whose last reply came so long after the joints that showed the goal."""
    harness = Harness(in_motion=TriState.UNKNOWN, step=0.1)
    harness.go_and_answer()
    harness.go_and_answer()
    harness.move_to(LINE[-1])
    harness.see(0.1)
    harness.now += seconds_after_the_joints
    harness.answer()
    return harness


def test_joints_from_before_the_last_reply_do_not_count():
    """At 10 Hz: a status comes between the reply and the next joints."""
    harness = at_the_last_point(0.001)
    for _ in range(10):
        harness.now += 0.03
        harness.status()
        assert not harness.outcomes
    harness.joints()
    assert not harness.outcomes  # the first ones after the reply: perhaps it is about to move
    for _ in range(7):  # what comes later than it should may have been held up on its way
        harness.now += 0.1
        harness.joints()
    assert harness.outcome.end is End.SUCCEEDED


def test_one_look_at_the_arm_is_no_standstill():
    harness = at_the_last_point(0.1)
    harness.now += 0.005
    harness.joints()
    for _ in range(10):
        harness.now += 0.03
        harness.status()
        assert not harness.outcomes
    harness.see(UNSAID_REST_TIME_S + 0.05)
    assert harness.outcome.end is End.SUCCEEDED


@pytest.mark.parametrize('in_motion', [TriState.FALSE, TriState.UNKNOWN])
def test_a_path_that_ends_where_it_began_does_not_succeed_early(in_motion):
    """A controller that acknowledges before it moves: the arm stands at the goal at first."""
    harness = Harness(CYCLE, in_motion=in_motion, step=0.1)
    for _ in CYCLE:
        harness.answer()
    harness.see(0.5)
    assert harness.state == 'settling'
    harness.move_to(CYCLE[1])
    harness.see(0.3)
    assert harness.state == 'settling'
    harness.move_to(CYCLE[2])
    harness.see(0.3)
    assert harness.outcome.end is End.SUCCEEDED


def test_a_path_that_ends_where_it_began_and_never_happened_fails():
    harness = Harness(CYCLE, step=0.1)
    for _ in CYCLE:
        harness.answer()
    harness.see(0.2 + SETTLE_TIME_S)  # the plan takes 0.2 s
    assert not harness.outcomes
    harness.see(0.1)
    assert harness.outcome.end is End.ABORTED
    assert harness.outcome.code is ErrorCode.GOAL_TOLERANCE_VIOLATED
    assert 'did not move' in harness.outcome.text


def test_a_goal_where_the_arm_stands_already_succeeds():
    harness = Harness(((0.2, 0.1), (0.2, 0.1)), step=0.1)
    harness.answer()
    harness.answer()
    harness.see(0.2)
    assert harness.outcome.end is End.SUCCEEDED


def test_a_tolerance_that_is_off_is_not_checked():
    harness = Harness(tolerance=(0.01, np.inf), step=0.1)
    for _ in LINE:
        harness.answer()
    harness.move_to((1.0, -3.0))
    harness.see(0.3)
    assert harness.outcome.end is End.SUCCEEDED


def test_an_arm_that_rests_beside_the_goal_names_joint_distance_and_tolerance():
    harness = Harness(tolerance=(0.01, 0.02), step=0.1)
    harness.go_and_answer()
    harness.go_and_answer()
    harness.move_to((1.005, 0.475))
    harness.answer()
    harness.see(SETTLE_TIME_S - 0.1)
    assert not harness.outcomes
    harness.see(0.4)
    assert harness.outcome.end is End.ABORTED
    assert harness.outcome.code is ErrorCode.GOAL_TOLERANCE_VIOLATED
    assert 'joint_2 is 0.025 rad from the goal' in harness.outcome.text
    assert 'the tolerance is 0.02 rad' in harness.outcome.text
    assert 'joint_1' not in harness.outcome.text


# --- what the controller refuses --------------------------------------------------------------


@pytest.mark.parametrize('index', [0, 1, 2])
def test_a_failure_reply_sends_stop_and_ends_the_goal_with_the_controllers_error(index):
    harness = Harness()
    for _ in range(index):
        harness.go_and_answer()
    harness.refuse()
    assert harness.sequences == [*range(index + 1), -4]
    assert not harness.outcomes  # the next status says why
    harness.now += 0.03
    harness.status(error_code=4001)
    assert harness.outcome.end is End.ABORTED
    assert f'point {index} of 3' in harness.outcome.text
    assert 'FAILURE' in harness.outcome.text
    assert '4001' in harness.outcome.text
    assert not harness.execution.aftermath.at_rest
    harness.see(1.0)
    assert harness.sequences == [*range(index + 1), -4]


def test_a_status_from_before_the_rejection_says_nothing_about_it():
    harness = Harness()
    harness.status(error_code=1234)
    harness.refuse()
    harness.see(CAUSE_TIMEOUT_S / 2, status=False)
    assert not harness.outcomes
    harness.see(CAUSE_TIMEOUT_S, status=False)
    assert harness.outcome.end is End.ABORTED
    assert '1234' not in harness.outcome.text
    assert 'FAILURE' in harness.outcome.text


def test_while_the_arm_brakes_after_a_rejection_the_reason_may_be_yet_to_come():
    harness = Harness(in_motion=TriState.TRUE)
    harness.go_and_answer()
    harness.refuse()
    harness.in_motion = TriState.TRUE
    harness.pass_time(0.03)
    harness.status(drives_powered=TriState.FALSE)
    harness.see(1.0, status=False)
    assert not harness.outcomes
    harness.execution.fault('the motors are off')  # what the driver makes of such a status
    assert 'FAILURE' in harness.outcome.text
    assert 'the motors are off' in harness.outcome.text


@pytest.mark.parametrize(('acknowledged', 'broken'), [(0, False), (1, True)])
def test_a_rejection_after_points_that_were_taken_breaks_the_goal_off(acknowledged, broken):
    harness = Harness()
    for _ in range(acknowledged):
        harness.go_and_answer()
    harness.refuse()
    harness.pass_time(0.03)
    harness.status(error_code=4001)
    assert harness.outcome.end is End.ABORTED
    assert harness.execution.aftermath.broken_off is broken
    assert not harness.execution.aftermath.unanswered


def test_a_missing_reply_breaks_the_goal_off():
    harness = Harness()
    harness.see(GoalSettings().reply_timeout + 2.0)
    assert 'no reply' in harness.outcome.text
    assert harness.execution.aftermath.broken_off
    assert harness.execution.aftermath.unanswered


def test_a_stop_that_is_not_answered_breaks_the_goal_off():
    harness = Harness()
    harness.go_and_answer()
    harness.execution.cancel(harness.now)
    harness.see(GoalSettings().reply_timeout + 0.1)
    assert 'standstill' in harness.outcome.text
    assert harness.execution.aftermath.broken_off
    assert harness.execution.aftermath.unanswered


def test_a_goal_that_was_canceled_in_time_does_not_break_off():
    harness = Harness()
    harness.execution.cancel(harness.now)
    harness.answer()
    harness.see(0.2)
    assert harness.outcome.end is End.CANCELED
    assert not harness.execution.aftermath.broken_off


def test_a_rejection_ends_the_goal_within_a_tenth_of_a_second():
    harness = Harness()
    harness.refuse()
    before = harness.now
    while not harness.outcomes:
        harness.now += DT
        harness.joints()
    assert harness.now - before <= 0.1


def test_nothing_changes_a_rejection():
    harness = Harness()
    harness.refuse()
    harness.execution.cancel(harness.now)
    harness.execution.stop('replaced', harness.now)
    harness.execution.on_unsolicited_failure(harness.now)
    harness.answer(message=0)
    assert harness.state == 'rejected'
    harness.execution.fault('the E-stop is pressed')
    assert 'FAILURE' in harness.outcome.text
    assert 'the E-stop is pressed' in harness.outcome.text
    assert harness.stops == 1


@pytest.mark.parametrize('acknowledged', [1, 3], ids=['while streaming', 'while settling'])
def test_an_acknowledgement_that_is_taken_back_ends_the_goal(acknowledged):
    """FANUC answers SUCCESS, and FAILURE for the same point later."""
    harness = Harness()
    for _ in range(acknowledged):
        harness.answer()
    harness.execution.on_unsolicited_failure(harness.now)
    assert harness.stops == 1
    harness.now += 0.03
    harness.status()
    assert harness.outcome.end is End.ABORTED
    assert 'withdrew' in harness.outcome.text


def test_a_failure_nobody_waits_for_does_not_disturb_a_cancel():
    harness = Harness()
    harness.execution.cancel(harness.now)
    harness.execution.on_unsolicited_failure(harness.now)
    harness.answer()
    harness.see(0.3)
    assert harness.outcome.end is End.CANCELED


def test_a_reply_to_a_point_that_is_not_on_its_way_changes_nothing():
    harness = Harness()
    harness.answer()
    harness.refuse(message=0)  # a second reply to point 0
    harness.answer(message=0)
    assert harness.sequences == [0, 1]
    assert harness.state == 'streaming'


# --- patience ---------------------------------------------------------------------------------

PATIENT = GoalSettings(reply_timeout=2.0)


def test_a_reply_that_does_not_come_ends_the_goal():
    harness = Harness(settings=PATIENT)
    harness.go_and_answer()
    harness.see(2.9)  # patience and the planned duration of the point, 1 s
    assert not harness.outcomes
    harness.see(0.3)
    assert harness.outcome.end is End.ABORTED
    assert 'no reply to point 1 of 3' in harness.outcome.text
    assert harness.stops == 1


def test_patience_counts_from_the_last_reply():
    harness = Harness(settings=PATIENT)
    harness.see(2.5)
    harness.answer()
    harness.see(2.5)
    assert not harness.outcomes


def test_a_reply_is_waited_for_as_long_as_the_arm_moves():
    harness = Harness(((0.0, 0.0), (1.0, 0.0)), settings=PATIENT)
    harness.answer()
    harness.see(20.0, moving=0.03)
    assert not harness.outcomes
    harness.see(2.9)
    assert not harness.outcomes
    harness.see(0.3)
    assert 'no reply' in harness.outcome.text


def test_noise_of_the_encoders_is_no_sign_of_life():
    harness = Harness(settings=PATIENT)
    rest = harness.at
    for count in range(2000):
        harness.now += DT
        harness.joints(rest + 4e-5 * (-1) ** count)
    assert 'no reply to point 0' in harness.outcome.text


def test_a_standstill_that_the_controller_never_confirms_ends_the_goal():
    harness = Harness(settings=PATIENT)
    harness.finish_points()
    harness.in_motion = TriState.TRUE
    harness.see(2.0 + 2.0 - (harness.now - harness.execution.started))  # the plan takes 2 s, too
    assert not harness.outcomes
    harness.see(0.1)
    assert harness.outcome.end is End.ABORTED
    assert 'standstill' in harness.outcome.text


def test_goal_time_ends_a_goal_that_takes_too_long():
    harness = Harness(goal_time=0.5)
    harness.see(2.4)
    assert not harness.outcomes
    harness.see(0.2)  # the plan takes 2 s
    assert harness.outcome.end is End.ABORTED
    assert harness.outcome.code is ErrorCode.GOAL_TOLERANCE_VIOLATED
    assert 'the plan takes 2 s' in harness.outcome.text
    assert '0.5 s' in harness.outcome.text
    assert harness.stops == 1


def test_goal_time_counts_while_settling_too():
    harness = Harness(goal_time=0.5)
    harness.finish_points()
    harness.in_motion = TriState.TRUE
    harness.see(2.5)
    assert harness.outcome.code is ErrorCode.GOAL_TOLERANCE_VIOLATED


def test_without_goal_time_a_slow_motion_is_no_failure():
    harness = Harness()
    harness.see(100.0, moving=0.002)
    assert not harness.outcomes


# --- cancel, stop, fault ----------------------------------------------------------------------


def test_cancel_sends_stop_at_once_and_ends_when_the_arm_stands():
    harness = Harness()
    harness.answer()
    harness.see(0.1, moving=0.5)
    harness.execution.cancel(harness.now)  # point 1 is not answered yet
    assert harness.sequences == [0, 1, -4]
    harness.refuse(message=1)
    harness.answer()
    harness.in_motion = TriState.TRUE
    harness.see(0.3, moving=0.3)
    assert harness.state == 'canceling, confirmed'
    harness.in_motion = TriState.FALSE
    harness.see(0.3)
    assert harness.outcome.end is End.CANCELED
    assert harness.outcome.code is ErrorCode.SUCCESSFUL
    assert harness.execution.aftermath.at_rest
    assert harness.sequences == [0, 1, -4]


def test_cancel_needs_the_reply_to_stop():
    harness = Harness()
    harness.execution.cancel(harness.now)
    harness.see(1.0)
    assert not harness.outcomes
    harness.answer()
    harness.see(0.3)
    assert harness.outcome.end is End.CANCELED


def test_cancel_while_settling():
    harness = Harness()
    for _ in LINE:
        harness.answer()
    harness.see(0.1, moving=1.0)
    harness.execution.cancel(harness.now)
    harness.answer()
    harness.see(0.3)
    assert harness.outcome.end is End.CANCELED


def test_stop_ends_as_aborted_with_its_reason():
    harness = Harness()
    harness.execution.stop('replaced by a new goal', harness.now)
    assert harness.sequences == [0, -4]
    harness.execution.stop('another reason', harness.now)
    harness.answer()
    harness.see(0.3)
    assert harness.outcome.end is End.ABORTED
    assert harness.outcome.text == 'replaced by a new goal; the arm stands'
    assert harness.stops == 1


def test_a_stop_that_is_canceled_ends_as_canceled_with_one_stop():
    harness = Harness()
    harness.execution.stop('replaced by a new goal', harness.now)
    harness.execution.cancel(harness.now)
    harness.answer()
    harness.see(0.3)
    assert harness.outcome.end is End.CANCELED
    assert harness.stops == 1


def test_a_cancel_that_is_stopped_stays_a_cancel():
    harness = Harness()
    harness.execution.cancel(harness.now)
    harness.execution.stop('replaced by a new goal', harness.now)
    harness.answer()
    harness.see(0.3)
    assert harness.outcome.end is End.CANCELED
    assert harness.stops == 1


def test_a_stop_that_is_refused_is_a_fault():
    harness = Harness()
    harness.execution.cancel(harness.now)
    harness.refuse()
    assert harness.outcome.end is End.ABORTED
    assert 'refused STOP' in harness.outcome.text
    assert not harness.execution.aftermath.at_rest


def test_a_stop_that_is_not_answered_ends_the_goal():
    harness = Harness(settings=PATIENT)
    harness.execution.cancel(harness.now)
    harness.see(1.9)
    assert not harness.outcomes
    harness.see(0.3)
    assert harness.outcome.end is End.ABORTED
    assert 'standstill' in harness.outcome.text
    assert not harness.execution.aftermath.at_rest


def test_replies_after_cancel_send_no_more_points():
    harness = Harness()
    harness.execution.cancel(harness.now)
    harness.answer(message=0)
    assert harness.sequences == [0, -4]
    assert harness.state == 'canceling'


def test_a_fault_ends_at_once_and_tries_to_stop():
    harness = Harness()
    harness.execution.fault('the E-stop is pressed')
    assert harness.outcome.end is End.ABORTED
    assert harness.outcome.text == 'the E-stop is pressed'
    assert harness.sequences == [0, -4]
    harness.execution.fault('again')
    harness.execution.cancel(harness.now)
    harness.execution.stop('again', harness.now)
    harness.execution.on_unsolicited_failure(harness.now)
    harness.answer()
    harness.see(3.0)
    assert harness.outcome.text == 'the E-stop is pressed'
    assert harness.sequences == [0, -4]


def test_a_lost_link_at_the_first_point():
    harness = Harness(start=False)
    harness.broken = True
    harness.start()
    assert harness.outcome.end is End.ABORTED
    assert 'point 0 of 3 could not be sent: test link is backing_off' in harness.outcome.text
    assert not harness.sent


def test_a_lost_link_in_the_middle():
    harness = Harness()
    harness.go_and_answer()
    harness.broken = True
    harness.answer()
    assert 'point 2 of 3 could not be sent' in harness.outcome.text
    assert harness.sequences == [0, 1]


@pytest.mark.parametrize('how', ['cancel', 'stop', 'fault', 'refuse'])
def test_a_lost_link_at_stop(how):
    harness = Harness()
    harness.go_and_answer()
    harness.broken = True
    if how == 'cancel':
        harness.execution.cancel(harness.now)
    elif how == 'stop':
        harness.execution.stop('replaced', harness.now)
    elif how == 'fault':
        harness.execution.fault('lost')
    else:
        harness.refuse()
        harness.see(0.2)
    assert harness.outcome.end is End.ABORTED
    assert not harness.execution.aftermath.at_rest


def test_the_target_is_the_point_on_its_way():
    harness = Harness()
    assert harness.execution.target == 0
    harness.answer()
    assert harness.execution.target == 1
    harness.answer()
    harness.answer()
    assert harness.execution.target == 2


def test_a_state_without_joints_decides_nothing():
    harness = Harness(settings=PATIENT)
    harness.robot.clear()
    harness.pass_time(60.0)
    harness.execution.on_state(harness.robot, harness.now)
    assert not harness.outcomes


OUT_AND_BACK = [(0.1 * each, 0.0) for each in (0, 1, 2, 3, 4, 5, 6, 5, 4, 3, 2, 1, 0)]


def test_further_pauses_before_the_rest_is_sent_change_nothing():
    harness = Harness(OUT_AND_BACK)
    harness.see(0.5)
    for _ in range(4):
        harness.answer()
        harness.see(1.0, moving=0.1)
    harness.execution.pause(harness.now)
    harness.answer()
    harness.see(0.5)
    for _ in range(3):
        assert harness.state == 'paused'
        harness.execution.resume(harness.robot.sample, LIMITS, 0.02)
        left = harness.execution.goal.trajectory.positions[1:, 0]
        np.testing.assert_allclose(left, [0.5, 0.6, 0.5, 0.4, 0.3, 0.2, 0.1, 0.0])
        harness.execution.pause(harness.now)


# --- before it is prepared --------------------------------------------------------------------


def test_nothing_is_sent_before_the_goal_is_prepared_and_that_may_take_its_time():
    harness = Harness(
        start=False, goal_time=1.0, settings=GoalSettings(reply_timeout=1.0), step=0.1
    )
    harness.see(10.0)
    assert harness.state == 'preparing'
    assert harness.execution.target == 0
    assert not harness.sent
    began = harness.now
    harness.start()
    assert harness.execution.started == began
    assert harness.sequences == [0]
    harness.finish_points()
    harness.see(0.3)
    assert harness.outcome.end is End.SUCCEEDED


def test_what_was_prepared_is_what_is_executed():
    harness = Harness(start=False)
    planned = replace(harness.goal.trajectory, times=np.array([0.0, 0.1, 0.2]))
    harness.start(planned)
    assert harness.execution.goal.trajectory is planned
    assert harness.execution.goal.goal_tolerance is harness.goal.goal_tolerance


@pytest.mark.parametrize(('how', 'end'), [('cancel', End.CANCELED), ('stop', End.ABORTED)])
def test_inv5_a_goal_that_is_stopped_before_it_is_prepared_ends_at_rest(how, end):
    """docs/invariants.md, 5."""
    harness = Harness(start=False)
    if how == 'cancel':
        harness.execution.cancel(harness.now)
    else:
        harness.execution.stop('replaced', harness.now)
    assert harness.sequences == [-4]
    harness.start()  # the plan comes too late
    harness.answer()
    harness.see(0.3)
    assert harness.outcome.end is end
    assert harness.execution.aftermath.at_rest
    assert harness.sequences == [-4]


def test_inv5_a_fault_before_it_is_prepared_ends_the_goal_and_nothing_is_sent():
    """docs/invariants.md, 5."""
    harness = Harness(start=False)
    assert harness.execution.where == 'before its first point'
    harness.execution.fault('the E-stop is pressed')
    harness.start()
    harness.see(1.0)
    assert harness.outcome.text == 'the E-stop is pressed'
    assert not harness.sent


# --- what the state alone can say -------------------------------------------------------------


@pytest.mark.invariant(9)
def test_inv9_a_way_shorter_than_the_tolerance_is_no_success_before_its_time():
    """docs/invariants.md, 9: all is acknowledged, and the arm has not begun to move."""
    harness = Harness(((0.0, 0.0), (0.009, 0.0)), in_motion=TriState.UNKNOWN)
    harness.answer()
    harness.answer()
    harness.see(0.8)
    assert harness.state == 'settling'
    harness.move_to((0.009, 0.0), 0.1)
    harness.see(UNSAID_REST_TIME_S + 0.1)
    assert harness.outcome.end is End.SUCCEEDED
    assert harness.now - harness.execution.started >= 1.0


def small_goal(way, **options):
    """Return a harness of which all is acknowledged, and the plan's 0.5 s are over."""
    harness = Harness(((0.0, 0.0), (way, 0.0)), in_motion=TriState.UNKNOWN, step=0.5, **options)
    harness.answer()
    harness.answer()
    harness.see(0.5)
    return harness


@pytest.mark.invariant(9)
def test_inv9_an_arm_that_has_not_left_its_start_is_not_at_the_goal():
    """docs/invariants.md, 9: the start is within the tolerance, and the arm begins late."""
    harness = small_goal(0.009)
    harness.see(0.9)
    assert not harness.outcomes
    harness.move_to((0.009, 0.0), 0.1)
    assert not harness.outcomes
    harness.see(UNSAID_REST_TIME_S + 0.1)
    assert harness.outcome.end is End.SUCCEEDED


@pytest.mark.invariant(9)
@pytest.mark.parametrize(('goal_time', 'ends'), [(0.0, SETTLE_TIME_S), (0.3, 0.3)])
def test_inv9_a_small_way_that_the_arm_never_went_fails_in_time(goal_time, ends):
    """docs/invariants.md, 9."""
    harness = small_goal(0.009, goal_time=goal_time)
    harness.see(ends - 0.05)
    assert not harness.outcomes
    harness.see(0.1)
    assert harness.outcome.code is ErrorCode.GOAL_TOLERANCE_VIOLATED


def test_a_way_that_hardly_shows_need_not_be_seen():
    harness = small_goal(0.5e-3, goal_time=0.3)
    harness.see(0.05)
    assert harness.outcome.end is End.SUCCEEDED


@pytest.mark.invariant(9)
def test_inv9_a_rest_on_the_way_at_the_goals_place_is_no_success():
    """docs/invariants.md, 9: a plan that passes its end, waits there, and goes round once more."""
    path = ((0.0, 0.0), (1.0, 0.5), (1.0, 0.5), (0.5, 0.2), (1.0, 0.5))
    harness = Harness(path)
    for _ in path:
        harness.answer()
    harness.move_to(path[1], 1.0)
    harness.see(1.0)
    assert harness.state == 'settling'
    harness.move_to(path[3], 1.0)
    harness.move_to(path[4], 1.0)
    harness.see(0.3)
    assert harness.outcome.end is End.SUCCEEDED


@pytest.mark.invariant(9)
def test_inv9_a_reply_to_a_point_may_be_the_one_to_stop_and_the_state_decides():
    """docs/invariants.md, 9: one of the two never comes."""
    harness = Harness()
    harness.go_and_answer()
    harness.execution.cancel(harness.now)
    harness.answer(message=1)  # the point's, or STOP's in its place
    harness.see(1.0, moving=0.1)
    assert not harness.outcomes
    harness.see(UNCONFIRMED_REST_TIME_S - 0.2)
    assert not harness.outcomes
    harness.see(0.5)
    assert harness.outcome.end is End.CANCELED
    assert 'a reply is missing' in harness.outcome.text
    assert harness.execution.aftermath.broken_off
    assert harness.execution.aftermath.unanswered


def test_a_reply_to_a_point_does_not_delay_a_stop_that_is_answered():
    harness = Harness()
    harness.go_and_answer()
    harness.execution.cancel(harness.now)
    harness.answer(message=1)
    harness.see(0.02)
    harness.answer()
    harness.see(0.2)
    assert harness.outcome.end is End.CANCELED
    assert harness.outcome.text == 'canceled; the arm stands'
    assert not harness.execution.aftermath.broken_off
