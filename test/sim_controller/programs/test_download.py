# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Downloads of the built-in program beyond test_motion_rules.py: dead time and buffer."""

from dataclasses import replace

import pytest
from support.program_harness import (
    FAILURE,
    HOME,
    REQUEST,
    SUCCESS,
    THERE,
    TOPIC,
    ProgramHarness,
    point,
    profile,
    rounded,
)

FIRST, LAST, STOP = -1, -3, -4
DOWNLOAD = profile('simulated').download


def trajectory(number, comm_type=TOPIC, joints=THERE):
    """Return the messages of a download of `number` ≥ 2 points to `joints`."""
    sequences = [FIRST, *range(1, number - 1), LAST]
    return [
        point(sequence, [q * (at + 1) / number for q in joints], comm_type)
        for at, sequence in enumerate(sequences)
    ]


def new_harness(name='simulated', buffer=1000, overflow='refuse', dead_time=0.0, **changes):
    download = replace(DOWNLOAD, buffer=buffer, overflow=overflow, dead_time=dead_time)
    return ProgramHarness(name, download=download, **changes)


def test_requests_of_a_download_are_answered_after_their_dead_time():
    harness = new_harness(dead_time=0.1)
    harness.send(*trajectory(3, REQUEST))
    seen = []
    for _ in range(35):
        harness.step(0.01, 0.01)
        seen.append(harness.codes())
    at = {codes[0]: 0.01 * (i + 1) for i, codes in enumerate(seen) if codes}
    assert list(at) == [(FIRST, SUCCESS), (1, SUCCESS), (LAST, SUCCESS)]
    assert list(at.values()) == pytest.approx([0.1, 0.2, 0.3], abs=0.011)


@pytest.mark.parametrize('number', [2, 11, 100])
def test_download_starts_after_the_dead_time_of_all_points(number):
    harness = new_harness(dead_time=0.0115)
    harness.send(*trajectory(number))
    harness.step(number * 0.0115 - 0.001, 0.001)
    assert not harness.arm.moving
    harness.step(0.002, 0.001)
    assert harness.arm.moving


def test_dead_time_starts_when_a_point_arrives():
    harness = new_harness(dead_time=0.01)
    first, middle, last = trajectory(3)
    harness.send(first, middle)
    harness.step(1.0)  # the program waits for the client
    harness.send(last)
    harness.step(0.009, 0.001)
    assert not harness.arm.moving
    harness.step(0.002, 0.001)
    assert harness.arm.moving


def test_stop_ends_the_dead_time_of_a_download():
    harness = new_harness(dead_time=0.1)
    harness.send(*trajectory(50), point(STOP), *trajectory(2))
    harness.step(0.21, 0.001)
    assert harness.arm.moving


# ---- the buffer


def test_download_longer_than_the_buffer_is_refused_as_a_whole():
    harness = new_harness(buffer=5)
    harness.send(*trajectory(6))
    assert harness.error == 8000
    harness.step(5.0)
    assert (harness.joints, harness.events, harness.take_sent()) == (list(HOME), [], b'')


def test_points_beyond_the_buffer_are_lost(caplog):
    harness = new_harness(buffer=5, overflow='drop')
    harness.send(*trajectory(8))
    harness.rest()
    assert harness.error == 0
    assert harness.joints == pytest.approx([q * 5 / 8 for q in THERE])
    assert '3 points of a download are lost' in caplog.text
    caplog.clear()
    harness.send(*trajectory(4))  # the complete next download
    harness.rest()
    assert 'lost' not in caplog.text
    assert harness.joints == rounded(THERE)


@pytest.mark.invariant(7)
def test_inv7_waiting_downloads_are_limited():
    harness = new_harness(buffer=10, pending_limit=15)
    harness.send(*trajectory(10), *trajectory(10))  # the arm has one point of the first
    assert harness.error == 8000
    harness.rest()
    assert harness.joints[0] < 0.01

    harness.program.pause()
    for _ in range(100):
        harness.send(*trajectory(2))
    assert len(harness.program.queue) <= 15


@pytest.mark.invariant(7)
def test_inv7_download_without_an_end_is_limited():
    harness = new_harness(buffer=10, overflow='drop')
    harness.send(point(FIRST, HOME, TOPIC), *[point(1, THERE, TOPIC)] * 1000)
    assert len(harness.program.download) == 10
    harness.step(1.0)
    assert harness.events == []


@pytest.mark.invariant(7)
def test_inv7_requests_in_a_pause_are_limited():
    harness = new_harness(pending_limit=10)
    harness.program.pause()
    harness.send(*[point(FIRST, THERE, REQUEST)] * 11)
    assert harness.codes() == [(FIRST, FAILURE)] * 11
    assert harness.error == 8000


@pytest.mark.invariant(1)
def test_inv1_lost_client_ends_a_download():
    for number in (3, 5):
        harness = new_harness(dead_time=0.1)
        harness.send(*trajectory(5)[:number])
        harness.program.abort()  # motors off
        harness.program.restart()  # the next client
        harness.send(point(1, THERE), point(LAST, THERE))
        harness.step(3.0)
        assert harness.codes() == [(1, FAILURE), (LAST, FAILURE)]
        assert harness.joints == list(HOME)


@pytest.mark.parametrize('sequence', [1, 0, LAST, -2, -5])
def test_point_sent_as_topic_without_a_download_ends_the_motion(sequence):
    harness = new_harness()
    harness.send(point(0, THERE))
    harness.step(0.1)
    harness.send(point(sequence, THERE, TOPIC))
    assert harness.codes() == [(0, FAILURE)]  # it ends the motion, and gets no reply
    assert harness.error == 8000
    harness.rest()
    assert harness.joints[0] < 0.3


# ---- together with streaming


def test_streamed_points_before_a_download_are_executed_first():
    harness = new_harness()
    harness.send(point(0, [-0.2]), *trajectory(3), point(0, HOME))
    harness.rest()
    assert harness.codes() == [(0, SUCCESS), (0, SUCCESS)]
    assert harness.events == ['began', 0, 'began', 0, 1, 2, 'began', 0]
    assert harness.joints == list(HOME)


def test_download_ends_a_streamed_trajectory():
    harness = new_harness()
    harness.send(point(0), *trajectory(3))
    harness.rest()
    harness.send(point(1, HOME))
    assert harness.codes() == [(0, SUCCESS), (1, FAILURE)]
    harness.rest()
    assert harness.joints == rounded(THERE)


@pytest.mark.parametrize(
    'behind',
    [trajectory(3)[:1], trajectory(3), [*trajectory(3), point(0), point(1)]],
)
def test_abort_of_a_download_requires_a_new_trajectory(behind):
    harness = new_harness()
    harness.send(*[point(sequence) for sequence in range(5)], point(5, THERE), *behind)
    harness.program.abort()
    harness.rest()
    harness.take_sent()
    harness.send(point(5, HOME))
    assert harness.codes() == [(5, FAILURE)]


def test_download_requests_are_answered_during_braking():
    harness = new_harness()
    harness.send(point(0, THERE))
    harness.step(0.1)
    harness.send(point(STOP), *trajectory(2, REQUEST, HOME))
    assert harness.arm.moving
    assert harness.codes() == [(0, FAILURE), (STOP, SUCCESS), (FIRST, SUCCESS), (LAST, SUCCESS)]
    harness.rest()
    assert harness.joints == list(HOME)
