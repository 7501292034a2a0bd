# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""When the messages of a stream came, and what was missed of it."""

import pytest

from epson_driver.driver.servo import arrivals
from epson_driver.driver.servo.arrivals import (
    DISCOVERY_S,
    GAP_S,
    MAX_PUBLISHERS,
    Arrivals,
    came_at,
)


def heard(*messages):
    """Return what was missed before each message: (number, monotonic time in s)."""
    topic = Arrivals(-DISCOVERY_S)
    return [topic.missed(number, came) for number, came in messages]


@pytest.mark.parametrize(
    ('messages', 'missed'),
    [
        ([(1, 0.0), (2, 0.02), (3, 5.0)], False),
        ([(1, 0.0), (2, 0.02), (250, 5.0)], True),
        ([(1, 0.0), (2, 0.02), (4, 0.06)], False),  # one was lost on the network
        ([(1, 0.0), (700, 3.0)], True),
        ([(500, 0.0), (1, 4.0)], False),  # another publisher
        ([(500, 0.0), (20, 0.01), (501, 0.02), (21, 3.0)], False),  # two of them
        ([(500, 0.0), (20, 0.01), (501, 0.02), (60, 3.0)], True),
        ([(None, 0.0), (None, 9.0)], False),  # a middleware that does not number them
    ],
)
def test_a_gap_with_messages_that_nobody_saw_is_no_silence(messages, missed):
    assert heard(*messages)[-1] is missed


def test_the_first_message_of_all_misses_nothing():
    assert heard((4711, 1e6)) == [False]


@pytest.mark.invariant(4)
@pytest.mark.parametrize(
    ('number', 'after', 'missed'),
    [(1, 1.0, False), (50, 1.0, True), (50, DISCOVERY_S, False), (None, 1.0, False)],
)
def test_inv4_a_publisher_found_soon_after_the_start_may_have_sent_before(number, after, missed):
    """A stream that went on while the driver was started again begins anew."""
    assert Arrivals(100.0).missed(number, 100.0 + after) is missed


def test_publishers_that_come_and_go_fill_no_memory():
    topic = Arrivals(-DISCOVERY_S)
    for number in range(10 * MAX_PUBLISHERS, 0, -1):
        topic.missed(number, 2.0 * GAP_S * number)
    assert len(topic._newest) == MAX_PUBLISHERS


@pytest.mark.parametrize(
    ('received', 'came'),
    [
        (1000.0, 50.0),
        (999.7, 49.7),  # it waited for its callback
        (0.0, 50.0),  # the middleware does not say
        (1000.5, 50.0),  # the clock was set back
        (2.0, 50.0),  # and forward
    ],
)
def test_a_message_came_when_the_middleware_took_it(monkeypatch, received, came):
    monkeypatch.setattr(arrivals.time, 'time', lambda: 1000.0)
    monkeypatch.setattr(arrivals.time, 'monotonic', lambda: 50.0)
    assert came_at(int(received * 1e9)) == pytest.approx(came)


def test_without_a_time_of_reception_it_came_just_now(monkeypatch):
    monkeypatch.setattr(arrivals.time, 'monotonic', lambda: 50.0)
    assert came_at(None) == 50.0
