# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What `make bench` makes of what it measured beside the programs that do the least."""

import json
import os
import struct
from pathlib import Path

import pytest

from benchmark.codec import PACKETS, codec
from benchmark.goal_length import measure_one, slow_wave
from benchmark.performance import bars
from benchmark.performance_report import BEGIN, END, Bar, docs_page, medians, report
from benchmark.point_round_trip import one_core
from benchmark.state_sender import STATUS, STEP_RAD, frame
from epson_driver.robots import load_robot_model
from epson_driver.simple_message import JointPosition, PacketFramer, Status

ROOT = Path(__file__).parents[2]
LIMITS = load_robot_model('c3_a601s').limits


def newest():
    return json.loads((ROOT / 'benchmark/results/performance.json').read_text('utf-8'))


def test_a_bar_is_an_upper_or_a_lower_one():
    assert Bar('', 1.1, 1.1).met
    assert not Bar('', 1.101, 1.1).met
    assert Bar('', 50.0, 50.0, at_least=True).met
    assert not Bar('', 49.9, 50.0, at_least=True).met


def test_what_is_found_is_the_median_of_the_runs():
    runs = [[Bar('a', value, 1.0), Bar('b', 9.0, 5.0, at_least=True)] for value in (0.9, 1.2, 0.8)]
    first, second = medians(runs)
    assert first == Bar('a', 0.9, 1.0, runs=(0.9, 1.2, 0.8))
    assert second.at_least
    assert second.met


def test_the_sender_numbers_its_messages_exactly():
    framer = PacketFramer()
    for number in (1, 77, 500_000, 900_001):
        framer.receive_data(frame(number) + STATUS)
        message = framer.next_packet().message
        assert isinstance(message, JointPosition)
        assert message.joints[0] == number * STEP_RAD
        assert round(message.joints[5] / STEP_RAD) == number
        assert isinstance(framer.next_packet().message, Status)


def test_round_trips_are_measured_on_one_core():
    """Between two, the time that one takes to wake the other would be most of it."""
    allowed = os.sched_getaffinity(0)
    with one_core() as core:
        assert os.sched_getaffinity(0) == {core} <= allowed
    assert os.sched_getaffinity(0) == allowed


@pytest.mark.parametrize('name', PACKETS)
def test_bare_struct_has_the_bytes_of_the_message(name):
    """`codec` raises if it has not; what it measures is more than nothing."""
    row = codec(name, 1, 20)
    assert min(row.bare_encode, row.bare_decode, row.encode, row.decode) > 0.0
    assert struct.calcsize('<' + PACKETS[name][1]) >= 28


@pytest.mark.invariant(7)
def test_inv7_a_long_goal_needs_no_more_memory_for_its_first_point():
    """docs/invariants.md, 7."""
    long, longer = (measure_one(points, LIMITS, 1) for points in (4_000, 10_000))
    assert longer.memory - long.memory < 30_000  # 5 bytes a point; messages would take 500


def test_the_benchmark_moves_the_arm_slowly():
    message = slow_wave(2000, 0.3)
    assert message.points[0].positions[0] == 0.3
    assert message.points[-1].positions[0] == pytest.approx(0.3, abs=1e-3)


def test_the_page_has_the_figures_of_the_results():
    data = newest()
    page = (ROOT / 'docs/performance.md').read_text('utf-8')
    assert docs_page(page, data) == page, 'run `make bench`'
    assert (
        docs_page(f'a\n{BEGIN}\nold\n{END}\nb\n', data) == f'a\n{BEGIN}\n{report(data)}{END}\nb\n'
    )


def test_the_bars_are_those_of_the_figures():
    data = newest()
    found = [bar.name for bar in bars(data)]
    assert found == [bar['name'] for bar in data['bars']]
    assert [bar.value for bar in bars(data)] == pytest.approx(
        [bar['runs'][-1] for bar in data['bars']], rel=1e-4
    )
