# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Defects of the past are put back one by one: the simulation must find each."""

import asyncio
import contextlib

import pytest
from support.examples import one_in

from epson_driver.driver.driver import Driver
from epson_driver.driver.goal.goal_queue import GoalQueue
from epson_driver.driver.servo import restart_interlock
from epson_driver.driver.servo.restart_interlock import RestartInterlock
from epson_driver.driver.stopping.arm_gate import ArmGate
from epson_driver.driver.stopping.heartbeat import Heartbeat
from epson_driver.driver.stopping.stopper import Stopper
from simulation.events import events_of
from simulation.oracles import BrokenError
from simulation.world import World

SEEDS = 60
"""How many worlds may be needed to find one."""


def a_held_stream_is_followed_at_once(patch):
    patch.setattr(restart_interlock, 'RELEASE_S', 0.0)


def a_zero_releases_a_stopped_stream(patch):
    hear = RestartInterlock.hear

    def released(self, source, setpoint, came, *, missed):
        asks = hear(self, source, setpoint, came, missed=missed)
        if not asks:
            self._topics[source].released = True
        return asks

    patch.setattr(RestartInterlock, 'hear', released)


def a_stop_blocks_no_stream(patch):
    patch.setattr(RestartInterlock, 'trip', lambda self, now: None)
    patch.setattr(RestartInterlock, 'block', lambda self, source: None)
    patch.setattr(RestartInterlock, 'permits', lambda self, source: True)


def a_goal_goes_on_after_an_estop(patch):
    patch.setattr(GoalQueue, 'fault', lambda self, why: None)
    patch.setattr(ArmGate, 'close', lambda self, reason, **_: False)


def stop_is_not_sent(patch):
    patch.setattr(Stopper, 'stop', lambda self: None)


def a_goal_ends_twice(patch):
    end = GoalQueue._end_unstarted

    def twice(self, handle, why, *rest):
        end(self, handle, why, *rest)
        handle.on_end(handle.outcome)

    patch.setattr(GoalQueue, '_end_unstarted', twice)


def old_joints_are_published(patch):
    take = Driver._on_state_packet
    kept = []

    def late(self, packet):
        kept.append(packet)
        take(self, kept[0] if len(kept) > 2000 else packet)

    patch.setattr(Driver, '_on_state_packet', late)


def no_heartbeat_is_sent(patch):
    async def never(self):
        await asyncio.Event().wait()

    patch.setattr(Heartbeat, 'run', never)


def a_stop_is_not_answered(patch):
    async def never(self):
        await asyncio.Event().wait()

    patch.setattr('epson_driver.driver.arm_commands.ArmCommands.stop', never)


DEFECTS = [
    a_stop_is_not_answered,
    a_held_stream_is_followed_at_once,
    a_zero_releases_a_stopped_stream,
    a_goal_ends_twice,
    a_stop_blocks_no_stream,
    a_goal_goes_on_after_an_estop,
    stop_is_not_sent,
    old_joints_are_published,
    no_heartbeat_is_sent,
]


def first_found(seeds):
    for seed in seeds:
        with contextlib.suppress(BrokenError):
            World(seed).play(events_of(seed))
            continue
        return seed
    return None


@pytest.mark.parametrize('defect', one_in(3, DEFECTS))
def test_an_old_defect_is_found(defect, monkeypatch):
    defect(monkeypatch)
    assert first_found(str(seed) for seed in range(1, SEEDS)) is not None
