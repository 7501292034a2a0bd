# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A controller on a manual clock with a motion client whose bytes are made with struct alone.

Run by hand, it measures what a motion cycle costs: `python test/controller/controller_bench.py`.
"""

import statistics
import struct
import time
from typing import NamedTuple

import numpy as np

from epson_driver.controller.core import Controller
from epson_driver.controller.profile import load_controller_profile
from epson_driver.motion.smoother import plan
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


class InlinePlanner:
    """Plans at once, in the step that asks, and answers `delay` s later on the bench's clock."""

    def __init__(self, delay=0.0):
        self.ready = True
        self.delay = delay
        self.asked = 0
        self._pending = []

    def ask(self, request, answer):
        assert self.ready
        assert not self._pending
        self.asked += 1
        self._pending.append([self.delay, answer, self.plan(request)])
        self.step(0.0)

    def plan(self, request):
        return plan(request, LIMITS)

    def step(self, dt):
        for waiting in list(self._pending):
            waiting[0] -= dt
            if waiting[0] <= 1e-9:
                self._pending.remove(waiting)
                waiting[1](waiting[2])

    def die(self):
        """End as the planner's process does: no plan, no more questions."""
        self.ready = False
        pending, self._pending = self._pending, []
        for _, answer, _ in pending:
            answer(None)


class Bench:
    """A controller with one client; `motors` says whether they are on already.

    Point to point, or smooth with a planner.
    """

    def __init__(self, start=None, motors=True, profile=PROFILE, connect=True, planner=None):
        start = None if start is None else np.array(start)
        self.planner = planner
        self.controller = Controller(MODEL, profile, start, planner=planner)
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
            self._step(dt)
            steps += 1
        return steps * dt

    def step(self, seconds, dt=0.004):
        for _ in range(round(seconds / dt)):
            self._step(dt)

    def run(self, most=60.0, dt=0.004):
        """Step until the arm stands; return the joints before and after every step."""
        trace = [self.joints]
        while self.controller.moving:
            assert len(trace) * dt < most
            self._step(dt)
            trace.append(self.joints)
        return np.array(trace)

    def _step(self, dt):
        self.controller.step(dt)
        if self.planner is not None:
            self.planner.step(dt)

    @property
    def joints(self):
        return np.array(self.controller.joint_position().joints[: len(LIMITS.names)])

    @property
    def error(self):
        return self.controller.status().error_code


def _measure(dense):
    """Return the costs of steps that plan nothing, in µs, while points stream in."""
    bench = Bench(planner=InlinePlanner(delay=0.012))
    sent, costs = 0, []
    while sent < 1500 * dense or bench.controller.moving:
        if sent < 1500 * dense:  # as the sockets do it, outside the cycle
            angle = 0.3 * np.sin(2.0 * sent / (100.0 * dense))
            bench.send(
                point(sent, [angle, angle / 2, -angle, angle, 0.0, 2 * angle], 0.0, 0.01 / dense)
            )
            sent += 1
        asked = bench.planner.asked
        begin = time.perf_counter()
        bench.controller.step(0.004)
        bench.joints  # noqa: B018  as a state message
        cost = time.perf_counter() - begin
        bench.planner.step(0.004)
        if bench.planner.asked == asked:
            costs.append(cost * 1e6)
    return costs


if __name__ == '__main__':
    for dense in (1, 3):
        costs = _measure(dense)
        cuts = statistics.quantiles(costs, n=1000)
        print(
            f'points of {10 / dense:.1f} ms: {len(costs)} steps, median {cuts[499]:.0f} µs, '
            f'p99 {cuts[989]:.0f} µs, p99.9 {cuts[998]:.0f} µs, largest {max(costs):.0f} µs '
            f'(10 % of the cycle: 400 µs)'
        )
