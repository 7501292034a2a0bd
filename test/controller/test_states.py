# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The table of conditions, row by row: a changed row is a failing test."""

import pytest

from epson_driver.controller.states import (
    REFUSALS,
    TRANSITIONS,
    Condition,
    Event,
    RefusedError,
    after,
)

# Written out a second time on purpose. Columns: motors on, motors off, client lost, standstill,
# E-stop press, E-stop release, reset. '-' is refused.
MATRIX = {
    'MOTORS_OFF': 'MOTORS_ON MOTORS_OFF MOTORS_OFF - ESTOP_PRESSED MOTORS_OFF MOTORS_OFF',
    'MOTORS_ON': 'MOTORS_ON STOPPING STOPPING MOTORS_ON ESTOP_PRESSED MOTORS_ON MOTORS_ON',
    'STOPPING': '- STOPPING STOPPING MOTORS_OFF ESTOP_PRESSED STOPPING STOPPING',
    'ESTOP_PRESSED': ('- ESTOP_PRESSED ESTOP_PRESSED ESTOP_PRESSED ESTOP_PRESSED ESTOP_LATCHED -'),
    'ESTOP_LATCHED': (
        '- ESTOP_LATCHED ESTOP_LATCHED ESTOP_LATCHED ESTOP_PRESSED ESTOP_LATCHED MOTORS_OFF'
    ),
}
EVENTS = (
    'MOTORS_ON',
    'MOTORS_OFF',
    'CLIENT_LOST',
    'STANDSTILL',
    'ESTOP_PRESS',
    'ESTOP_RELEASE',
    'RESET',
)
ROWS = [
    (condition, event, following)
    for condition, row in MATRIX.items()
    for event, following in zip(EVENTS, row.split(), strict=True)
]


@pytest.mark.parametrize(('condition', 'event', 'following'), ROWS)
def test_row(condition, event, following):
    before, happens = Condition[condition], Event[event]
    if following == '-':
        with pytest.raises(RefusedError, match=r'\w+ \w+'):
            after(before, happens)
    else:
        assert after(before, happens) is Condition[following]


def test_every_pair_is_a_transition_or_a_refusal_with_a_sentence():
    pairs = {(condition, event) for condition in Condition for event in Event}
    assert pairs == TRANSITIONS.keys() | REFUSALS.keys()
    assert not TRANSITIONS.keys() & REFUSALS.keys()


def test_invariant_4_motors_come_on_only_by_the_event_motors_on():
    for (before, event), following in TRANSITIONS.items():
        if following is Condition.MOTORS_ON and before is not Condition.MOTORS_ON:
            assert event is Event.MOTORS_ON
            assert before is Condition.MOTORS_OFF


def test_estop_refusals_say_what_to_do_first():
    for event in (Event.MOTORS_ON, Event.RESET):
        with pytest.raises(RefusedError, match='release the E-stop, then reset'):
            after(Condition.ESTOP_PRESSED, event)
    with pytest.raises(RefusedError, match='reset, then motors on'):
        after(Condition.ESTOP_LATCHED, Event.MOTORS_ON)
