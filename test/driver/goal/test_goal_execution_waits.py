# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Path tolerances, pauses, speed scaling and scheduling delays, and the checks of the queue."""

import numpy as np
import pytest
from support.driver_harness import HOME, JOINTS, LIMITS, Submitted, cell, pose
from support.goal_execution_harness import DT, LINE, Harness

from epson_driver.driver.goal.goal import Goal, GoalSettings, Tolerances
from epson_driver.driver.goal.goal_execution import SETTLE_TIME_S
from epson_driver.driver.outcome import End, ErrorCode
from epson_driver.motion import Trajectory
from epson_driver.simple_message import TriState

PATIENT = GoalSettings(reply_timeout=2.0)
INF = np.inf


def tolerance(position=(INF, INF), velocity=(INF, INF)):
    return Tolerances(np.array(position), np.array(velocity))


def on_plan(harness):
    """Return the plan's time and positions, shape (n,), rad."""
    time, positions, _ = harness.execution.desired
    return time, positions


def follow(harness, seconds, *, offset=(0.0, 0.0)):
    """Advance time with the arm at an offset from the plan, rad."""
    for _ in range(round(seconds / DT)):
        harness.now += DT
        _, positions = on_plan(harness)
        harness.joints(positions + offset)


# --- path tolerance ---------------------------------------------------------------------------


def test_arm_within_path_tolerance_succeeds():
    harness = Harness(path_tolerance=tolerance((0.05, 0.05)))
    for _ in LINE:
        harness.answer()
    follow(harness, 1.9, offset=(0.04, -0.04))
    assert harness.state == 'settling'
    harness.move_to(LINE[-1])
    harness.see(0.3)
    assert harness.outcome.end is End.SUCCEEDED


@pytest.mark.parametrize('handled_after', [0.0, 1e-4])
def test_path_tolerance_violation_stops_arm_and_names_joint(handled_after):
    harness = Harness(path_tolerance=tolerance((INF, 0.05)))
    harness.handled_after = handled_after
    harness.answer()
    follow(harness, 0.3, offset=(0.5, 0.0))
    assert harness.stops == 0
    harness.now += DT
    harness.joints(on_plan(harness)[1] + (0.5, 0.1))
    assert harness.stops == 1
    assert not harness.outcomes  # not before rest
    harness.answer()
    harness.see(0.3)
    assert harness.outcome.end is End.ABORTED
    assert harness.outcome.code is ErrorCode.PATH_TOLERANCE_VIOLATED
    assert 'moving to point 1' in harness.outcome.text
    assert 'joint_2: the position error is 0.09' in harness.outcome.text
    assert 'the tolerance is 0.05 rad' in harness.outcome.text
    assert harness.execution.aftermath.at_rest
    assert harness.stops == 1


def test_velocity_tolerance_violation_stops_arm():
    harness = Harness(path_tolerance=tolerance(velocity=(0.6, INF)))
    harness.answer()
    follow(harness, 0.3)
    assert harness.stops == 0
    harness.see(0.3, moving=0.0)  # at rest instead of 0.5 rad/s: still allowed
    assert harness.stops == 0
    harness.see(0.1, moving=-0.3)
    assert harness.stops == 1
    harness.answer()
    harness.see(0.3)
    assert 'joint_1: the velocity error is' in harness.outcome.text


def test_rest_at_a_point_violates_path_tolerance():
    harness = Harness(path_tolerance=tolerance((0.2, 0.2)))
    harness.go_and_answer()
    harness.see(0.7)  # the plan continues
    assert harness.stops == 1


def test_path_tolerance_is_not_checked_after_the_end_of_the_plan():
    harness = Harness(path_tolerance=tolerance((0.6, 0.6)))
    for _ in LINE:
        harness.answer()
    follow(harness, 1.5)
    harness.at = np.array([0.5, 0.25])
    harness.in_motion = TriState.TRUE
    harness.see(1.0)
    assert harness.state == 'settling'
    harness.move_to((5.0, 5.0))
    assert harness.stops == 0


def test_status_between_joint_samples_does_not_check_the_path_again():
    harness = Harness(path_tolerance=tolerance((0.05, 0.05)))
    harness.answer()
    follow(harness, 0.3)
    harness.now += 0.3  # the plan is 0.15 rad further
    harness.status()
    assert harness.stops == 0
    harness.joints(harness.execution.desired[1])
    assert harness.stops == 0


def test_path_violation_is_reported_even_if_its_stop_fails():
    harness = Harness(path_tolerance=tolerance((0.05, 0.05)), settings=PATIENT)
    harness.answer()
    follow(harness, 0.1, offset=(0.3, 0.0))
    harness.see(3.0)
    assert harness.outcome.code is ErrorCode.PATH_TOLERANCE_VIOLATED
    assert 'joint_1' in harness.outcome.text
    assert 'standstill' in harness.outcome.text


def test_goal_velocity_lowers_the_standstill_velocity_of_its_joint():
    harness = Harness(goal_velocity=np.array([0.001, INF]), in_motion=TriState.UNKNOWN, step=0.1)
    harness.finish_points()
    harness.at = np.array([0.995, 0.5])
    harness.see(0.5, moving=0.005)  # below what holds for all joints
    assert harness.state == 'settling'
    harness.see(0.3)
    assert harness.outcome.end is End.SUCCEEDED


# --- the controller is paused -----------------------------------------------------------------


def status(harness, possible, in_motion=TriState.FALSE, **fields):
    harness.now += DT
    harness.in_motion = in_motion
    harness.status(motion_possible=possible, **fields)


def pause(harness):
    status(harness, TriState.FALSE, TriState.TRUE)
    status(harness, TriState.FALSE)


def stand(harness, seconds):
    """Advance time with the arm at rest, without a status."""
    harness.see(seconds, status=False)


@pytest.mark.parametrize('acknowledged', [1, 3], ids=['while streaming', 'while settling'])
def test_paused_controller_stops_clock_and_timeouts(acknowledged):
    harness = Harness(settings=PATIENT, goal_time=0.5, path_tolerance=tolerance((0.05, 0.05)))
    status(harness, TriState.TRUE)
    for _ in range(acknowledged):
        harness.answer()
    follow(harness, 0.5)
    pause(harness)
    assert harness.execution.paused
    assert harness.execution.speed(harness.now) == 0.0
    before = harness.execution.desired[0]
    stand(harness, 60.0)
    time, _, velocities = harness.execution.desired
    assert time == before
    assert velocities.tolist() == [0.0, 0.0]
    assert not harness.outcomes
    status(harness, TriState.TRUE)
    assert not harness.execution.paused
    while harness.state == 'streaming':
        follow(harness, 0.5)
        harness.answer()
    follow(harness, 2.0 - harness.execution.desired[0])
    harness.move_to(LINE[-1])
    status(harness, TriState.TRUE)
    harness.see(0.3)
    assert harness.outcome.end is End.SUCCEEDED, harness.outcome.text


def test_goal_does_not_succeed_while_controller_is_paused():
    harness = Harness(step=0.1)
    status(harness, TriState.TRUE)
    harness.finish_points()
    pause(harness)
    stand(harness, 1.0)
    assert not harness.outcomes
    status(harness, TriState.TRUE)
    stand(harness, 0.3)
    assert harness.outcome.end is End.SUCCEEDED


def test_timeouts_apply_again_after_a_pause():
    harness = Harness(settings=PATIENT, step=0.25)
    status(harness, TriState.TRUE)
    for _ in LINE:
        harness.answer()
    follow(harness, 0.125)
    pause(harness)
    stand(harness, 10.0)
    status(harness, TriState.TRUE)
    stand(harness, 0.375 + SETTLE_TIME_S - 0.1)  # and the rest of the plan
    assert not harness.outcomes
    stand(harness, 0.3)
    assert harness.outcome.code is ErrorCode.GOAL_TOLERANCE_VIOLATED


def test_cancel_while_controller_is_paused_ends_as_canceled():
    harness = Harness()
    status(harness, TriState.TRUE)
    harness.answer()
    pause(harness)
    harness.execution.cancel(harness.now)
    assert harness.sequences[-1] == -4
    harness.answer()
    status(harness, TriState.FALSE)
    stand(harness, 0.3)
    assert harness.outcome.end is End.CANCELED


@pytest.mark.parametrize('before', [TriState.UNKNOWN, TriState.FALSE])
def test_controller_that_never_reports_motion_possible_is_not_paused(before):
    harness = Harness(settings=PATIENT)
    status(harness, before)
    harness.answer()
    status(harness, TriState.FALSE)
    assert not harness.execution.paused
    stand(harness, 3.2)
    assert 'no reply' in harness.outcome.text


@pytest.mark.parametrize(
    'fields', [{'in_error': TriState.TRUE}, {'error_code': 4001}], ids=['in error', 'number']
)
def test_controller_error_is_no_pause(fields):
    harness = Harness(settings=PATIENT)
    status(harness, TriState.TRUE)
    harness.answer()
    status(harness, TriState.FALSE, **fields)
    assert not harness.execution.paused


# --- speed scaling ----------------------------------------------------------------------------


def test_speed_scaling_slows_unsent_points_and_the_clock():
    harness = Harness(path_tolerance=tolerance((0.05, 0.05)), goal_time=0.1)
    harness.answer()
    assert [point.duration for point in harness.sent] == [1.0, 1.0]
    harness.scaling.set(0.5, harness.now)
    follow(harness, 1.0)  # sent points keep their speed
    assert harness.execution.desired[0] == pytest.approx(1.0)
    harness.answer()
    assert harness.sent[-1].duration == pytest.approx(2.0)
    assert harness.sent[-1].velocity == pytest.approx(0.25)
    harness.answer()
    follow(harness, 1.0)
    assert harness.execution.desired[0] == pytest.approx(1.5)
    follow(harness, 1.0)
    harness.see(0.3)
    assert harness.outcome.end is End.SUCCEEDED


def test_reply_timeout_includes_scaled_duration_of_the_point():
    harness = Harness(settings=PATIENT)
    harness.scaling.set(0.1, harness.now - 10.0)
    harness.answer()
    stand(harness, 11.5)
    assert not harness.outcomes
    stand(harness, 0.8)
    assert 'no reply' in harness.outcome.text


def test_reply_timeout_includes_planned_rest_before_the_point():
    """A controller that looks ahead replies to the next point when it continues."""
    harness = Harness(((0.0, 0.0), (0.0, 0.0), (0.5, 0.25)), settings=PATIENT, step=10.0)
    harness.answer()
    harness.answer()
    stand(harness, 21.8)
    assert not harness.outcomes
    stand(harness, 0.4)
    assert 'no reply to point 2' in harness.outcome.text


@pytest.mark.invariant(9)
def test_unscheduled_time_does_not_count_toward_reply_timeout():
    """docs/invariants.md, 9: the reply arrived in that time, and is read after the state."""
    harness = Harness(settings=PATIENT)
    harness.go_and_answer()
    harness.pass_time(60.0)
    stand(harness, DT)
    assert not harness.outcomes
    harness.answer()
    assert harness.sequences[-1] == 2
    stand(harness, 4.0)
    assert 'no reply' in harness.outcome.text


def stall(harness, seconds, *, along=on_plan, status=None):
    """Suspend the process, and read the states of that time at its end, one after the other.

    `along` returns the position of the arm, `status` the fields of the STATUS after every tenth.
    """
    measured = []
    for _ in range(round(seconds / DT)):
        harness.now += DT
        measured.append(along(harness))
    for count, position in enumerate(measured):
        harness.joints(position)
        if status is not None and count % 11 == 10:
            harness.status(**status)


@pytest.mark.invariant(9)
def test_delayed_joints_are_compared_with_the_plan_at_their_measurement():
    """docs/invariants.md, 9: the arm was on its path while the process was not scheduled."""
    harness = Harness(path_tolerance=tolerance((0.03, 0.03)))
    harness.answer()
    follow(harness, 0.4)
    began = harness.now - harness.execution.desired[0]

    def on_its_path(harness):
        return np.array([0.5, 0.25]) * (harness.now - began)

    stall(harness, 0.4, along=on_its_path)
    assert not harness.outcomes
    assert harness.state == 'streaming'
    assert harness.stops == 0


@pytest.mark.invariant(9)
def test_arrival_during_unscheduled_time_is_not_late():
    """docs/invariants.md, 9."""
    harness = Harness(goal_time=0.5)
    harness.answer()
    follow(harness, 1.0)
    harness.answer()
    harness.answer()
    began = harness.now - 1.0

    def on_its_path(harness):
        return np.minimum(np.array([0.5, 0.25]) * (harness.now - began), LINE[-1])

    follow(harness, 0.5)
    stall(harness, 1.5, along=on_its_path, status={'in_motion': TriState.FALSE})
    harness.see(0.2)
    assert harness.outcome.end is End.SUCCEEDED, harness.outcome.text


@pytest.mark.invariant(9)
def test_cause_of_a_rejection_is_found_in_a_status_that_is_read_late():
    """docs/invariants.md, 9: it arrived in time, and is read after joints that arrived with it."""
    harness = Harness()
    harness.refuse()
    stand(harness, DT)
    stall(harness, 0.4, along=lambda harness: harness.at, status={'error_code': 4001})
    assert 'controller error 4001' in harness.outcome.text


@pytest.mark.parametrize(
    ('status', 'text', 'unexplained'),
    [
        (None, 'no status shows the cause', True),
        ({}, 'it reports no error', True),
        ({'error_code': 4001}, 'controller error 4001', False),
    ],
    ids=['none', 'no error', 'error'],
)
def test_rejection_reports_whether_its_cause_is_known(status, text, unexplained):
    """A later status may still explain an unexplained rejection (ArmGate.close)."""
    harness = Harness()
    harness.refuse()
    harness.now += DT
    if status is not None:
        harness.status(**status)
    for _ in range(20):
        harness.now += DT
        harness.joints()
    assert text in harness.outcome.text
    assert harness.outcome.unexplained is unexplained


@pytest.mark.invariant(9)
def test_unscheduled_time_does_not_count_toward_start_of_motion():
    """docs/invariants.md, 9: as after a download, during whose dead time the arm is at rest."""
    harness = Harness(start=False)
    harness.start(delay=3.0)
    for _ in LINE:
        harness.answer()
    assert harness.state == 'settling'
    stand(harness, 2.9)
    stall(harness, 6.0, along=lambda harness: harness.at, status={})
    harness.see(0.3)
    assert not harness.outcomes
    harness.see(SETTLE_TIME_S)
    assert 'the arm is at rest' in harness.outcome.text


TIMES = np.array([0.0, 1.0])

WAY = np.array([HOME, pose(0.2)])

TOLERANCE = np.full(JOINTS, 0.01)

LAST_VELOCITY = np.array([HOME, pose(0.2)])


def goal(times=TIMES, positions=WAY, names=LIMITS.names, tolerance=TOLERANCE, **rest):
    return Goal(
        Trajectory(names, times, positions, rest.pop('velocities', None)),
        tolerance,
        goal_time=0.0,
        **rest,
    )


BAD = {
    '45 rad': (goal(positions=np.array([HOME, pose(45.0)])), 'look like degrees'),
    'outside': (goal(positions=np.array([HOME, pose(4.0)])), 'position 4 rad is outside'),
    'not finite': (goal(positions=np.array([HOME, pose(np.nan)])), 'is not finite'),
    'no points': (goal(times=np.zeros(0), positions=np.zeros((0, JOINTS))), 'has no points'),
    'times': (goal(times=np.array([0.0, 0.0])), 'times must strictly increase'),
    'too fast': (goal(times=np.array([0.0, 1e-3])), 'rad/s would be needed'),
    'ends moving': (goal(velocities=LAST_VELOCITY), 'must be 0'),
    'start': (goal(positions=np.array([pose(0.3), pose(0.4)])), 'the trajectory starts at 0.3'),
    'names': (goal(names=LIMITS.names[::-1]), 'in its order, are joint_1'),
    'shape': (goal(positions=WAY[:, :4]), r'positions has the shape \(2, 4\), not \(2, 6\)'),
    'tolerance': (goal(tolerance=TOLERANCE[:1]), r'goal_tolerance has the shape \(1,\)'),
    'velocities': (goal(velocities=WAY[:1]), r'velocities has the shape \(1, 6\), not \(2, 6\)'),
}


@pytest.mark.invariant(2)
async def test_inv2_invalid_goal_is_rejected_and_nothing_moves():
    async with cell() as (harness, controller):
        before = controller.joint_position().joints
        for name, (bad, words) in BAD.items():
            submitted = Submitted(bad)
            harness.driver.goal_queue.submit(submitted.handle)
            outcome = await submitted.end()
            assert outcome.end is End.ABORTED, name
            expected = (
                ErrorCode.INVALID_JOINTS
                if name in ('names', 'shape', 'tolerance', 'velocities')
                else ErrorCode.INVALID_GOAL
            )
            assert outcome.code is expected, name
            with pytest.raises(AssertionError, match=words):
                raise AssertionError(outcome.text)
        assert controller.joint_position().joints == before
        assert harness.gate is None


@pytest.mark.invariant(2)
async def test_inv2_invalid_goal_does_not_replace_running_goal():
    async with cell() as (harness, _):
        running = harness.submit(pose(0.3))
        await harness.until_moving()
        bad = Submitted(BAD['45 rad'][0])
        harness.driver.goal_queue.submit(bad.handle)
        assert 'look like degrees' in bad.outcome.text
        assert (await running.end()).end is End.SUCCEEDED
