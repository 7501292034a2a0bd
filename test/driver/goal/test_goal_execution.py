# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The execution of a goal up to its single outcome, on a manual clock (docs/invariants.md, 5)."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from support.goal_execution_harness import CYCLE, DT, LIMITS, LINE, Harness

from epson_driver.driver.goal.goal import CAUSE_TIMEOUT_S, GoalSettings
from epson_driver.driver.goal.goal_execution import SETTLE_TIME_S
from epson_driver.driver.goal.goal_states import (
    AFTERMATH,
    AT_REST,
    BRAKING_STATES,
    CONFIRMED_STATES,
    FINAL_STATES,
    NO_REPLY,
    REJECTED_STATES,
    TRANSITIONS,
    UNCONFIRMED_STATES,
    GoalEvent,
    GoalState,
)
from epson_driver.driver.outcome import End, ErrorCode
from epson_driver.driver.state.joint_velocity import VELOCITY_WINDOW_S
from epson_driver.driver.state.standstill import (
    REST_TIME_S,
    UNCONFIRMED_REST_TIME_S,
    UNREPORTED_REST_TIME_S,
)
from epson_driver.simple_message import TriState, joint_data

pytestmark = pytest.mark.invariant(5)


def reachable(without=None):
    """Return the states that a goal can reach if one event never occurs."""
    states: set[GoalState] = set()
    result = {GoalState.PREPARING}
    while result != states:
        states = result
        result = states | {
            after
            for (before, event), after in TRANSITIONS.items()
            if before in states and event is not without
        }
    return states


@pytest.mark.parametrize(
    ('state', 'events'),
    [
        (GoalState.STREAMING, (GoalEvent.PREPARED,)),
        (GoalState.SUCCEEDED, (GoalEvent.PREPARED, GoalEvent.LAST_REPLY, GoalEvent.AT_GOAL)),
        (GoalState.CANCELED, (GoalEvent.CANCEL, GoalEvent.AT_REST)),
        (GoalState.PAUSED, (GoalEvent.PAUSE,)),
    ],
)
def test_goal_state_is_reached_only_by_its_listed_events(state, events):
    assert state in reachable()
    for event in events:
        assert state not in reachable(without=event), event


def test_points_are_sent_only_after_preparation():
    before = {pair for pair, state in TRANSITIONS.items() if state is GoalState.STREAMING}
    assert before == {(GoalState.PREPARING, GoalEvent.PREPARED)}


def test_cancel_is_accepted_until_the_end_and_stop_until_the_arm_brakes():
    for state in set(GoalState) - FINAL_STATES - REJECTED_STATES - BRAKING_STATES:
        assert TRANSITIONS[state, GoalEvent.CANCEL] is GoalState.CANCELING
        assert TRANSITIONS[state, GoalEvent.STOP] is GoalState.STOPPING
    for states, canceling in (
        (UNCONFIRMED_STATES, GoalState.CANCELING),
        (CONFIRMED_STATES, GoalState.CANCELING_CONFIRMED),
    ):
        assert all(
            TRANSITIONS[state, GoalEvent.CANCEL] is canceling for state in states - {canceling}
        )
        assert (canceling, GoalEvent.STOP) not in TRANSITIONS


def test_fault_ends_every_state_and_final_states_have_no_transition():
    assert reachable() == set(GoalState)
    for state, event in product(GoalState, GoalEvent):
        if state in FINAL_STATES:
            assert (state, event) not in TRANSITIONS
        elif event is GoalEvent.FAULT:
            assert TRANSITIONS[state, event] is GoalState.ABORTED


def test_arm_counts_as_at_rest_after_a_goal_only_if_rest_was_seen():
    """A fault ends a goal with an unknown state of the arm."""
    ends = {pair for pair, state in TRANSITIONS.items() if state in FINAL_STATES}
    faults = {pair for pair in ends if pair[1] is GoalEvent.FAULT}
    assert ends - set(AFTERMATH) == faults - {(GoalState.REJECTED_MIDWAY, GoalEvent.FAULT)}
    for (state, event), known in AFTERMATH.items():
        assert (state, event) in ends
        assert known.at_rest == (event in (GoalEvent.AT_REST, GoalEvent.AT_GOAL))
        assert known.unanswered <= known.broken_off
        if event is GoalEvent.AT_REST:
            assert known.broken_off is (state not in CONFIRMED_STATES)


# --- success ----------------------------------------------------------------------------------


def test_next_goal_may_start_as_soon_as_a_goal_has_succeeded():
    """The start of a goal is refused if the arm has just moved, whatever velocity is reported."""
    harness = Harness(step=0.1)
    harness.finish_points()
    waits = 0
    while not harness.outcomes:
        harness.now += DT
        harness.robot.on_joints(joint_data(harness.at.tolist()), harness.now, joint_data([]))
        harness.execution.on_state(harness.robot, harness.now)
        harness.status()
        waits += 1
        assert waits < 20
    assert harness.outcome.end is End.SUCCEEDED
    assert harness.robot.why_not_at_rest(GoalSettings().stopped_velocity) is None


def test_points_are_sent_singly_and_goal_succeeds_at_rest():
    """Each reply releases the next point. The goal succeeds when the arm is at rest at its end."""
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


def test_goal_does_not_succeed_before_last_reply():
    harness = Harness(step=0.1)
    harness.go_and_answer()
    harness.go_and_answer()
    harness.move_to(LINE[-1])
    harness.see(1.0)
    assert not harness.outcomes
    harness.answer()
    harness.see(0.3)
    assert harness.outcome.end is End.SUCCEEDED


def test_goal_does_not_succeed_with_status_older_than_last_reply():
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


@pytest.mark.parametrize('reported', [True, False], ids=['rest reported', 'not reported'])
def test_goal_ends_without_a_further_wait_when_rest_is_reported(reported):
    """A report from before the arm stood still does not end the goal earlier than none."""
    harness = Harness(step=0.1)
    harness.go_and_answer()
    harness.go_and_answer()
    harness.answer()  # taken: the arm moves afterwards
    harness.see(DT)
    harness.status(in_motion=TriState.FALSE)
    harness.move_to(LINE[-1])
    arrived = harness.now
    if reported:
        harness.status(in_motion=TriState.FALSE)
    while not harness.outcomes:
        harness.see(DT, status=False)
    still = harness.now - arrived
    assert (still < VELOCITY_WINDOW_S + 2 * DT) is reported
    assert harness.outcome.end is End.SUCCEEDED
    assert still < VELOCITY_WINDOW_S + REST_TIME_S + 2 * DT


@pytest.mark.invariant(5)
def test_inv5_arm_that_never_left_the_goal_must_rest_for_longer():
    """docs/invariants.md, 5: such an arm may not have started yet."""
    harness = Harness(((0.0, 0.0), (0.004, 0.0)), step=0.01)
    harness.answer()
    begin = harness.now
    harness.answer()
    while not harness.outcomes:
        harness.see(DT)
        harness.status(in_motion=TriState.FALSE)
    assert harness.now - begin >= REST_TIME_S


def test_goal_does_not_succeed_while_status_reports_motion():
    harness = Harness(step=0.1)
    harness.finish_points()
    harness.in_motion = TriState.TRUE
    harness.see(0.5)
    assert harness.state == 'settling'
    harness.in_motion = TriState.FALSE
    harness.see(0.2)
    assert harness.outcome.end is End.SUCCEEDED


@pytest.mark.parametrize('status', [True, False], ids=['UNKNOWN', 'no status at all'])
def test_goal_succeeds_by_measured_standstill_while_in_motion_is_unknown(status):
    harness = Harness(in_motion=TriState.UNKNOWN, step=0.1)
    if not status:
        harness.robot.status = None
    for point in LINE:
        harness.move_to(point)
        harness.answer()
    assert harness.state == 'settling'
    harness.see(UNREPORTED_REST_TIME_S - 2 * DT, status=status)
    assert harness.state == 'settling'
    harness.see(0.15, status=status)
    assert harness.outcome.end is End.SUCCEEDED


@pytest.mark.invariant(9)
def test_inv9_creeping_arm_is_not_at_the_goal():
    """docs/invariants.md, 9: slower than `stopped_velocity`, and in_motion is unknown."""
    harness = Harness(in_motion=TriState.UNKNOWN, step=0.1)
    harness.finish_points()
    harness.at = np.array((0.993, 0.5))
    harness.see(1.0, moving=0.005)
    assert not harness.outcomes
    harness.see(UNREPORTED_REST_TIME_S + 0.1)
    assert harness.outcome.end is End.SUCCEEDED


def at_the_last_point(seconds_after_the_joints):
    """Return a harness whose last reply came after the joints that showed the goal."""
    harness = Harness(in_motion=TriState.UNKNOWN, step=0.1)
    harness.go_and_answer()
    harness.go_and_answer()
    harness.move_to(LINE[-1])
    harness.see(0.1)
    harness.now += seconds_after_the_joints
    harness.answer()
    return harness


def test_joints_measured_before_the_last_reply_do_not_count_as_standstill():
    """At 10 Hz: a status arrives between the reply and the next joints."""
    harness = at_the_last_point(0.001)
    for _ in range(10):
        harness.now += 0.03
        harness.status()
        assert not harness.outcomes
    harness.joints()
    assert not harness.outcomes  # the first sample after the reply: the arm may be about to move
    for _ in range(7):  # a late sample may have been delayed in the network
        harness.now += 0.1
        harness.joints()
    assert harness.outcome.end is End.SUCCEEDED


@pytest.mark.parametrize('in_motion', [TriState.FALSE, TriState.UNKNOWN])
def test_closed_path_does_not_succeed_at_its_start(in_motion):
    """The controller acknowledges before it moves, so the arm is first at rest at the goal."""
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


def test_closed_path_fails_if_arm_never_moves():
    harness = Harness(CYCLE, step=0.1)
    for _ in CYCLE:
        harness.answer()
    harness.see(0.2 + SETTLE_TIME_S)  # the plan takes 0.2 s
    assert not harness.outcomes
    harness.see(0.1)
    assert harness.outcome.end is End.ABORTED
    assert harness.outcome.code is ErrorCode.GOAL_TOLERANCE_VIOLATED
    assert 'did not move' in harness.outcome.text


def test_goal_at_current_position_succeeds():
    harness = Harness(((0.2, 0.1), (0.2, 0.1)), step=0.1)
    harness.answer()
    harness.answer()
    harness.see(0.2)
    assert harness.outcome.end is End.SUCCEEDED


def test_rest_outside_tolerance_reports_joint_distance_and_tolerance():
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


# --- rejection --------------------------------------------------------------------------------


@pytest.mark.parametrize('index', [0, 1, 2])
def test_rejected_point_sends_stop_and_reports_controller_error(index):
    harness = Harness()
    for _ in range(index):
        harness.go_and_answer()
    harness.refuse()
    assert harness.sequences == [*range(index + 1), -4]
    assert not harness.outcomes  # the next status contains the cause
    harness.now += 0.03
    harness.status(error_code=4001)
    assert harness.outcome.end is End.ABORTED
    assert f'point {index} of 3' in harness.outcome.text
    assert 'FAILURE' in harness.outcome.text
    assert '4001' in harness.outcome.text
    assert not harness.execution.aftermath.at_rest
    harness.see(1.0)
    assert harness.sequences == [*range(index + 1), -4]


def test_status_older_than_rejection_is_not_its_cause():
    harness = Harness()
    harness.status(error_code=1234)
    harness.refuse()
    harness.see(CAUSE_TIMEOUT_S / 2, status=False)
    assert not harness.outcomes
    harness.see(CAUSE_TIMEOUT_S, status=False)
    assert harness.outcome.end is End.ABORTED
    assert '1234' not in harness.outcome.text
    assert 'FAILURE' in harness.outcome.text


def test_cause_of_rejection_is_awaited_while_arm_brakes():
    harness = Harness(in_motion=TriState.TRUE)
    harness.go_and_answer()
    harness.refuse()
    harness.in_motion = TriState.TRUE
    harness.pass_time(0.03)
    harness.status(drives_powered=TriState.FALSE)
    harness.see(1.0, status=False)
    assert not harness.outcomes
    harness.execution.fault('the motors are off')  # as the driver does for such a status
    assert 'FAILURE' in harness.outcome.text
    assert 'the motors are off' in harness.outcome.text


@pytest.mark.parametrize(('acknowledged', 'broken'), [(0, False), (1, True)])
def test_rejection_after_accepted_points_ends_goal(acknowledged, broken):
    harness = Harness()
    for _ in range(acknowledged):
        harness.go_and_answer()
    harness.refuse()
    harness.pass_time(0.03)
    harness.status(error_code=4001)
    assert harness.outcome.end is End.ABORTED
    assert harness.execution.aftermath.broken_off is broken
    assert not harness.execution.aftermath.unanswered


def test_cancel_stop_and_late_replies_do_not_change_rejection():
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
def test_withdrawn_acknowledgement_ends_goal(acknowledged):
    """FANUC replies SUCCESS, and later FAILURE for the same point."""
    harness = Harness()
    for _ in range(acknowledged):
        harness.answer()
    harness.execution.on_unsolicited_failure(harness.now)
    assert harness.stops == 1
    harness.now += 0.03
    harness.status()
    assert harness.outcome.end is End.ABORTED
    assert 'reported a failure' in harness.outcome.text


def test_reply_to_point_that_is_not_pending_is_ignored():
    harness = Harness()
    harness.answer()
    harness.refuse(message=0)  # a second reply to point 0
    harness.answer(message=0)
    assert harness.sequences == [0, 1]
    assert harness.state == 'streaming'


# --- timeouts ---------------------------------------------------------------------------------

PATIENT = GoalSettings(reply_timeout=2.0)


def test_missing_reply_ends_goal_after_reply_timeout():
    harness = Harness(settings=PATIENT)
    harness.go_and_answer()
    harness.see(2.9)  # patience and the planned duration of the point, 1 s
    assert not harness.outcomes
    harness.see(0.3)
    assert harness.outcome.end is End.ABORTED
    assert 'no reply to point 1 of 3' in harness.outcome.text
    assert harness.execution.aftermath == NO_REPLY
    assert harness.stops == 1


def test_reply_timeout_does_not_expire_while_arm_moves():
    harness = Harness(((0.0, 0.0), (1.0, 0.0)), settings=PATIENT)
    harness.answer()
    harness.see(20.0, moving=0.03)
    assert not harness.outcomes
    harness.see(2.9)
    assert not harness.outcomes
    harness.see(0.3)
    assert 'no reply' in harness.outcome.text


def test_encoder_noise_does_not_extend_reply_timeout():
    harness = Harness(settings=PATIENT)
    rest = harness.at
    for count in range(2000):
        harness.now += DT
        harness.joints(rest + 4e-5 * (-1) ** count)
    assert 'no reply to point 0' in harness.outcome.text


def test_unconfirmed_standstill_ends_goal_after_timeout():
    harness = Harness(settings=PATIENT)
    harness.finish_points()
    harness.in_motion = TriState.TRUE
    harness.see(2.0 + 2.0 - (harness.now - harness.execution.started))  # the plan takes 2 s, too
    assert not harness.outcomes
    harness.see(0.1)
    assert harness.outcome.end is End.ABORTED
    assert 'standstill' in harness.outcome.text


def test_goal_time_ends_late_goal():
    harness = Harness(goal_time=0.5)
    harness.see(2.4)
    assert not harness.outcomes
    harness.see(0.2)  # the plan takes 2 s
    assert harness.outcome.end is End.ABORTED
    assert harness.outcome.code is ErrorCode.GOAL_TOLERANCE_VIOLATED
    assert 'the plan takes 2 s' in harness.outcome.text
    assert '0.5 s' in harness.outcome.text
    assert harness.stops == 1


def test_slow_motion_is_no_failure_without_goal_time():
    harness = Harness()
    harness.see(100.0, moving=0.002)
    assert not harness.outcomes


# --- cancel, stop, fault ----------------------------------------------------------------------


def test_cancel_sends_stop_immediately_and_ends_at_rest():
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
    assert harness.execution.aftermath == AT_REST
    assert harness.sequences == [0, 1, -4]


def test_cancel_does_not_end_before_reply_to_stop():
    harness = Harness()
    harness.execution.cancel(harness.now)
    harness.see(1.0)
    assert not harness.outcomes
    harness.answer()
    harness.see(0.3)
    assert harness.outcome.end is End.CANCELED


def test_cancel_while_settling_ends_as_canceled():
    harness = Harness()
    for _ in LINE:
        harness.answer()
    harness.see(0.1, moving=1.0)
    harness.execution.cancel(harness.now)
    harness.answer()
    harness.see(0.3)
    assert harness.outcome.end is End.CANCELED


def test_stop_ends_as_aborted_with_its_first_reason():
    harness = Harness()
    harness.execution.stop('replaced by a new goal', harness.now)
    assert harness.sequences == [0, -4]
    harness.execution.stop('another reason', harness.now)
    harness.answer()
    harness.see(0.3)
    assert harness.outcome.end is End.ABORTED
    assert harness.outcome.text == 'replaced by a new goal, the arm is at rest'
    assert harness.stops == 1


def test_cancel_during_stop_ends_as_canceled_with_one_stop_message():
    harness = Harness()
    harness.execution.stop('replaced by a new goal', harness.now)
    harness.execution.cancel(harness.now)
    harness.answer()
    harness.see(0.3)
    assert harness.outcome.end is End.CANCELED
    assert harness.stops == 1


def test_refused_stop_ends_goal_immediately():
    harness = Harness()
    harness.execution.cancel(harness.now)
    harness.refuse()
    assert harness.outcome.end is End.ABORTED
    assert 'refused STOP' in harness.outcome.text
    assert not harness.execution.aftermath.at_rest


def test_unanswered_stop_ends_goal_after_reply_timeout():
    harness = Harness(settings=PATIENT)
    harness.go_and_answer()
    harness.execution.cancel(harness.now)
    harness.see(1.9)
    assert not harness.outcomes
    harness.see(0.3)
    assert harness.outcome.end is End.ABORTED
    assert 'standstill' in harness.outcome.text
    assert harness.execution.aftermath == NO_REPLY


def test_reply_after_cancel_releases_no_point():
    harness = Harness()
    harness.execution.cancel(harness.now)
    harness.answer(message=0)
    assert harness.sequences == [0, -4]
    assert harness.state == 'canceling'


def test_fault_ends_goal_immediately_and_sends_stop():
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


@pytest.mark.parametrize('sent', [0, 2])
def test_goal_ends_if_the_link_is_lost_when_a_point_is_sent(sent):
    harness = Harness(start=False)
    harness.broken = not sent
    harness.start()
    for _ in range(sent):
        harness.broken = len(harness.sequences) == sent
        harness.go_and_answer()
    assert harness.outcome.end is End.ABORTED
    text = f'point {sent} of 3 could not be sent: test link is backing_off'
    assert text in harness.outcome.text
    assert harness.sequences == list(range(sent))


@pytest.mark.parametrize('how', ['cancel', 'stop', 'fault', 'refuse'])
def test_goal_is_aborted_if_the_link_is_lost_when_stop_is_sent(how):
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


OUT_AND_BACK = [(0.1 * item, 0.0) for item in (0, 1, 2, 3, 4, 5, 6, 5, 4, 3, 2, 1, 0)]


def test_repeated_pause_and_resume_keep_the_remaining_points():
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


# --- preparation ------------------------------------------------------------------------------


def test_preparation_sends_nothing_and_has_no_timeout():
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


def test_prepared_trajectory_is_executed_instead_of_the_planned_one():
    harness = Harness(start=False)
    planned = replace(harness.goal.trajectory, times=np.array([0.0, 0.1, 0.2]))
    harness.start(planned)
    assert harness.execution.goal.trajectory is planned
    assert harness.execution.goal.goal_tolerance is harness.goal.goal_tolerance


@pytest.mark.parametrize(('how', 'end'), [('cancel', End.CANCELED), ('stop', End.ABORTED)])
def test_inv5_goal_stopped_during_preparation_ends_at_rest(how, end):
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


def test_inv5_fault_during_preparation_sends_nothing():
    """docs/invariants.md, 5."""
    harness = Harness(start=False)
    assert harness.execution.where == 'before its first point'
    harness.execution.fault('the E-stop is pressed')
    harness.start()
    harness.see(1.0)
    assert harness.outcome.text == 'the E-stop is pressed'
    assert not harness.sent


# --- decisions from the state alone -----------------------------------------------------------


def small_goal(way, **options):
    """Return a harness with all points acknowledged, at the end of the plan of 0.5 s."""
    harness = Harness(((0.0, 0.0), (way, 0.0)), in_motion=TriState.UNKNOWN, step=0.5, **options)
    harness.answer()
    harness.answer()
    harness.see(0.5)
    return harness


@pytest.mark.invariant(9)
def test_inv9_arm_still_at_start_within_tolerance_is_not_at_the_goal():
    """docs/invariants.md, 9: the start is within the tolerance, and the arm moves late."""
    harness = small_goal(0.009)
    harness.see(0.9)
    assert not harness.outcomes
    harness.move_to((0.009, 0.0), 0.1)
    assert not harness.outcomes
    harness.see(UNREPORTED_REST_TIME_S + 0.1)
    assert harness.outcome.end is End.SUCCEEDED


@pytest.mark.invariant(9)
@pytest.mark.parametrize(('goal_time', 'ends'), [(0.0, SETTLE_TIME_S), (0.3, 0.3)])
def test_inv9_small_motion_fails_in_time_if_arm_never_moves(goal_time, ends):
    """docs/invariants.md, 9."""
    harness = small_goal(0.009, goal_time=goal_time)
    harness.see(ends - 0.05)
    assert not harness.outcomes
    harness.see(0.1)
    assert harness.outcome.code is ErrorCode.GOAL_TOLERANCE_VIOLATED


def test_path_below_min_displacement_succeeds_without_measured_motion():
    harness = small_goal(0.5e-3, goal_time=0.3)
    harness.see(0.05)
    assert harness.outcome.end is End.SUCCEEDED


@pytest.mark.invariant(9)
def test_inv9_planned_rest_at_goal_position_is_no_success():
    """docs/invariants.md, 9: the plan passes its end, waits there, and returns to it."""
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
def test_inv9_goal_needs_a_standstill_if_stop_may_have_no_reply():
    """docs/invariants.md, 9: the reply to the point, or to STOP, never arrives."""
    harness = Harness()
    harness.go_and_answer()
    harness.execution.cancel(harness.now)
    harness.answer(message=1)  # the reply to the point, or to STOP instead
    harness.see(1.0, moving=0.1)
    assert not harness.outcomes
    harness.see(UNCONFIRMED_REST_TIME_S - 0.2)
    assert not harness.outcomes
    harness.see(0.5)
    assert harness.outcome.end is End.CANCELED
    assert 'a reply is missing' in harness.outcome.text
    assert harness.execution.aftermath.broken_off
    assert harness.execution.aftermath.unanswered


def test_point_reply_does_not_delay_acknowledged_stop():
    harness = Harness()
    harness.go_and_answer()
    harness.execution.cancel(harness.now)
    harness.answer(message=1)
    harness.see(0.02)
    harness.answer()
    harness.see(0.2)
    assert harness.outcome.end is End.CANCELED
    assert harness.outcome.text == 'canceled, the arm is at rest'
    assert not harness.execution.aftermath.broken_off
