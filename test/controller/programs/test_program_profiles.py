# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What a controller's profile changes in the motion program: replies, checks, STOP, pauses."""

import math

import numpy as np
import pytest
from program_bench import (
    FAILURE,
    HOME,
    LIMITS,
    OUTSIDE,
    SUCCESS,
    THERE,
    TOPIC,
    ProgramBench,
    frame,
    point,
    rounded,
)

from epson_driver.controller.errors import ErrorNumber, Refusal
from epson_driver.controller.programs.program import ProgramQuit

STOP = -4
NAN = math.nan


# ---- the form of replies


@pytest.mark.parametrize(
    ('form', 'expected'),
    [
        ('sequence', '38000000 0a000000 03000000 01000000 01000000' + '00' * 40),
        ('zero', '38000000 0a000000 03000000 01000000 00000000' + '00' * 40),
        ('header', '0c000000 0b000000 03000000 01000000'),
    ],
)
def test_the_form_of_a_reply_byte_by_byte(form, expected):
    bench = ProgramBench(reply=form)
    bench.send(point(0))
    bench.take_sent()
    bench.send(point(1))
    assert bench.take_sent() == bytes.fromhex(expected)


@pytest.mark.parametrize(('form', 'length'), [('sequence', 60), ('zero', 60), ('header', 16)])
def test_a_stop_and_a_refusal_are_answered_in_the_same_form(form, length):
    bench = ProgramBench(reply=form)
    bench.send(point(STOP))
    assert len(bench.take_sent()) == length
    bench.send(point(7))
    data = bench.take_sent()
    assert (len(data), data[12]) == (length, FAILURE)


def test_without_failure_replies_everything_is_answered_with_success():
    bench = ProgramBench(failure_replies=False)
    for bad in (point(0, OUTSIDE), point(5), point(0, (NAN,)), frame(11), point(-9)):
        bench.send(bad)
        assert [code for _, code in bench.codes()] == [SUCCESS]
        assert bench.error in (4001, 8000)
        assert not bench.arm.moving
    bench.send(frame(999))
    assert bench.take_sent() == frame(999, 3, SUCCESS)
    bench.send(point(0, THERE), point(1, HOME))
    bench.step(0.1)
    bench.program.abort()
    assert bench.codes() == [(0, SUCCESS), (1, SUCCESS)]
    bench.rest()
    assert bench.joints != rounded(THERE)


# ---- when a point is answered


@pytest.mark.parametrize(
    ('acknowledge', 'at_once'), [('default', False), ('done', False), ('taken', True)]
)
def test_a_point_is_answered_when_the_profile_says(acknowledge, at_once):
    bench = ProgramBench(acknowledge=acknowledge)
    bench.send(point(0, THERE))
    assert bench.arm.moving
    assert bench.codes() == ([(0, SUCCESS)] if at_once else [])
    bench.rest()
    assert bench.codes() == ([] if at_once else [(0, SUCCESS)])


def test_points_answered_early_and_lost_by_a_stop_are_not_skipped():
    bench = ProgramBench(acknowledge='taken')
    bench.send(point(0, THERE), point(1, HOME))
    bench.step(0.1)
    bench.codes()
    bench.send(point(9))  # refused: the motion ends
    bench.codes()
    bench.rest()
    bench.send(point(2, THERE))
    assert bench.codes() == [(2, FAILURE)]
    bench.send(point(0, THERE))
    assert bench.codes() == [(0, SUCCESS)]


# ---- the sequence


def test_without_a_check_every_sequence_that_is_not_negative_is_taken():
    bench = ProgramBench(check_sequence=False)
    bench.send(*(point(sequence) for sequence in (5, 5, 0, 2**31 - 1, 3)))
    assert bench.codes() == [(s, SUCCESS) for s in (5, 5, 0, 2**31 - 1, 3)]
    bench.send(point(-9))
    assert bench.codes() == [(-9, FAILURE)]


def test_start_streaming_is_the_first_point_of_a_trajectory():
    bench = ProgramBench()
    bench.send(point(-2, THERE), point(1, HOME))
    bench.rest()
    assert bench.codes() == [(-2, SUCCESS), (1, SUCCESS)]
    assert bench.events == ['began', 0, 1]


def test_start_streaming_is_a_request_and_is_checked():
    bench = ProgramBench()
    bench.send(point(-2, THERE, TOPIC), point(-2, OUTSIDE))
    assert bench.codes() == [(-2, FAILURE), (-2, FAILURE)]
    assert not bench.arm.moving


def test_the_beginning_of_each_trajectory_is_told_before_its_first_point_is_taken():
    bench = ProgramBench()
    bench.send(point(0, THERE), point(1, HOME), point(0, THERE))
    assert bench.events == ['began', 0]
    bench.rest()
    assert bench.events == ['began', 0, 1, 'began', 0]


def test_a_trajectory_that_begins_with_any_sequence_is_told_too():
    bench = ProgramBench(check_sequence=False)
    bench.send(point(5), point(5))
    assert bench.events == ['began', 5, 5]


def test_a_program_that_is_restarted_by_the_beginning_takes_no_point():
    bench = ProgramBench()
    bench.program._queue._began = bench.program.restart
    bench.send(point(0, THERE))
    assert bench.codes() == [(0, FAILURE)]
    assert not bench.arm.moving


def test_what_is_left_of_a_step_goes_to_the_next_point():
    bench = ProgramBench()
    bench.send(point(0, THERE), point(1, HOME), point(2, THERE))
    bench.program.step(60.0)
    assert bench.codes() == [(0, SUCCESS), (1, SUCCESS), (2, SUCCESS)]


def test_a_refused_first_point_begins_nothing():
    bench = ProgramBench()
    bench.blocked = Refusal(ErrorNumber.MOTORS_OFF, 'the motors are off')
    bench.send(point(0, THERE))
    assert bench.codes() == [(0, FAILURE)]
    assert bench.events == []


def test_a_program_that_is_restarted_by_the_point_it_gives_to_the_arm():
    bench = ProgramBench()
    taken = []
    take = bench.arm.take

    def restart_at_1(point):
        taken.append(point.sequence)
        take(point)
        if point.sequence == 1:
            bench.program.restart()

    bench.arm.take = restart_at_1
    bench.send(point(0), point(1, THERE), point(2, HOME))
    bench.rest()
    assert taken == [0, 1]
    assert bench.codes() == [(0, SUCCESS), (1, FAILURE), (2, FAILURE)]


# ---- negative sequences and STOP


@pytest.mark.parametrize('sequence', [-1, -2, -3, -4, -77, -(2**31)])
def test_every_negative_sequence_is_a_stop(sequence):
    bench = ProgramBench(negative_is_stop=True)
    bench.send(point(0, THERE))
    bench.step(0.1)
    bench.send(point(sequence, THERE))
    assert bench.codes() == [(0, FAILURE), (sequence, SUCCESS)]
    bench.rest()
    assert bench.joints[0] < 0.5


def test_a_stop_that_does_not_work_is_answered_in_its_turn_and_changes_nothing():
    bench = ProgramBench(stop_works=False)
    bench.send(point(0, THERE))
    bench.step(0.1)
    bench.send(point(STOP), point(1, HOME))
    assert bench.codes() == []
    bench.rest()
    assert bench.codes() == [(0, SUCCESS), (STOP, SUCCESS), (1, SUCCESS)]
    assert bench.joints == list(HOME)


def test_stops_that_do_not_work_take_no_more_memory_than_points():
    bench = ProgramBench(stop_works=False, pending_limit=5)
    bench.send(point(0, THERE), *[point(STOP)] * 6)
    assert bench.codes() == [(0, FAILURE)] + [(STOP, FAILURE)] * 6
    bench.rest()
    assert bench.error == 8000


# ---- limits


@pytest.mark.invariant(2)
def test_invariant_2_a_point_outside_the_limits_ends_the_motion_when_its_turn_comes():
    bench = ProgramBench(check_limits=False)
    bench.send(point(0, THERE), point(1, OUTSIDE), point(2, HOME))
    assert bench.error == 0
    furthest = 0.0
    while bench.arm.moving:
        bench.step(0.004)
        furthest = max(furthest, bench.joints[0])
    assert furthest == pytest.approx(0.5)
    assert bench.joints == rounded(THERE)
    assert bench.error == 4001
    assert bench.codes() == [(0, SUCCESS), (1, FAILURE), (2, FAILURE)]
    bench.send(point(1, HOME))  # the refused one again, inside
    bench.rest()
    assert bench.codes() == [(1, SUCCESS)]
    assert bench.error == 0


@pytest.mark.invariant(2)
def test_invariant_2_without_failure_replies_it_is_not_executed_either():
    bench = ProgramBench('thesis')
    bench.send(point(0, OUTSIDE))
    assert bench.take_sent() == frame(10, 3, SUCCESS, bytes(44))
    assert bench.error == 4001
    bench.step(1.0)
    assert bench.joints == list(HOME)


def test_a_late_failure_follows_the_success_for_the_same_point():
    bench = ProgramBench(acknowledge='taken', late_failure=True)
    bench.send(point(0, THERE))
    bench.rest()
    bench.codes()
    bench.send(point(1, OUTSIDE))
    assert bench.codes() == [(1, SUCCESS), (1, FAILURE)]
    assert bench.error == 4001
    bench.step(1.0)
    assert bench.joints == rounded(THERE)


def test_a_late_failure_comes_when_the_arm_is_at_the_point_before():
    bench = ProgramBench(acknowledge='taken', late_failure=True)
    bench.send(point(0, THERE), point(1, OUTSIDE))
    assert bench.codes() == [(0, SUCCESS), (1, SUCCESS)]
    assert bench.error == 0
    bench.step(0.1)
    bench.send(point(2, HOME))
    assert bench.codes() == []
    bench.rest()
    assert bench.codes() == [(1, FAILURE), (2, FAILURE)]
    assert bench.error == 4001
    assert bench.joints == rounded(THERE)


def test_a_point_that_is_no_number_is_refused_at_once_in_every_profile():
    for name in ('rc620', 'thesis', 'fanuc', 'abb', 'generic'):
        bench = ProgramBench(name)
        bench.send(point(0, (0.0, NAN)))
        assert bench.error == 8000
        assert not bench.arm.moving


# ---- velocity and duration


@pytest.mark.parametrize(
    ('uses', 'slower'),
    [('both', True), ('velocity', True), ('duration', False), ('nothing', False)],
)
def test_only_the_fields_that_count_change_the_motion(uses, slower):
    fast, slow = ProgramBench(uses=uses), ProgramBench(uses=uses)
    fast.send(point(0, THERE))
    slow.send(point(0, THERE, velocity=0.1))
    assert (slow.rest() > 2.0 * fast.rest()) is slower


@pytest.mark.parametrize(
    ('uses', 'velocity', 'duration'),
    [
        ('both', FAILURE, FAILURE),
        ('velocity', FAILURE, SUCCESS),
        ('duration', SUCCESS, FAILURE),
        ('nothing', SUCCESS, SUCCESS),
    ],
)
def test_only_the_fields_that_count_are_checked(uses, velocity, duration):
    for value in (NAN, -1.0, math.inf):
        bench = ProgramBench(uses=uses)
        bench.send(point(0, velocity=value))
        assert bench.codes() == [(0, velocity)]
        bench.send(point(0, duration=value))
        assert bench.codes() == [(0, duration)]


# ---- corrupt messages


@pytest.mark.parametrize(
    ('bad', 'words'),
    [
        (frame(11, 2, 0, bytes(53)), 'length = 65: must be 64'),
        (frame(11), 'length = 12: must be 64'),
        (frame(1), 'length = 12: must be 64'),
        (frame(10, 2, 0, bytes(52)), 'msg_type = 10: must be 11'),
        (frame(11, 1, 0, bytes(52)), 'comm_type = 1: must be 2'),
        (frame(11, 2, 1, bytes(52)), 'reply_code = 1: must be 0'),
    ],
)
def test_a_corrupt_message_ends_the_program_where_the_profile_says_so(bad, words):
    bench = ProgramBench(corrupt='quit')
    bench.send(point(0, THERE))
    bench.step(0.1)
    with pytest.raises(ProgramQuit, match=words):
        bench.send(bad)
    assert bench.error == 8000
    bench.rest()
    assert 0.0 < bench.joints[0] < 0.5  # it brakes

    other = ProgramBench(corrupt='refuse')
    other.send(bad)  # does not raise


# ---- the pause


def test_in_a_pause_nothing_is_taken_or_answered_and_afterwards_everything():
    bench = ProgramBench()
    bench.send(point(0, THERE))
    bench.step(0.1)
    bench.pause()
    bench.send(point(1, HOME), point(2, THERE))
    bench.step(5.0)
    assert bench.codes() == []
    assert 0.0 < bench.joints[0] < 0.5
    assert bench.program.paused
    bench.resume()
    assert not bench.program.paused
    bench.rest()
    assert bench.codes() == [(0, SUCCESS), (1, SUCCESS), (2, SUCCESS)]
    assert bench.joints == rounded(THERE)


def test_a_point_that_comes_in_a_pause_moves_nothing_until_it_ends():
    bench = ProgramBench()
    bench.pause()
    bench.pause()
    bench.send(point(0, THERE))
    bench.step(1.0)
    assert (bench.joints, bench.codes(), bench.events) == (list(HOME), [], [])
    bench.resume()
    bench.rest()
    assert bench.codes() == [(0, SUCCESS)]


@pytest.mark.invariant(3)
def test_invariant_3_stop_works_in_a_pause():
    bench = ProgramBench()
    bench.send(point(0, THERE))
    bench.step(0.1)
    bench.pause()
    bench.send(point(1, HOME), point(STOP))
    assert bench.codes() == [(0, FAILURE), (1, FAILURE), (STOP, SUCCESS)]
    bench.resume()
    bench.step(2.0)
    assert 0.0 < bench.joints[0] < 0.5
    assert bench.codes() == []


@pytest.mark.invariant(7)
def test_invariant_7_points_in_a_pause_are_limited():
    bench = ProgramBench(pending_limit=3)
    bench.pause()
    bench.send(*(point(i, THERE) for i in range(4)))
    assert bench.codes() == [(i, FAILURE) for i in range(4)]
    assert bench.error == 8000
    bench.resume()
    assert not bench.arm.moving


# ---- whole profiles


def test_the_thesis_answers_zero_success_whatever_comes_and_goes_on():
    bench = ProgramBench('thesis')
    bench.send(point(3, THERE), point(STOP), point(-1), point(0, HOME))
    bench.rest()
    assert bench.take_sent() == frame(10, 3, SUCCESS, bytes(44)) * 4
    assert bench.joints == list(HOME)


def test_fanuc_acknowledges_before_it_moves():
    bench = ProgramBench('fanuc')
    bench.send(point(0, THERE))
    assert bench.codes() == [(0, SUCCESS)]
    assert np.abs(bench.joints).max() == 0.0


# ---- anything at all


@pytest.mark.invariant(2, 7)
@pytest.mark.parametrize('name', ['rc620', 'thesis', 'fanuc', 'abb', 'generic'])
def test_invariants_2_and_7_whatever_comes_in_whatever_order(name):
    random = np.random.default_rng(7)
    bench = ProgramBench(name, pending_limit=20)
    sequences = [-5, -4, -3, -2, -1, 0, 1, 2, 3]
    for _ in range(1500):
        joints = random.uniform(-1.0, 1.0, 6) * random.choice([0.1, 1.0, 4.0], p=[0.6, 0.35, 0.05])
        data = point(int(random.choice(sequences)), joints, int(random.choice([1, 2, 2, 3])))
        if random.random() < 0.02:
            data = frame(*(int(word) for word in random.integers(0, 15, 3)), bytes(52))
        action = random.random()
        if action < 0.02:
            (bench.resume if bench.program.paused else bench.pause)()
        elif action < 0.03:
            bench.program.abort()
        try:
            bench.send(data)
        except ProgramQuit:
            assert name == 'thesis'
        bench.step(float(random.choice([0.0, 0.004, 0.3])), 0.02)
        assert (bench.arm.position >= LIMITS.position_min).all()
        assert (bench.arm.position <= LIMITS.position_max).all()
        assert len(bench.program._queue) <= max(20, bench.profile.download.buffer) + 1
    bench.resume()
    bench.send(point(STOP))
    bench.rest()
    bench.take_sent()
    bench.send(point(0, THERE))
    bench.rest()
    assert bench.joints == rounded(THERE)
    assert bench.take_sent()[12] == SUCCESS
