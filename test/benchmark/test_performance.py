# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The benchmarks of performance and reliability, and the pages that show them."""

import os
import struct
from pathlib import Path
from typing import Any

import pytest

from benchmark import reliability_page
from benchmark.codec import PACKETS, codec
from benchmark.goal_length import measure_one, slow_wave
from benchmark.performance_report import Bar, medians
from benchmark.point_round_trip import one_core
from benchmark.reliability_page import provenance
from benchmark.state_sender import STATUS, STEP_RAD, frame
from epson_driver.robots import load_robot_model
from epson_driver.simple_message import JointPosition, PacketFramer, Status

ROOT = Path(__file__).parents[2]
LIMITS = load_robot_model('c3_a601s').limits


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


RUN = provenance('make it')

CELL = {
    'fault': 'cut', 'phase': 'moving', 'profile': 'rc620', 'interface': 'usual',
    'end': 'aborted', 'rest': 0.1, 'recovery': 0.2, 'failure': '',
}  # fmt: skip


def test_the_newest_figures_replace_one_table_of_the_page() -> None:
    text = 'a\n<!-- fuzz: begin -->\nstale\n<!-- fuzz: end -->\n<!-- soak: begin -->\n'
    figures = {'run': RUN, 'seed': 7, 'targets': {}}
    written = reliability_page.page(text, reliability_page.FUZZ, figures)
    assert written.startswith('a\n<!-- fuzz: begin -->\n`make it`')
    assert written.endswith('<!-- fuzz: end -->\n<!-- soak: begin -->\n')
    assert 'seed 7' in written
    assert 'stale' not in written


def test_a_table_of_faults_counts_outcomes_and_names_what_failed() -> None:
    cells = [
        CELL,
        CELL | {'rest': 0.4},
        {'failure': 'AssertionError: moved'} | {key: CELL[key] for key in ('fault', 'phase')},
    ]
    text = ''.join(reliability_page.faults({'run': RUN, 'cells': cells}))
    assert '3 cells; in 1 of them something did not hold.' in text
    assert '`make it`' in text
    assert '| `cut` | 3 | 2 aborted, **failed** | 0.40 | 0.20 |' in text


def test_fuzzing_tells_how_many_inputs_there_were_and_what_was_found() -> None:
    target = {'inputs': 1000, 'found': []}
    figures: dict[str, Any] = {'run': RUN, 'seed': 1, 'targets': {'one': target, 'two': target}}
    text = ''.join(reliability_page.fuzz(figures))
    assert '2,000 inputs to 2 targets; 0 things did not hold.' in text
    figures['targets']['two'] = target | {'found': ['x', 'y']}
    assert '2 things did not hold: two 2.' in ''.join(reliability_page.fuzz(figures))
