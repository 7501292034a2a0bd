# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The clock of the simulation, and its reproducibility."""

import tracemalloc
from contextlib import suppress

import numpy as np
import pytest
from support.controller_harness import LIMITS, MODEL, SIMULATED, STOP, InlinePlanner, Peer, point

from epson_driver.sim_controller.assembly import new_controller
from epson_driver.sim_controller.clock import MIN_TIMERS_TO_SWEEP, Clock
from epson_driver.sim_controller.condition.states import Event, RejectedError
from epson_driver.sim_controller.faults.fault_kinds import parse
from epson_driver.simple_message import FrameError


@pytest.fixture
def clock():
    return Clock()


def test_timers_run_on_time_and_in_order(clock):
    seen = []
    for name, delay in (('b', 0.2), ('a', 0.1), ('c', 0.2), ('late', 0.4)):
        clock.after(delay, lambda name=name: seen.append((name, clock.now)))
    assert clock.next_due == 0.1
    clock.advance(0.3)
    assert seen == [('a', 0.1), ('b', 0.2), ('c', 0.2)]
    assert clock.now == 0.3
    assert clock.next_due == pytest.approx(0.4)


def test_action_may_set_a_timer_for_the_same_step(clock):
    seen = []

    def tick():
        seen.append(round(clock.now, 6))
        clock.after(0.1, tick)

    clock.after(0.1, tick)
    clock.advance(0.45)
    assert seen == [0.1, 0.2, 0.3, 0.4]


def test_cancelled_timers_do_not_run(clock):
    timer = clock.after(0.1, lambda: pytest.fail('acted'))
    timer.cancel()
    timer.cancel()
    assert clock.next_due is None
    clock.advance(1.0)


def test_time_does_not_go_back(clock):
    clock.advance(1.0)
    clock.advance(0.5)
    assert clock.now == 1.0


def test_cancelled_timers_use_no_memory(clock):
    acted = []
    clock.after(7200.0, lambda: acted.append(clock.now))
    tracemalloc.start()
    for _ in range(50_000):
        clock.after(3600.0, lambda: pytest.fail('acted')).cancel()
    used, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert clock.timers <= MIN_TIMERS_TO_SWEEP
    assert used < 1000 * MIN_TIMERS_TO_SWEEP
    clock.advance(8000.0)
    assert acted == [7200.0]


def test_periodic_timer_has_no_drift(clock):
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
def test_long_step_skips_all_but_the_newest_periods(clock, catch_up):
    passed, seen = [], []
    clock.every(0.1, lambda: seen.append(clock.now), catch_up=catch_up)
    clock.advance(60.05, passed.append)
    newest = [60.0 - 0.1 * before for before in reversed(range(catch_up + 1))]
    assert seen == pytest.approx(newest, abs=1e-9)
    assert len(passed) == catch_up + 2  # skipped periods cost nothing
    clock.advance(60.15)
    assert seen[catch_up + 1 :] == pytest.approx([60.1])


def test_work_of_a_long_step_is_limited(clock):
    seen = []
    clock.every(0.005, lambda: seen.append(clock.now), catch_up=200)
    clock.advance(2.001)
    assert len(seen) == 201
    clock.advance(7200.001)
    assert len(seen) == 402


def test_time_advances_before_each_timer(clock):
    passed = []
    timer = clock.after(0.2, lambda: pytest.fail('acted'))

    def passes(seconds):
        passed.append(round(seconds, 6))
        timer.cancel()

    clock.after(0.1, lambda: passed.append('timer'))
    clock.advance(0.5, passes)
    assert passed == [0.1, 'timer', 0.4]


@pytest.mark.parametrize('late', [0.0, 0.0005, 0.0019, 0.003, 0.0999])
def test_periodic_timer_runs_at_its_time_in_a_late_step(clock, late):
    """Clients derive times from the number of messages."""
    passed, seen = [], []
    clock.every(0.1, lambda: seen.append((clock.now, sum(passed))), first=0.1)
    for due in (0.1, 0.2, 0.3):
        clock.advance(due + late + 1e-9, passed.append)
    assert seen == [(pytest.approx(due), pytest.approx(due)) for due in (0.1, 0.2, 0.3)]


def test_single_timer_runs_at_its_time_in_a_late_step(clock):
    seen = []
    clock.after(0.1, lambda: seen.append(clock.now))
    clock.advance(0.1005)
    assert seen == [0.1]


PORTS = ('motion', 'state', 'io', 'remote')


def run(seed, planner=None, inputs=7):
    """Return the bytes of each port after a few seconds with inputs drawn from `inputs`."""
    controller = new_controller(MODEL, SIMULATED, planner=planner, seed=seed)
    random = np.random.default_rng(inputs)
    peers = {port: Peer() for port in PORTS}
    connections = {port: controller.connect(port, peer) for port, peer in peers.items()}
    out = {port: bytearray() for port in PORTS}
    events = (Event.ESTOP_PRESS, Event.ESTOP_RELEASE, Event.RESET, Event.PAUSE, Event.CONTINUE)
    for fault in ('jitter 0.03', 'bit_errors 0.3 bits=3', 'coalesce 0.02 port=motion'):
        controller.faults.start(parse(fault))
    connections['remote'].receive(b'$Login\r\n')
    for index in range(80):
        chosen = [*events, *[Event.MOTORS_ON] * 5][random.integers(10)]
        with suppress(RejectedError):
            controller.apply(chosen)
        joints = 0.2 * random.uniform(LIMITS.position_min, LIMITS.position_max)
        sequence = int(random.choice([0, index % 5, STOP]))
        connections['motion'].receive(
            point(sequence, joints, float(random.uniform(0.0, 1.0)), 0.1)
        )
        connections['remote'].receive(b'$GetStatus\r\n')
        try:
            connections['io'].receive(bytes(random.integers(0, 2, 16, dtype=np.uint8)))
        except FrameError:
            connections['io'].closed()
            connections['io'] = controller.connect('io', peers['io'])
        controller.step(float(random.uniform(0.0, 0.2)))
        for port, peer in peers.items():
            out[port] += peer.take()
    return {port: bytes(data) for port, data in out.items()}


@pytest.mark.parametrize('smooth', [False, True])
def test_same_inputs_and_seed_give_the_same_bytes(smooth):
    first, second = (run(3, InlinePlanner() if smooth else None) for _ in range(2))
    assert first == second
    assert all(first[port] for port in ('motion', 'state', 'remote'))


def test_another_seed_changes_random_output_only():
    first, second = run(3), run(4)
    assert first['state'] != second['state']
    assert first['remote'] == second['remote']
