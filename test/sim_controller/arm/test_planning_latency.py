# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
import pytest

from epson_driver.sim_controller.arm.streaming import (
    INITIAL_LATENCY_S,
    MAX_LATENCY_S,
    MAX_RECENT_PLANS,
    MIN_LATENCY_S,
    PlanningLatency,
)


def test_it_begins_with_a_guess_and_follows_what_most_of_the_recent_plans_take():
    latency = PlanningLatency()
    assert latency.value == INITIAL_LATENCY_S
    for _ in range(MAX_RECENT_PLANS):
        latency.took(0.02)
    assert latency.value == pytest.approx(0.026)
    for _ in range(MAX_RECENT_PLANS // 4):
        latency.took(0.05)
    assert latency.value == pytest.approx(0.065)


def test_one_slow_plan_in_25_does_not_raise_it():
    latency = PlanningLatency()
    for number in range(4 * MAX_RECENT_PLANS):
        latency.took(0.08 if number % 25 == 24 else 0.01)
    assert latency.value == pytest.approx(0.013)


def test_a_late_plan_raises_it():
    latency = PlanningLatency()
    latency.took(0.041, late=True)
    assert latency.value == pytest.approx(0.06)
    latency.took(0.041, late=True)
    assert latency.value == pytest.approx(0.09)


@pytest.mark.parametrize(('seconds', 'value'), [(0.0, MIN_LATENCY_S), (5.0, MAX_LATENCY_S)])
def test_it_stays_within_bounds(seconds, value):
    latency = PlanningLatency()
    for _ in range(MAX_RECENT_PLANS):
        latency.took(seconds, late=seconds > 0.0)
    assert latency.value == value
