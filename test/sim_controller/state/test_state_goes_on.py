# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The state port answers always: no silence of 100 ms of the controller's time, whatever happens.

Cut, silence and switching off are what their names say, on the state port: only there, and only
for as long as was asked for.
"""

import pytest
from support.controller_harness import RC620, Harness, Peer, point

from epson_driver.sim_controller.faults.fault_kinds import FAULTS
from epson_driver.sim_controller.faults.fault_text import parse

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
    harness = Harness(profile=RC620)
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
