# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Arrival times of the messages of a stream, and the messages missed before them."""

import pytest

from epson_driver.driver.servo import setpoint
from epson_driver.driver.servo.setpoint import (
    DISCOVERY_S,
    GAP_S,
    MAX_PUBLISHERS,
    ArrivalMonitor,
    came_at,
)


def missed_before(*messages):
    """Return whether messages were missed before each message: (number, monotonic time, s)."""
    topic = ArrivalMonitor(-DISCOVERY_S)
    return [topic.missed(number, came) for number, came in messages]


@pytest.mark.parametrize(
    ('messages', 'missed'),
    [
        ([(1, 0.0), (2, 0.02), (3, 5.0)], False),
        ([(1, 0.0), (2, 0.02), (250, 5.0)], True),
        ([(1, 0.0), (2, 0.02), (4, 0.06)], False),  # one lost on the network
        ([(1, 0.0), (700, 3.0)], True),
        ([(500, 0.0), (1, 4.0)], False),  # another publisher
        ([(500, 0.0), (20, 0.01), (501, 0.02), (21, 3.0)], False),  # two publishers
        ([(500, 0.0), (20, 0.01), (501, 0.02), (60, 3.0)], True),
        ([(None, 0.0), (None, 9.0)], False),  # a middleware without sequence numbers
    ],
)
def test_missed_messages_in_a_gap_are_detected(messages, missed):
    assert missed_before(*messages)[-1] is missed


def test_no_message_counts_as_missed_before_the_first_one():
    assert missed_before((4711, 1e6)) == [False]


@pytest.mark.invariant(4)
@pytest.mark.parametrize(
    ('number', 'after', 'missed'),
    [(1, 1.0, False), (50, 1.0, True), (50, DISCOVERY_S, False), (None, 1.0, False)],
)
def test_inv4_publisher_found_soon_after_start_counts_as_already_sending(number, after, missed):
    """The driver may have been restarted while the stream continued."""
    assert ArrivalMonitor(100.0).missed(number, 100.0 + after) is missed


def test_number_of_remembered_publishers_is_bounded():
    topic = ArrivalMonitor(-DISCOVERY_S)
    for number in range(10 * MAX_PUBLISHERS, 0, -1):
        topic.missed(number, 2.0 * GAP_S * number)
    assert len(topic._newest) == MAX_PUBLISHERS


@pytest.mark.parametrize(
    ('received', 'came'),
    [
        (1000.0, 50.0),
        (999.7, 49.7),  # it was queued
        (0.0, 50.0),  # unknown to the middleware
        (1000.5, 50.0),  # the clock was set back
        (2.0, 50.0),  # the clock was set forward
    ],
)
def test_arrival_time_is_the_middleware_reception_time(monkeypatch, received, came):
    monkeypatch.setattr(setpoint.time, 'time', lambda: 1000.0)
    monkeypatch.setattr(setpoint.time, 'monotonic', lambda: 50.0)
    assert came_at(int(received * 1e9)) == pytest.approx(came)


def test_arrival_time_without_reception_time_is_now(monkeypatch):
    monkeypatch.setattr(setpoint.time, 'monotonic', lambda: 50.0)
    assert came_at(None) == 50.0
