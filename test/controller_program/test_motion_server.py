# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The motion server of the SPEL+ program beyond test_motion_rules.py: Speed, Accel, the ring."""

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest
from support.controller_harness import FAILURE, MODEL, STOP, SUCCESS, point
from support.spel_program_harness import OurProgramHarness

from epson_driver.simple_message import Ping, topic

FASTEST = math.degrees(MODEL.limits.velocity[0])
"""Speed of joint 1, degrees/s."""
OVERHEAD_S = 0.012


class Go(NamedTuple):
    """A statement Go: its time, where the arm was, its target (degrees), Speed and Accel."""

    time: float
    start: Any
    target: tuple[float, ...]
    speed: float
    accel: float


class Recorded(OurProgramHarness):
    """A ready controller that records each Go."""

    def __init__(self, **options):
        super().__init__(**options)
        self.moves = []
        self._move, self.controller.program.move = self.controller.program.move, self._record
        self.client = self.ready()

    def _record(self, request):
        spel = self.controller.spel
        values = spel.values('Speed')[0], spel.values('Accel')[0]
        self.moves.append(
            Go(self.now, np.degrees(self.position), request.points[0].values, *values)
        )
        return self._move(request)

    def play(self, *points):
        """Execute points to the end, and return the Speed of each Go."""
        assert {code for _, code in self.client.stream(*points)} == {SUCCESS}
        self.rest()
        return [go.speed for go in self.moves]


@pytest.fixture
def harness():
    return Recorded()


def to(number, degrees, duration=0.0, velocity=0.0):
    """Return a point that has joint 1 at an angle."""
    return point(number, (math.radians(degrees),), velocity, duration)


def line(count, step, duration):
    return [to(n, step * (n + 1), duration) for n in range(count)]


def test_rounding_of_speed_is_compensated(harness):
    """4 degrees in 0.2 s are 4.73 % of joint 1. Speed alternates between 4 and 5."""
    speeds = harness.play(*line(20, 4.0, 0.2))
    assert set(speeds) == {4.0, 5.0}
    planned = sum(4.0 / FASTEST / speed * 100.0 + OVERHEAD_S for speed in speeds)
    assert planned == pytest.approx(20 * 0.2, abs=0.06)


def test_accel_matches_speed():
    """Accelerations take BLEND_MS, so Accel equals Speed, except for short distances."""
    harness = Recorded(T100_MS='160', RAMP_MS='0')
    harness.play(to(0, 30.0, 0.25))
    harness.play(to(0, 29.0, 0.02))
    first, short = harness.moves
    assert first.accel == first.speed == 28.0
    assert short.accel > short.speed


def test_accel_is_at_least_1_percent():
    harness = Recorded(BLEND_MS='4000')
    assert harness.play(to(0, 4.0, 10.0)) == [1.0]
    assert harness.moves[0].accel == 1.0


@pytest.mark.parametrize('velocity', [1e-6, 0.0796, 0.25, 0.3])
def test_velocity_of_a_point_with_a_duration_is_rounded_up(harness, velocity):
    """Otherwise each point of a stream would take longer than its duration."""
    speeds = harness.play(to(0, 30.0, 0.1, velocity))
    assert speeds == [max(math.ceil(round(100.0 * velocity, 3)), 1)]


def test_compensated_delay_is_limited(harness):
    """A delay of at most half a second is compensated."""
    harness.client.stream(*(to(n, 4.0 * (n + 1), 0.1, 0.02) for n in range(5)))
    assert harness.variable('m_late') == 0.5
    assert harness.play(to(5, 24.0, 0.2))[-1] == 5.0


def test_velocity_limits_speed(harness):
    points = [to(0, 20.0, 0.0, 0.3), to(1, 40.0, 0.1, 0.1), to(2, 60.0), to(3, 60.5, 0.0, 0.001)]
    assert harness.play(*points) == [30.0, 10.0, 100.0, 1.0]


def test_limits_apply_to_a_joint_whose_pulses_descend():
    model = replace(MODEL, pulses_per_degree=-MODEL.pulses_per_degree)
    client = OurProgramHarness(model=model).ready()
    highest = math.degrees(MODEL.limits.position_max[0])
    assert client.stream(to(0, highest + 0.1)) == [(0, FAILURE)]
    assert client.stream(to(0, highest - 0.1)) == [(0, SUCCESS)]


def test_point_at_the_current_position_waits_for_its_duration(harness):
    harness.play(to(0, 10.0), to(1, 10.0, 1.0), to(2, 20.0))
    first, second = harness.moves
    assert 1.1 < second.time - first.time < 1.5


def test_speed_after_a_stop_is_computed_from_rest(harness):
    """The points wait until the arm is at rest, so Speed fits the distance from there."""
    harness.client.stream(*line(3, 40.0, 1.0))
    harness.step(0.5)
    started = len(harness.moves)
    harness.client.send_bytes(point(STOP) + to(0, -20.0, 1.0))
    harness.rest()
    assert harness.client.replies() == [(STOP, SUCCESS), (0, SUCCESS)]
    (go,) = harness.moves[started:]
    wanted = (go.start[0] + 20.0) / FASTEST / (1.0 - OVERHEAD_S) * 100.0
    assert go.speed == pytest.approx(wanted, abs=1.0)


def test_unanswered_points_fail_before_the_reply_to_stop():
    """Points beyond the look-ahead are unanswered when STOP arrives."""
    harness = OurProgramHarness(LOOK_AHEAD='4')
    client = harness.ready()
    client.send_bytes(b''.join(line(8, 10.0, 1.0)))
    harness.step(0.2)
    assert client.replies() == [(n, SUCCESS) for n in range(4)]
    client.send_bytes(point(STOP))
    harness.step(0.05)
    assert client.replies() == [*((n, FAILURE) for n in range(4, 8)), (STOP, SUCCESS)]


def test_ring_wraps_around(harness):
    for _ in range(2):
        harness.play(*line(130, 1.0, 0.03))
        harness.play(to(0, 0.0, 0.5))
    assert [round(go.target[0]) for go in harness.moves] == [*range(1, 131), 0] * 2


def test_download_in_the_wrong_order_is_refused(harness):
    client = harness.client
    client.send_bytes(b''.join(point(n, (), 0.1, 0.2) for n in (-1, 2, -3)))
    harness.step(0.3)
    assert client.replies() == [(-1, SUCCESS), (2, FAILURE), (-3, FAILURE)]
    client.send_bytes(b''.join(point(n, (9.0,), 0.1, 0.2) for n in (-1, 0)) + to(0, 4.0, 0.2))
    harness.step(0.3)
    assert client.replies() == [(-1, FAILURE), (0, FAILURE), (0, SUCCESS)]


def test_single_point_is_executed_without_waiting_for_more(harness):
    begin = harness.now
    harness.play(to(0, 4.0, 0.2))
    assert harness.moves[0].time - begin < 0.07


def test_arm_waits_for_each_of_the_first_three_points():
    harness = Recorded(START_WAIT='0.1')
    for data in line(3, 4.0, 0.2):
        assert not harness.moves
        harness.client.send_bytes(data)
        harness.step(0.08)
    assert harness.moves


def test_client_may_be_silent_without_main(harness):
    client = harness.client
    client.send(topic(Ping()))
    client.send_bytes(b''.join(line(12, 10.0, 2.0)))
    harness.step(0.3)
    harness.do('E-stop press')
    harness.step(5.0)
    assert harness.variable('g_point_error') == 0
    harness.do('E-stop release', 'reset', 'motors on', 'start')
    harness.step(0.3)
    client.packets()
    assert client.stream(to(0, 0.0, 0.1)) == [(0, SUCCESS)]
