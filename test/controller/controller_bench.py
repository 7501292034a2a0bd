# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A controller on a manual clock with a motion client whose bytes are made with struct alone."""

import struct
from typing import NamedTuple

import numpy as np

from epson_driver.controller.core import Controller
from epson_driver.controller.profile import load_controller_profile
from epson_driver.robots import load_robot_model

MODEL = load_robot_model('c3_a601s')
PROFILE = load_controller_profile('rc620')
LIMITS = MODEL.limits
STOP = -4
SUCCESS, FAILURE = 1, 2


def frame(msg_type, comm_type, reply_code, body=b'', order='<'):
    return struct.pack(order + '4i', 12 + len(body), msg_type, comm_type, reply_code) + body


def point_body(sequence, joints=(), velocity=0.0, duration=0.0, order='<'):
    ten = [*joints, *[0.0] * (10 - len(joints))]
    return struct.pack(order + 'i12f', sequence, *ten, velocity, duration)


def point(sequence, joints=(), velocity=0.0, duration=0.0, comm_type=2, reply_code=0, order='<'):
    body = point_body(sequence, joints, velocity, duration, order)
    return frame(11, comm_type, reply_code, body, order)


class Reply(NamedTuple):
    msg_type: int
    comm_type: int
    reply_code: int
    sequence: int | None


def split(data, order='<'):
    """Return the frames in data as (msg_type, comm_type, reply_code, body)."""
    frames = []
    while data:
        length, *header = struct.unpack_from(order + '4i', data)
        assert len(data) >= length + 4
        frames.append((*header, data[16 : length + 4]))
        data = data[length + 4 :]
    return frames


class Bench:
    """A controller with one client; `motors` says whether they are on already."""

    def __init__(self, start=None, motors=True, profile=PROFILE, connect=True):
        self.controller = Controller(MODEL, profile, None if start is None else np.array(start))
        self.sent = bytearray()
        if connect:
            self.controller.connected(self.sent.extend)
        if motors:
            self.controller.motors_on()

    def send(self, *frames):
        for data in frames:
            self.controller.receive(data)

    def replies(self):
        """Return the replies since the last call."""
        data, self.sent[:] = bytes(self.sent), b''
        result = []
        for msg_type, comm_type, reply_code, body in split(data):
            sequence = struct.unpack_from('<i', body)[0] if len(body) == 44 else None
            assert len(body) != 44 or body[4:] == bytes(40)
            result.append(Reply(msg_type, comm_type, reply_code, sequence))
        return result

    def codes(self):
        """Return (sequence, reply code) of the replies since the last call."""
        return [(reply.sequence, reply.reply_code) for reply in self.replies()]

    def rest(self, dt=0.004, most=60.0):
        """Step until the arm stands; return the time it took, s."""
        steps = 0
        while self.controller.moving:
            assert steps * dt < most
            self.controller.step(dt)
            steps += 1
        return steps * dt

    def step(self, seconds, dt=0.004):
        for _ in range(round(seconds / dt)):
            self.controller.step(dt)

    @property
    def joints(self):
        return np.array(self.controller.joint_position().joints[: len(LIMITS.names)])

    @property
    def error(self):
        return self.controller.status().error_code
