# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""SPEL+ programs on a simulated controller with a manual clock, and clients without sockets."""

import re
import struct
from textwrap import dedent
from typing import Any

import numpy as np

from epson_driver.profiles.profile import load_controller_profile
from epson_driver.sim_controller.assembly import (
    SpelSource,
    new_controller,
    profile_project,
    program_network,
)
from epson_driver.sim_controller.condition.states import Event
from epson_driver.spel import build, with_defines
from support.controller_harness import MODEL, PROFILE, SUCCESS, Peer, point, split

SPEL_PROFILE = load_controller_profile('spel')
STEP_S = 0.002


class SpelProgramHarness:
    """A controller that runs `source`; the highest velocity and acceleration are kept."""

    def __init__(self, source, caplog=None, profile=PROFILE, model=MODEL, start=None, **files):
        files = {f'{name}.prg': dedent(text) for name, text in files.items()}
        program = build({'main.prg': dedent(source), **files})
        spel = SpelSource(program, program_network(profile))
        self.controller = new_controller(model, profile, start, spel=spel)
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
        limits = self.controller.model.limits
        positions = np.array(self.positions)
        velocity = np.diff(positions, axis=0) / STEP_S
        acceleration = np.diff(velocity, axis=0) / STEP_S
        return (
            float(np.max(np.abs(velocity) / limits.velocity)),
            float(np.max(np.abs(acceleration) / limits.acceleration)),
        )


class OurProgramHarness(SpelProgramHarness):
    """The same with controller_program/, as the profile `spel` has it; `defines` change it."""

    def __init__(self, start=None, caplog=None, profile=SPEL_PROFILE, model=MODEL, **defines):
        files = with_defines(profile_project(profile.spel, model), defines)
        key = (model.name, *sorted(defines.items()))
        if key not in _built:
            _built[key] = build(files)
        network = program_network(profile)
        start = None if start is None else np.array(start)
        source = SpelSource(_built[key], network)
        self.controller = new_controller(model, profile, start, spel=source)
        self.caplog = caplog
        self.positions = [self.position]

    def ready(self):
        """Motors on and main running, a motion client connected; return connection and peer."""
        self.step(0.5)
        self.do('motors on')
        motion, peer = self.client('motion')
        self.step(0.3)
        return motion, peer

    def replies(self, peer):
        """Return sequence and reply code of what a motion client has got since the last call."""
        return [
            (struct.unpack_from('<i', body)[0], code) for _, _, code, body in split(peer.take())
        ]

    def stream(self, motion, peer, trajectory, most=60.0):
        """Send a trajectory as a driver does, each point when the one before is answered."""
        durations = np.diff(trajectory.times, prepend=trajectory.times[0]).tolist()
        for number, (joints, seconds) in enumerate(
            zip(trajectory.positions.tolist(), durations, strict=True)
        ):
            motion.receive(point(number, joints, 0.0, seconds))
            self.until(lambda: len(peer.got) >= 60, most)
            assert self.replies(peer) == [(number, SUCCESS)]

    def rest(self, most=60.0):
        """Let time pass until the arm stands, and a little more."""
        self.until(lambda: not self.controller.in_motion, most)
        self.step(0.1)


_built: dict[Any, Any] = {}
