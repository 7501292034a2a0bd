# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Timers act in order, at their moment, once; cancelled ones never."""

import tracemalloc

import pytest

from epson_driver.sim_controller.clock import MIN_TIMERS_TO_SWEEP, Clock


@pytest.fixture
def clock():
    return Clock()


def test_timers_act_at_their_moment_in_the_order_they_are_due_and_were_set(clock):
    seen = []
    for name, delay in (('b', 0.2), ('a', 0.1), ('c', 0.2), ('late', 0.4)):
        clock.after(delay, lambda name=name: seen.append((name, clock.now)))
    assert clock.next_due == 0.1
    clock.advance(0.3)
    assert seen == [('a', 0.1), ('b', 0.2), ('c', 0.2)]
    assert clock.now == 0.3
    assert clock.next_due == pytest.approx(0.4)


def test_an_action_may_set_a_timer_that_is_due_in_the_same_step(clock):
    seen = []

    def tick():
        seen.append(round(clock.now, 6))
        clock.after(0.1, tick)

    clock.after(0.1, tick)
    clock.advance(0.45)
    assert seen == [0.1, 0.2, 0.3, 0.4]


def test_cancelled_timers_do_not_act_and_are_not_due(clock):
    timer = clock.after(0.1, lambda: pytest.fail('acted'))
    timer.cancel()
    timer.cancel()
    assert clock.next_due is None
    clock.advance(1.0)


def test_time_does_not_go_back(clock):
    clock.advance(1.0)
    clock.advance(0.5)
    assert clock.now == 1.0


def test_cancelled_timers_take_no_memory(clock):
    acted = []
    clock.after(7200.0, lambda: acted.append(clock.now))
    tracemalloc.start()
    for _ in range(50_000):
        clock.after(3600.0, lambda: pytest.fail('acted')).cancel()
    held, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert clock.timers <= MIN_TIMERS_TO_SWEEP
    assert held < 1000 * MIN_TIMERS_TO_SWEEP
    clock.advance(8000.0)
    assert acted == [7200.0]


def test_every_period_without_drift_until_it_is_cancelled(clock):
    seen = []
    timer = clock.every(0.1, lambda: seen.append(round(clock.now, 9)), first=0.05)
    for step in range(1, 101):
        clock.advance(0.01 * step)
    assert seen == [round(0.05 + 0.1 * i, 9) for i in range(10)]
    timer.cancel()
    clock.advance(9.0)
    assert len(seen) == 10
    assert clock.next_due is None


@pytest.mark.parametrize('catch_up', [0, 3])
def test_what_was_missed_in_a_long_step_is_left_out_but_for_the_newest(clock, catch_up):
    passed, seen = [], []
    clock.every(0.1, lambda: seen.append(clock.now), catch_up=catch_up)
    clock.advance(60.05, passed.append)
    newest = [60.0 - 0.1 * before for before in reversed(range(catch_up + 1))]
    assert seen == pytest.approx(newest, abs=1e-9)
    assert len(passed) == catch_up + 2  # what was left out is no work
    clock.advance(60.15)
    assert seen[catch_up + 1 :] == pytest.approx([60.1])


def test_a_step_of_two_hours_is_no_more_work_than_one_of_two_seconds(clock):
    seen = []
    clock.every(0.005, lambda: seen.append(clock.now), catch_up=200)
    clock.advance(2.001)
    assert len(seen) == 201
    clock.advance(7200.001)
    assert len(seen) == 402


def test_time_passes_before_each_timer_and_may_cancel_it(clock):
    passed = []
    timer = clock.after(0.2, lambda: pytest.fail('acted'))

    def passes(seconds):
        passed.append(round(seconds, 6))
        timer.cancel()

    clock.after(0.1, lambda: passed.append('timer'))
    clock.advance(0.5, passes)
    assert passed == [0.1, 'timer', 0.4]


@pytest.mark.parametrize('late', [0.0, 0.0005, 0.0019, 0.003, 0.0999])
def test_what_is_repeated_happens_when_it_is_due_however_late_the_step_is(clock, late):
    """A client that counts messages knows the time between them."""
    passed, seen = [], []
    clock.every(0.1, lambda: seen.append((clock.now, sum(passed))), first=0.1)
    for due in (0.1, 0.2, 0.3):
        clock.advance(due + late + 1e-9, passed.append)
    assert seen == [(pytest.approx(due), pytest.approx(due)) for due in (0.1, 0.2, 0.3)]


def test_what_happens_once_happens_when_it_is_due(clock):
    seen = []
    clock.after(0.1, lambda: seen.append(clock.now))
    clock.advance(0.1005)
    assert seen == [0.1]
