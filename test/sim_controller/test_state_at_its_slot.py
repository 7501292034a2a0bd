# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""State messages are sent in their slots, independent of the motion."""

import random
import struct
from dataclasses import replace

import numpy as np
import pytest
from support.controller_harness import (
    LIMITS,
    SIMULATED,
    Harness,
    InlinePlanner,
    Peer,
    point,
    split,
)

from epson_driver.driver.state.robot_state import RobotState, StateRules
from epson_driver.sim_controller.client_connections import MAX_CATCH_UP_SLOTS
from epson_driver.sim_controller.core import CYCLE_PERIOD_S
from epson_driver.sim_controller.faults.fault_kinds import FAULTS, parse
from epson_driver.sim_controller.network.pacer import Pacer
from epson_driver.simple_message import Status

PERIOD = 0.005
JOINT_POSITION, STATUS = 10, 13
BEGIN = 100.0
AWAY = (1.6, 0.4, 0.6, -0.8, 0.5, 1.2)


def on_time(_now, _chance):
    return 0.0


def late_by_1_ms(_now, chance):
    return chance.uniform(0.0, 0.001)


def late_by_30_ms(_now, chance):
    return chance.uniform(0.0, 0.03) if chance.random() < 0.2 else chance.uniform(0.0, 0.002)


def late_by_900_ms_once(now, _chance):
    return 0.9 if 0.5 < now - BEGIN < 0.51 else 0.0


LATE = [on_time, late_by_1_ms, late_by_30_ms, late_by_900_ms_once]
BURSTS = ['coalesce 0.05 port=state', 'coalesce 0.2 port=state']

QUICK = {(late_by_30_ms, None)}
"""Cases of `make test`."""


class Paced:
    """A controller whose pacer wakes `late(now, chance)` s too late, on a manual clock."""

    def __init__(self, late, *, smooth=False, fault=None):
        self.harness = Harness(planner=InlinePlanner() if smooth else None)
        self.controller = self.harness.controller
        self.now = BEGIN
        self._late, self._chance = late, random.Random(5)
        self._pacer = Pacer(self.controller, lambda: self.now)
        if fault is not None:
            self.controller.faults.start(parse(fault))
        self.peer = Peer()
        self.connection = self.controller.connect('state', self.peer)

    def wakes(self, seconds):
        """Yield the frames received at each wake-up, and its time."""
        end = self.now + seconds
        while self.now < end:
            clock = self.controller.clock
            due = min(clock.next_due - clock.now, CYCLE_PERIOD_S)
            self.now += (
                max(due, 0.0) + 1e-9 + self._late(self.now, self._chance)
            )  # never too early
            with self._pacer.present():
                pass
            if self.harness.planner is not None:
                self.harness.planner.step(due)
            yield split(self.peer.take()), self.now


def joints(body):
    return np.array(struct.unpack('<i10f', body)[1:7])


def slots(paced, seconds):
    """Return the joints of each slot, None for a STATUS."""
    return [
        joints(body) if kind == JOINT_POSITION else None
        for frames, _ in paced.wakes(seconds)
        for kind, _, _, body in frames
    ]


@pytest.mark.parametrize('late', LATE[1:])
def test_message_has_the_joints_at_its_slot_time(late):
    results = []
    for how_late in (on_time, late):
        paced = Paced(how_late)
        paced.harness.send(point(0, AWAY), point(1, (0.0,) * 6))
        results.append(slots(paced, 2.0))
    exact, reported = results
    both = zip(exact, reported, strict=False)  # rest, and its STATUS, may be seen a slot later
    compared = [(a, b) for a, b in both if a is not None and b is not None]
    assert len(compared) >= 300
    for expected, given in compared:
        assert given == pytest.approx(expected, abs=1e-6)
    speeds = np.abs(np.diff([a[0] for a, _ in compared])) / PERIOD
    assert speeds.max() > 1.0  # 1 ms corresponds to 1 mrad


@pytest.mark.parametrize('at_once', [True, False])
def test_status_takes_the_first_slot_after_the_arm_has_come_to_rest(at_once):
    state = replace(SIMULATED.state, status_at_rest=at_once)
    harness = Harness(profile=replace(SIMULATED, state=state))
    peer = Peer()
    harness.controller.connect('state', peer)
    harness.send(point(0, (0.1,) * 6))
    rests, kinds = [], []
    for _ in range(200):
        harness.controller.step(PERIOD)
        rests.append(not harness.controller.in_motion)
        kinds.append([kind for kind, *_ in split(peer.take())])
    stop = next(n for n in range(1, 200) if rests[n] and not rests[n - 1])
    assert (kinds[stop] == [STATUS]) is at_once
    statuses = [n for n, slot in enumerate(kinds) if slot == [STATUS]]
    assert np.diff([n for n in statuses if n != stop or not at_once]).max() <= 11


def test_stalled_process_sends_only_the_newest_slots():
    delays = iter([0.0, 60.0])
    paced = Paced(lambda *_: next(delays))
    wakes = paced.wakes(30.0)
    next(wakes)
    frames, _ = next(wakes)
    assert len(frames) == MAX_CATCH_UP_SLOTS + 1


@pytest.mark.invariant(8)
@pytest.mark.parametrize(
    ('late', 'fault'),
    [
        pytest.param(late, fault, marks=[] if (late, fault) in QUICK else pytest.mark.slow)
        for late in LATE
        for fault in (None, *BURSTS)
    ],
)
def test_inv8_late_simulation_reports_correct_velocities(late, fault):
    """The driver's estimate is within 2 % of the highest speed of the slots."""
    paced = Paced(late, smooth=True, fault=fault)
    state = RobotState(6, rules=StateRules(PERIOD, LIMITS))
    path, velocities = [], []  # by slot
    paced.harness.send(point(0, (0.0,) * 6, 0.0, 0.1))
    sent = 1
    for frames, now in paced.wakes(12.0):
        while (
            sent < 60 and paced.harness.controller.program.ready and sent * 0.2 < now - BEGIN + 0.5
        ):
            at = 1.5 * np.sin(2.0 * sent * 0.2)
            paced.harness.send(point(sent, (at, *(0.3 * at,) * 5), 0.0, 0.2))
            sent += 1
        for kind, _, _, body in frames:
            if kind == JOINT_POSITION:
                sample = state.on_joints(struct.unpack('<i10f', body)[1:], now)
                path.append(joints(body)[0])
            else:
                sample = state.on_status(Status(), now)
                path.append(np.nan)
            velocities.append(np.nan if sample is None else sample.velocities[0])
    path, velocities = np.array(path), np.array(velocities)
    missing = np.isnan(path)
    path[missing] = np.interp(np.flatnonzero(missing), np.flatnonzero(~missing), path[~missing])
    speeds = np.diff(path) / PERIOD
    judged = 0
    for slot in range(20, len(path)):
        if not np.isnan(velocities[slot]):
            window = speeds[slot - 9 : slot]
            outside = max(window.min() - velocities[slot], velocities[slot] - window.max())
            assert outside < 0.02 * np.abs(speeds).max(), slot
            judged += 1
    assert judged > 1500
    assert np.abs(speeds).max() > 1.0
    assert state.bounded == 0


LONGEST = 0.1

DT = 0.004

SILENT = {'cut', 'half_open', 'reboot'}
"""Faults that silence the state port if they apply to it."""


class Watch:
    """A state client, and the longest time without a message."""

    def __init__(self, harness):
        self.harness, self.peer = harness, Peer()
        self.connection = harness.controller.connect('state', self.peer)
        self.silence = self.longest = 0.0

    def step(self, seconds):
        for _ in range(round(seconds / DT)):
            self.harness.step(DT)
            self.silence = 0.0 if self.peer.take() else self.silence + DT
            self.longest = max(self.longest, self.silence)


def new_moving_controller():
    harness = Harness(profile=SIMULATED)
    watch = Watch(harness)
    harness.send(point(0, (1.5, 0.5, 0.3)), point(1, ()))
    watch.step(0.1)
    assert harness.controller.in_motion
    return harness, watch


@pytest.mark.parametrize('name', [name for name in FAULTS if name != 'reboot'])
def test_state_messages_continue_through_faults(name):
    harness, watch = new_moving_controller()
    harness.controller.faults.start(parse(f'{name} port=motion' if name in SILENT else name))
    watch.step(2.0)
    harness.controller.faults.clear()
    watch.step(1.0)
    assert watch.longest < LONGEST


@pytest.mark.parametrize('name', sorted(SILENT))
def test_fault_that_silences_the_state_port_is_detected(name):
    _, watch = new_moving_controller()
    watch.harness.controller.faults.start(parse(name))
    watch.step(1.0)
    assert watch.longest > LONGEST
