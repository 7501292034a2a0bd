# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""State messages come at their slot, and go on whatever the motion does."""

import random
import struct

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
JOINT_POSITION = 10
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
"""What is tested in `make test` as well."""


class Paced:
    """A controller that a pacer steps, which is woken `late(now, chance)` s after it should be.

    Time is a number here: nothing waits.
    """

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
        """Yield the frames that came with each waking, and when that was."""
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
    """Return the joints of each slot, None where it was a STATUS."""
    return [
        joints(body) if kind == JOINT_POSITION else None
        for frames, _ in paced.wakes(seconds)
        for kind, _, _, body in frames
    ]


@pytest.mark.parametrize('late', LATE[1:])
def test_each_message_has_the_joints_of_its_slots_time(late):
    found = []
    for how_late in (on_time, late):
        paced = Paced(how_late)
        paced.harness.send(point(0, AWAY), point(1, (0.0,) * 6))
        found.append(slots(paced, 2.0))
    exact, told = found
    compared = [(a, b) for a, b in zip(exact, told, strict=False) if a is not None]
    assert len(compared) >= 300
    for expected, given in compared:
        assert given == pytest.approx(expected, abs=1e-6)
    speeds = np.abs(np.diff([a[0] for a, _ in compared])) / PERIOD
    assert speeds.max() > 1.0  # it moved: 1 ms would have been 1 mrad


def test_a_process_that_stood_still_for_long_makes_up_for_the_newest_slots_only():
    stood = iter([0.0, 60.0])
    paced = Paced(lambda *_: next(stood))
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
def test_inv8_velocities_of_a_simulation_that_is_late_are_those_of_its_motion(late, fault):
    """docs/invariants.md, 8: the driver's own estimate is within 2 % of the motion's fastest.

    The motion is what the slots say; that they tell the truth is tested above.
    """
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
"""Faults that silence the state port if they act on it."""


class Watch:
    """A state client, and how long it heard nothing."""

    def __init__(self, harness):
        self.harness, self.peer = harness, Peer()
        self.connection = harness.controller.connect('state', self.peer)
        self.silence = self.longest = 0.0

    def step(self, seconds):
        for _ in range(round(seconds / DT)):
            self.harness.step(DT)
            self.silence = 0.0 if self.peer.take() else self.silence + DT
            self.longest = max(self.longest, self.silence)


def moving_and_watched():
    harness = Harness(profile=SIMULATED)
    watch = Watch(harness)
    harness.send(point(0, (1.5, 0.5, 0.3)), point(1, ()))
    watch.step(0.1)
    assert harness.controller.in_motion
    return harness, watch


@pytest.mark.parametrize('name', [name for name in FAULTS if name != 'reboot'])
def test_through_every_fault_that_leaves_the_link_up(name):
    harness, watch = moving_and_watched()
    harness.controller.faults.start(parse(f'{name} port=motion' if name in SILENT else name))
    watch.step(2.0)
    harness.controller.faults.clear()
    watch.step(1.0)
    assert watch.longest < LONGEST


@pytest.mark.parametrize('name', sorted(SILENT))
def test_what_silences_the_state_port_is_noticed_here(name):
    _, watch = moving_and_watched()
    watch.harness.controller.faults.start(parse(name))
    watch.step(1.0)
    assert watch.longest > LONGEST


@pytest.mark.parametrize(
    'events',
    [
        ('E-stop press', 'E-stop release', 'reset', 'motors on'),
        ('door open', 'door close', 'continue'),
        ('pause', 'continue'),
        ('stop', 'start'),
        ('motors off', 'motors on'),
        ('mode manual', 'mode auto', 'motors on'),
        ('error', 'reset', 'motors on'),
        ('critical error',),
        ('power low', 'power high'),
    ],
    ids=lambda events: events[0],
)
def test_through_everything_that_a_person_does(events):
    harness, watch = moving_and_watched()
    for event in events:
        harness.do(event)
        watch.step(0.5)
    harness.disconnect()
    watch.step(0.5)
    assert watch.longest < LONGEST
