# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Effects of a controller's profile on the motion program: replies, checks, pauses."""

import numpy as np
import pytest
from support.examples import one_in
from support.program_harness import (
    FAILURE,
    HOME,
    LIMITS,
    OUTSIDE,
    SUCCESS,
    THERE,
    TOPIC,
    ProgramHarness,
    frame,
    point,
    rounded,
)

STOP = -4


# ---- when a point is answered


@pytest.mark.parametrize(('acknowledge', 'at_once'), [('default', False), ('taken', True)])
def test_profile_selects_when_a_point_is_answered(acknowledge, at_once):
    harness = ProgramHarness(acknowledge=acknowledge)
    harness.send(point(0, THERE))
    assert harness.arm.moving
    assert harness.codes() == ([(0, SUCCESS)] if at_once else [])
    harness.rest()
    assert harness.codes() == ([] if at_once else [(0, SUCCESS)])


def test_points_lost_after_an_early_acknowledgement_may_not_be_skipped():
    harness = ProgramHarness(acknowledge='taken')
    harness.send(point(0, THERE), point(1, HOME))
    harness.step(0.1)
    harness.codes()
    harness.send(point(9))  # refused: the motion ends
    harness.codes()
    harness.rest()
    harness.send(point(2, THERE))
    assert harness.codes() == [(2, FAILURE)]
    harness.send(point(0, THERE))
    assert harness.codes() == [(0, SUCCESS)]


# ---- the sequence


def test_unchecked_sequences_are_accepted_unless_negative():
    harness = ProgramHarness(check_sequence=False)
    harness.send(*(point(sequence) for sequence in (5, 5, 0, 2**31 - 1, 3)))
    assert harness.codes() == [(s, SUCCESS) for s in (5, 5, 0, 2**31 - 1, 3)]
    harness.send(point(-9))
    assert harness.codes() == [(-9, FAILURE)]


def test_start_streaming_must_be_a_valid_request():
    harness = ProgramHarness()
    harness.send(point(-2, THERE, TOPIC), point(-2, OUTSIDE))
    assert harness.codes() == [(-2, FAILURE)]  # the topic gets no reply
    assert not harness.arm.moving


def test_start_of_a_trajectory_is_reported_before_its_first_point():
    harness = ProgramHarness()
    harness.send(point(0, THERE), point(1, HOME), point(0, THERE))
    assert harness.events == ['began', 0]
    harness.rest()
    assert harness.events == ['began', 0, 1, 'began', 0]


def test_restart_while_the_arm_takes_a_point_fails_the_other_points():
    harness = ProgramHarness()
    taken = []
    take = harness.arm.take

    def restart_at_1(point):
        taken.append(point.sequence)
        take(point)
        if point.sequence == 1:
            harness.program.restart()

    harness.arm.take = restart_at_1
    harness.send(point(0), point(1, THERE), point(2, HOME))
    harness.rest()
    assert taken == [0, 1]
    assert harness.codes() == [(0, SUCCESS), (1, FAILURE), (2, FAILURE)]


# ---- limits


@pytest.mark.invariant(2)
def test_inv2_unchecked_point_outside_the_limits_ends_the_motion_late():
    harness = ProgramHarness(check_limits=False)
    harness.send(point(0, THERE), point(1, OUTSIDE), point(2, HOME))
    assert harness.error == 0
    furthest = 0.0
    while harness.arm.moving:
        harness.step(0.004)
        furthest = max(furthest, harness.joints[0])
    assert furthest == pytest.approx(0.5)
    assert harness.joints == rounded(THERE)
    assert harness.error == 4001
    assert harness.codes() == [(0, SUCCESS), (1, FAILURE), (2, FAILURE)]
    harness.send(point(1, HOME))  # the refused one again, inside
    harness.rest()
    assert harness.codes() == [(1, SUCCESS)]
    assert harness.error == 0


def test_late_failure_follows_the_success_and_disconnects():
    harness = ProgramHarness(acknowledge='taken', late_failure=True)
    harness.send(point(0, THERE))
    harness.rest()
    harness.codes()
    harness.send(point(1, OUTSIDE))
    assert harness.codes() == [(1, SUCCESS), (1, FAILURE)]
    assert harness.events[-1] == 'hung up'
    assert harness.error == 4001
    harness.step(1.0)
    assert harness.joints == rounded(THERE)


@pytest.mark.invariant(2)
def test_inv2_points_before_a_late_failure_are_executed():
    harness = ProgramHarness(acknowledge='taken', late_failure=True)
    harness.arm.hold()  # all points wait
    harness.send(point(0, THERE), point(1, HOME), point(2, OUTSIDE), point(3, THERE))
    assert harness.codes() == [(0, SUCCESS), (1, SUCCESS)]
    harness.arm.resume()
    harness.rest()
    assert harness.codes() == [(2, SUCCESS), (2, FAILURE)]
    assert harness.events == ['began', 0, 1, 'hung up']
    assert harness.error == 4001
    assert harness.joints == list(HOME)


# ---- form of a point


def test_profile_may_accept_a_point_with_a_longer_body():
    body = point(0, THERE)[16:]
    harness = ProgramHarness(accepts='longer')
    harness.send(frame(11, 2, 0, body + bytes(8)), frame(11, 2, 0, body[:-1]))
    assert harness.codes() == [(0, FAILURE), (0, FAILURE)]  # the second one ends the motion
    harness.send(frame(11, 2, 0, body + bytes(8)))
    harness.rest()
    assert harness.codes() == [(0, SUCCESS)]
    assert harness.joints == rounded(THERE)


@pytest.mark.parametrize('header', [(11, 1, 0), (10, 2, 0), (13, 3, 2), (1, 9, 9), (-5, 0, 0)])
def test_profile_may_treat_any_long_message_as_a_point(header):
    harness = ProgramHarness('fanuc')
    harness.send(frame(*header, point(0, THERE)[16:60]))  # without velocity and duration
    assert harness.codes() == [(0, SUCCESS)]
    harness.rest()
    assert harness.joints == rounded(THERE)


@pytest.mark.parametrize('short', [frame(1), frame(11, 2, 0, bytes(43)), frame(2)])
def test_fanuc_ignores_short_messages(short):
    harness = ProgramHarness('fanuc')
    harness.send(short)
    assert harness.take_sent() == b''
    assert harness.error == 0


@pytest.mark.parametrize('sequence', [-1, -2, -3, -5, -(2**31)])
def test_fanuc_ignores_negative_sequences_except_stop(sequence):
    harness = ProgramHarness('fanuc')
    harness.send(point(0, THERE), point(sequence, HOME), point(sequence, HOME, TOPIC))
    assert harness.codes() == [(0, SUCCESS)]
    harness.rest()
    assert harness.joints == rounded(THERE)
    harness.send(point(STOP))
    assert harness.codes() == [(STOP, SUCCESS)]


# ---- skipped first points


NEAR = tuple(np.radians([0.09, -0.09, 0.0, 0.0, 0.05, 0.0]))


def test_abb_skips_a_first_point_at_the_current_position():
    harness = ProgramHarness('abb')
    harness.send(point(-1, NEAR, TOPIC), point(1, THERE, TOPIC), point(-3, HOME, TOPIC))
    harness.rest()
    assert harness.events == ['began', 1, 2]
    harness.send(point(-1, THERE, TOPIC), point(-3, HOME, TOPIC))
    harness.rest()
    assert harness.events[3:] == ['began', 0, 1]  # not near


def test_points_are_skipped_only_at_the_start_and_with_skip_first():
    harness = ProgramHarness('abb')
    harness.send(point(-1, THERE, TOPIC), point(1, THERE, TOPIC), point(-3, THERE, TOPIC))
    harness.rest()
    assert harness.events == ['began', 0, 1, 2]
    other = ProgramHarness()
    other.send(point(0, NEAR), point(1, THERE))
    other.rest()
    assert other.events == ['began', 0, 1]


def test_abb_executes_a_full_buffer_whose_last_point_is_lost():
    harness = ProgramHarness('abb')
    points = [point(-1, THERE, TOPIC)]
    points += [point(i, [0.5 - 0.001 * i, *THERE[1:]], TOPIC) for i in range(1, 100)]
    harness.send(*points, point(-3, HOME, TOPIC))
    harness.rest()
    assert len(harness.events) == 101  # including 'began'
    assert harness.joints == rounded([0.5 - 0.099, *THERE[1:]])


def test_abb_answers_a_point_outside_the_limits_with_success():
    harness = ProgramHarness('abb')
    harness.send(point(-1, THERE), point(1, OUTSIDE), point(-3, HOME))
    data = harness.take_sent()
    assert data == frame(11, 3, SUCCESS) * 3
    harness.rest()
    assert harness.error == 4001
    assert harness.joints == rounded(THERE)


# ---- velocity and duration


@pytest.mark.parametrize(
    ('uses', 'slower'),
    [('both', True), ('velocity', True), ('duration', False), ('nothing', False)],
)
def test_only_the_fields_that_a_profile_uses_change_the_motion(uses, slower):
    fast, slow = ProgramHarness(uses=uses), ProgramHarness(uses=uses)
    fast.send(point(0, THERE))
    slow.send(point(0, THERE, velocity=0.1))
    assert (slow.rest() > 2.0 * fast.rest()) is slower


# ---- the pause


def test_points_in_a_pause_are_executed_afterwards():
    harness = ProgramHarness()
    harness.send(point(0, THERE))
    harness.step(0.1)
    harness.pause()
    harness.send(point(1, HOME), point(2, THERE))
    harness.step(5.0)
    assert harness.codes() == []
    assert 0.0 < harness.joints[0] < 0.5
    assert harness.program.queue.paused
    harness.resume()
    assert not harness.program.queue.paused
    harness.rest()
    assert harness.codes() == [(0, SUCCESS), (1, SUCCESS), (2, SUCCESS)]
    assert harness.joints == rounded(THERE)


# ---- random messages


@pytest.mark.invariant(2, 7)
@pytest.mark.parametrize('name', one_in(2, ['simulated', 'fanuc', 'abb', 'generic']))
def test_inv2_and_7_random_messages_stay_within_limits(name):
    random = np.random.default_rng(7)
    harness = ProgramHarness(name, pending_limit=20)
    sequences = [-5, -4, -3, -2, -1, 0, 1, 2, 3]
    for _ in range(1500):
        joints = random.uniform(-1.0, 1.0, 6) * random.choice([0.1, 1.0, 4.0], p=[0.6, 0.35, 0.05])
        data = point(int(random.choice(sequences)), joints, int(random.choice([1, 2, 2, 3])))
        if random.random() < 0.02:
            data = frame(*(int(word) for word in random.integers(0, 15, 3)), bytes(52))
        action = random.random()
        if action < 0.02:
            (harness.resume if harness.program.queue.paused else harness.pause)()
        elif action < 0.03:
            harness.program.abort()
        harness.send(data)
        harness.step(float(random.choice([0.0, 0.004, 0.3])), 0.02)
        assert (harness.arm.position >= LIMITS.position_min).all()
        assert (harness.arm.position <= LIMITS.position_max).all()
        assert len(harness.program.queue) <= max(20, harness.profile.download.buffer) + 1
    harness.resume()
    harness.send(point(STOP))
    harness.rest()
    harness.take_sent()
    harness.send(point(0, THERE))
    harness.rest()
    assert harness.joints == rounded(THERE)
    assert harness.take_sent()[12] == SUCCESS
