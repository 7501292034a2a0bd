# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The link's table of states, written down a second time on purpose, and its back-off."""

from itertools import product

import pytest

from epson_driver.link.states import TRANSITIONS, LinkEvent, LinkState, back_off

TABLE = """
disconnected  open         connecting
connecting    established  connected
connecting    failed       backing_off
connecting    close        disconnected
connected     lost         backing_off
connected     close        disconnected
backing_off   retry        connecting
backing_off   close        disconnected
"""

ROWS = {
    (LinkState(state), LinkEvent(event)): LinkState(following)
    for state, event, following in (line.split() for line in TABLE.split('\n') if line)
}


def test_the_table_is_the_one_that_was_agreed():
    assert TRANSITIONS == ROWS


@pytest.mark.parametrize(
    ('state', 'event'),
    [pair for pair in product(LinkState, LinkEvent) if pair not in ROWS],
    ids=lambda value: value.value,
)
def test_an_event_without_a_row_is_an_error(state, event):
    with pytest.raises(KeyError):
        TRANSITIONS[state, event]


def test_an_open_link_can_always_be_closed_and_never_ends_by_itself():
    for state in set(LinkState) - {LinkState.DISCONNECTED}:
        assert TRANSITIONS[state, LinkEvent.CLOSE] is LinkState.DISCONNECTED
    for (_, event), following in TRANSITIONS.items():
        assert (following is LinkState.DISCONNECTED) == (event is LinkEvent.CLOSE)


def test_the_published_names():
    assert {state.value for state in LinkState} == {
        'disconnected',
        'connecting',
        'connected',
        'backing_off',
    }


def test_back_off_begins_at_once_never_shrinks_and_is_at_most_a_second():
    waits = [back_off(attempt) for attempt in range(1000)]
    assert waits[0] == 0.0
    assert waits == sorted(waits)
    assert waits[1] > 0.0
    assert waits[-1] == max(waits) == 1.0
