# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""SPEL+ programs on a simulated controller with a manual clock, and clients without sockets."""

import re
from textwrap import dedent

import numpy as np

from epson_driver.sim_controller.assembly import SpelSource, new_controller, program_network
from epson_driver.sim_controller.condition.states import Event
from epson_driver.spel import build
from support.controller_harness import MODEL, PROFILE, Peer

STEP_S = 0.002
LIMITS = MODEL.limits


class ProgramBench:
    """A controller that runs `source`; the highest velocity and acceleration are kept."""

    def __init__(self, source, caplog=None, profile=PROFILE, **files):
        files = {f'{name}.prg': dedent(text) for name, text in files.items()}
        program = build({'main.prg': dedent(source), **files})
        spel = SpelSource(program, program_network(profile))
        self.controller = new_controller(MODEL, profile, spel=spel)
        self.caplog = caplog
        self.positions = [self.position]

    def do(self, *events):
        for event in events:
            self.controller.apply(Event(event))

    def step(self, seconds):
        """Let time pass in motion cycles; where the arm is commanded to be is kept for each."""
        for _ in range(round(seconds / STEP_S)):
            self.controller.step(STEP_S)
            self.positions.append(self.position)

    def until(self, predicate, seconds=20.0):
        """Let time pass until something is so; fail if it is not in `seconds`."""
        for _ in range(round(seconds / STEP_S)):
            if predicate():
                return
            self.step(STEP_S)
        raise AssertionError('it did not come')

    @property
    def position(self):
        return self.controller.arm.commanded.copy()

    @property
    def velocity(self):
        return self.controller.arm.executor.velocity

    @property
    def tasks(self):
        """Return `name state file:line` of each task."""
        return [f'{row.name} {row.state}' for row in self.controller.tasks()]

    @property
    def printed(self):
        """Return what was printed, line by line, without time and task."""
        found = (re.search(r' s task \d+ \w+: (.*)', each) for each in self.caplog.messages)
        return [each[1] for each in found if each]

    def client(self, port):
        """Connect; return the connection and its peer."""
        peer = Peer()
        connection = self.controller.connect(port, peer)
        return connection, peer

    def within_limits(self):
        """Return the largest share of velocity and acceleration limits that was used."""
        positions = np.array(self.positions)
        velocity = np.diff(positions, axis=0) / STEP_S
        acceleration = np.diff(velocity, axis=0) / STEP_S
        return (
            float(np.max(np.abs(velocity) / LIMITS.velocity)),
            float(np.max(np.abs(acceleration) / LIMITS.acceleration)),
        )
