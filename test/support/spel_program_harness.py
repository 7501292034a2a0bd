# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""SPEL+ programs on a simulated controller with a manual clock, and clients without sockets."""

import logging
import re
import struct
from textwrap import dedent
from typing import Any

import numpy as np

from epson_driver.profiles.profile import load_controller_profile
from epson_driver.sim_controller.assembly import (
    new_controller,
    profile_project,
    program_network,
)
from epson_driver.sim_controller.condition.states import Event
from epson_driver.sim_controller.spel_host.spel_program import SpelSource
from epson_driver.spel import build, with_defines
from support.controller_harness import MODEL, PROFILE, SUCCESS, Peer, point, split

SPEL_PROFILE = load_controller_profile('spel')
STEP_S = 0.002


class SpelProgramHarness:
    """A controller that runs `source`. It records the commanded positions."""

    def __init__(self, source, caplog=None, profile=PROFILE, model=MODEL, start=None, **files):
        files = {f'{name}.prg': dedent(text) for name, text in files.items()}
        program = build({'main.prg': dedent(source), **files})
        spel = SpelSource(program, program_network(profile))
        self._start(new_controller(model, profile, start, spel=spel), caplog)

    def _start(self, controller, caplog):
        self.controller, self.caplog = controller, caplog
        if caplog is not None:
            caplog.set_level(logging.INFO)
        self.positions = [self.position]

    def do(self, *events):
        for event in events:
            self.controller.apply(Event(event))

    def step(self, seconds):
        """Advance the time in motion cycles and record the commanded positions."""
        for _ in range(round(seconds / STEP_S)):
            self.controller.step(STEP_S)
            self.positions.append(self.position)

    def until(self, predicate, seconds=20.0):
        """Advance the time until a condition holds. Fail after `seconds`."""
        for _ in range(round(seconds / STEP_S)):
            if predicate():
                return
            self.step(STEP_S)
        raise AssertionError('the condition did not become true')

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
        """Return the printed lines without time and task."""
        result = (re.search(r' s task \d+ \w+: (.*)', message) for message in self.caplog.messages)
        return [item[1] for item in result if item]

    def client(self, port):
        """Connect, and return the connection and its peer."""
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

    def assert_within_limits(self):
        """Assert the velocity and acceleration limits of the joints for all cycles."""
        velocity, acceleration = self.within_limits()
        assert velocity <= 1.001
        assert acceleration <= 1.01


class OurProgramHarness(SpelProgramHarness):
    """A controller with controller_program/ in the profile `spel`, changed by `defines`."""

    def __init__(self, start=None, caplog=None, profile=SPEL_PROFILE, model=MODEL, **defines):
        files = with_defines(profile_project(profile, model), defines)
        key = (model.name, *sorted(defines.items()))
        if key not in _built:
            _built[key] = build(files)
        network = program_network(profile)
        start = None if start is None else np.array(start)
        source = SpelSource(_built[key], network)
        self._start(new_controller(model, profile, start, spel=source), caplog)

    def ready(self):
        """Switch motors on, connect a motion client, and return the connection and its peer."""
        self.step(0.5)
        self.do('motors on')
        motion, peer = self.client('motion')
        self.step(0.3)
        return motion, peer

    def replies(self, peer):
        """Return sequence and reply code of the replies to a motion client since the last call."""
        return [
            (struct.unpack_from('<i', body)[0], code) for _, _, code, body in split(peer.take())
        ]

    def stream(self, motion, peer, trajectory, most=60.0):
        """Send a trajectory like the driver, each point after the previous reply."""
        durations = np.diff(trajectory.times, prepend=trajectory.times[0]).tolist()
        for number, (joints, seconds) in enumerate(
            zip(trajectory.positions.tolist(), durations, strict=True)
        ):
            motion.receive(point(number, joints, 0.0, seconds))
            self.until(lambda: len(peer.got) >= 60, most)
            assert self.replies(peer) == [(number, SUCCESS)]

    def rest(self, most=60.0):
        """Advance the time until shortly after the arm has come to rest."""
        self.until(lambda: not self.controller.in_motion, most)
        self.step(0.1)


_built: dict[Any, Any] = {}
