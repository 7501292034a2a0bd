# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A motion program with an arm and a clock, without a controller."""

import struct
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np

from epson_driver.profiles.profile import load_controller_profile
from epson_driver.robots import load_robot_model
from epson_driver.sim_controller.arm.point_to_point import PointToPoint
from epson_driver.sim_controller.clock import Clock
from epson_driver.sim_controller.condition.errors import ErrorRegister
from epson_driver.sim_controller.programs.motion_program import MotionProgram
from epson_driver.simple_message import Dialect, Framer, encode

LIMITS = load_robot_model('c3_a601s').limits
HOME = (0.0,) * 6
THERE = (0.5, -0.4, 0.3, 0.2, -0.1, 1.0)
OUTSIDE = (3.2, 0.0, 0.0, 0.0, 0.0, 0.0)
TOPIC, REQUEST = 1, 2
SUCCESS, FAILURE = 1, 2


def frame(msg_type, comm_type=REQUEST, reply_code=0, body=b''):
    return struct.pack('<4i', 12 + len(body), msg_type, comm_type, reply_code) + body


def point(sequence, joints=(), comm_type=REQUEST, velocity=0.0, duration=0.0):
    ten = [*joints, *[0.0] * (10 - len(joints))]
    return frame(11, comm_type, 0, struct.pack('<i12f', sequence, *ten, velocity, duration))


def profile(name, **changes):
    """Return the program's profile of a controller, with other values."""
    return replace(load_controller_profile(name).program, **changes)


class ProgramHarness:
    """`name` is the controller's profile, and `changes` are other values of its program."""

    def __init__(self, name='simulated', pending_limit=1000, cp=False, **changes):
        self.profile = profile(name, **changes)
        whole = load_controller_profile(name)
        motion = replace(whole.motion, pending_limit=pending_limit, cp=cp)
        self.arm = self.make_arm(
            PointToPoint(
                LIMITS,
                np.zeros(6),
                replace(motion, speed=0.5, accel=0.5, statement_overhead=0.0),
                acknowledge=self.profile.acknowledge,
            )
        )
        self.clock = Clock()
        self.errors = ErrorRegister()
        self.blocked = None
        self.events: list[Any] = []
        self.sent = bytearray()
        self._framer = Framer()
        controller: Any = SimpleNamespace(
            arm=SimpleNamespace(executor=self.arm),
            profile=replace(whole, program=self.profile, motion=motion),
            dialect=Dialect(),
            errors=self.errors,
            clock=self.clock,
            motion_rejection=lambda: self.blocked,
            send_reply=lambda packet: self.sent.extend(encode(packet, Dialect())),
            trajectory_starts=lambda: self.began(),
            clients=SimpleNamespace(
                disconnect_after_flush=lambda port: self.events.append('hung up')
            ),
        )
        self.program = MotionProgram(controller)
        take = self.arm.take

        def record(taken):
            take(taken)
            self.events.append(taken.sequence)

        self.arm.take = record

    def make_arm(self, arm):
        """Return the program's arm. A test may wrap it."""
        return arm

    def began(self):
        """Record the start of a trajectory. A test may replace this."""
        self.events.append('began')

    def send(self, *frames):
        for data in frames:
            self._framer.receive_data(data)
        while (received := self._framer.next_frame()) is not None:
            self.program.receive(received)

    def take_sent(self):
        data, self.sent[:] = bytes(self.sent), b''
        return data

    def codes(self):
        """Return (sequence, reply code) of the replies since the last call."""
        data, codes = self.take_sent(), []
        while data:
            length, msg_type, comm_type, code, sequence = struct.unpack_from('<5i', data)
            assert (length, msg_type, comm_type) == (56, 10, 3)
            codes.append((sequence, code))
            data = data[length + 4 :]
        return codes

    def step(self, seconds, dt=0.004):
        """Advance the arm, then the timers, like the controller."""
        until = self.clock.now + seconds
        while self.clock.now < until - 1e-9:
            then = min(self.clock.now + dt, until)
            if self.arm.moving:  # like the controller
                self.program.step(then - self.clock.now)
            self.clock.advance(then)

    def rest(self, most=60.0):
        """Step until the arm is at rest, and return the time needed, s."""
        start = self.clock.now
        while self.arm.moving:
            assert self.clock.now < start + most
            self.step(0.004)
        return self.clock.now - start

    def pause(self):
        self.program.pause()
        self.arm.hold()

    def resume(self):
        self.arm.resume()
        self.program.resume()

    @property
    def error(self):
        return int(self.errors.number)

    @property
    def joints(self):
        return self.arm.position.tolist()


def rounded(joints):
    return np.float32(joints).tolist()
