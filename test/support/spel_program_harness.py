# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""SPEL+ programs on a simulated controller with a manual clock, and clients without sockets."""

import logging
import re
from textwrap import dedent
from typing import Any

import numpy as np

from epson_driver.profiles.profile import load_controller_profile
from epson_driver.share import share_path
from epson_driver.sim_controller.assembly import (
    new_controller,
    profile_project,
    program_network,
)
from epson_driver.sim_controller.condition.states import Event
from epson_driver.sim_controller.spel_host.spel_program import SpelSource
from epson_driver.simple_message import LITTLE_ENDIAN, Framer, Status, decode, encode
from epson_driver.spel import build, read_project, with_defines
from support.controller_harness import MODEL, PROFILE, SUCCESS, Peer, point

SPEL_PROFILE = load_controller_profile('spel')
OUR_FILES = read_project(share_path('controller_program'))
STEP_S = 0.002


class ProgramClient:
    """A client of one port."""

    def __init__(self, harness, port):
        self.harness = harness
        self.connection, self.peer = harness.client(port)
        self.send_bytes, self.raw = self.connection.receive, self.peer.take
        self.leave = self.connection.closed
        self._framer = Framer(LITTLE_ENDIAN.byte_order)

    @classmethod
    def connect(cls, harness, port):
        """Wait until the port is open, and connect."""
        harness.step(0.2)
        client = cls(harness, port)
        harness.step(0.1)
        return client

    @property
    def open(self):
        """Whether the program has kept the connection."""
        return self.peer.ended is None

    def send(self, *packets):
        self.send_bytes(b''.join(encode(packet, LITTLE_ENDIAN) for packet in packets))

    def frames(self):
        """Return the frames received since the last call."""
        self._framer.receive_data(self.raw())
        return list(iter(self._framer.next_frame, None))

    def packets(self):
        return [decode(frame) for frame in self.frames()]

    def status(self):
        """Return the next STATUS of the state port."""
        self.packets()
        self.harness.step(0.15)
        return next(item.message for item in self.packets() if isinstance(item.message, Status))

    def replies(self):
        """Return sequence and reply code of the replies to points since the last call."""
        return [(item.message.sequence, int(item.reply_code)) for item in self.packets()]

    def stream(self, *points, most=60.0):
        """Send points like the driver, each after the previous reply. Return the replies."""
        replies = []
        for data in points:
            self.send_bytes(data)
            self.harness.until(lambda: self.peer.got, most)
            replies += self.replies()
        return replies

    def execute(self, trajectory):
        """Send a trajectory, and assert that each point is accepted."""
        durations = np.diff(trajectory.times, prepend=trajectory.times[0]).tolist()
        ways = zip(trajectory.positions.tolist(), durations, strict=True)
        points = [point(number, joints, 0.0, time) for number, (joints, time) in enumerate(ways)]
        assert self.stream(*points) == [(number, SUCCESS) for number in range(len(points))]


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

    @property
    def now(self):
        """The controller's time, s."""
        return self.controller.clock.now

    def connect(self, port='motion'):
        return ProgramClient.connect(self, port)

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
        """Switch motors on, and connect a motion client."""
        self.step(0.1)
        self.do('motors on')
        return self.connect()

    def variable(self, name):
        """Return the value of a global variable of the program."""
        world = self.controller.program.machine.world
        names = [variable.name.lower() for variable in world.program.variables]
        return world.g[names.index(name)]

    def rest(self, most=60.0):
        """Advance the time until the arm is at rest without points."""
        self.step(0.3)
        program = self.variable
        self.until(
            lambda: not self.controller.in_motion and program('g_head') == program('g_tail'), most
        )
        self.step(0.1)


_built: dict[Any, Any] = {}
