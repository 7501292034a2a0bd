# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The simulated controller as tests drive it, its remote port included."""

import asyncio
import statistics
import struct
import time
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from epson_driver.motion.smoother import plan
from epson_driver.profiles.profile import load_controller_profile
from epson_driver.remote_ethernet.client import execute
from epson_driver.remote_ethernet.hand import action
from epson_driver.robots import load_robot_model
from epson_driver.sim_controller.assembly import new_controller
from epson_driver.sim_controller.condition.states import Event
from support.ros_peer import PATIENCE


class Remote:
    """A client of the remote port of the harness's controller."""

    def __init__(self, harness=None, login='Login'):
        self.harness = harness or Harness(motors=False)
        self.peer = Peer()
        self.connection = self.harness.controller.connect('remote', self.peer)
        if login:
            assert self(login) == '#Login,0'

    @property
    def controller(self):
        return self.harness.controller

    def __call__(self, command):
        """Return the one answer to a command, which is written without its `$`."""
        (answer,) = self.answers(f'${command}\r\n'.encode())
        return answer

    def answers(self, data):
        """Return the answers to bytes."""
        self.connection.receive(data)
        text = self.peer.take().decode()
        assert not text or text.endswith('\r\n')
        return text.split('\r\n')[:-1]


def do(port: int, *words: str) -> None:
    """Do it over the remote port. Raises RemoteError if the controller refuses."""
    command = action(' '.join(words)).commands[0]
    asyncio.run(execute('127.0.0.1', port, [command], PATIENCE))


MODEL = load_robot_model('c3_a601s')
SIMULATED = load_controller_profile('simulated')
PROFILE = replace(
    SIMULATED,
    motion=replace(SIMULATED.motion, statement_overhead=0.0),
    servo=replace(SIMULATED.servo, lag=0.0, encoder=False),
)
"""A profile without servo lag, encoder rounding and statement overhead."""

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
    """A planner that plans in the requesting step and answers `delay` s later."""

    def __init__(self, delay=0.0):
        self.ready = True
        self.delay = delay
        self.limits = []  # of each request
        self._pending = []

    def ask(self, request, limits, answer):
        assert self.ready
        assert not self._pending
        self.limits.append(limits)
        self._pending.append([self.delay, answer, self.plan(request, limits)])
        self.step(0.0)

    @property
    def asked(self):
        return len(self.limits)

    def plan(self, request, limits):
        return plan(request, limits)

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


class Peer:
    """The received bytes of a client, and how its connection was ended."""

    def __init__(self, local=True):
        self.local = local
        self.got = bytearray()
        self.ended = None

    def send(self, data):
        if self.ended is None:
            self.got += data

    def close(self):
        self.ended = self.ended or 'closed'

    def abort(self):
        self.ended = self.ended or 'aborted'

    def take(self):
        """Return the bytes since the last call."""
        data, self.got[:] = bytes(self.got), b''
        return data


class Harness:
    """A controller with one client. It moves smoothly if it has a planner, else point to point.

    motors: whether the motors are on at the start.
    """

    def __init__(
        self, start=None, motors=True, profile=PROFILE, connect=True, planner=None, model=MODEL
    ):
        start = None if start is None else np.array(start)
        self.planner = planner
        self.controller = new_controller(model, profile, start, planner=planner)
        self.peer = Peer()
        self.connection: Any = None
        if connect:
            self.connect()
        if motors:
            self.do('motors on')

    def do(self, *events):
        for event in events:
            self.controller.apply(Event(event))

    def connect(self):
        self.peer.ended = None
        self.connection = self.controller.connect('motion', self.peer)

    def disconnect(self):
        self.connection.closed()

    def remote(self, *commands):
        """Return the answers of the remote port to commands, after a login."""
        peer = Peer()
        connection = self.controller.connect('remote', peer)
        for command in ('Login', *commands):
            connection.receive(f'${command}\r\n'.encode())
        connection.closed()
        return peer.take().decode().split('\r\n')[1:-1]

    @property
    def condition(self):
        return self.controller.condition

    def send(self, *frames):
        for data in frames:
            self.connection.receive(data)

    def replies(self):
        """Return the replies since the last call."""
        data = self.peer.take()
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
        """Step until the arm is at rest, and return the time needed, s."""
        steps = 0
        while self.controller.in_motion:
            assert steps * dt < most
            self._step(dt)
            steps += 1
        return steps * dt

    def step(self, seconds, dt=0.004):
        for _ in range(round(seconds / dt)):
            self._step(dt)

    def run(self, most=60.0, dt=0.004):
        """Step until the arm is at rest, and return the joints before and after every step."""
        trace = [self.joints]
        while self.controller.in_motion:
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
        return np.array(
            self.controller.joint_position().joints[: len(self.controller.model.joint_names)]
        )

    @property
    def error(self):
        return self.controller.status().error_code


def assert_within_limits(path, dt=0.004, slack=1e-3):
    """Assert that joints sampled every `dt` s keep the limits, except for a fraction `slack`.

    Divided differences are means of the derivatives, so the limits apply to them too.
    """
    path = np.array(path)
    assert np.all(path >= LIMITS.position_min)
    assert np.all(path <= LIMITS.position_max)
    for order, limit in enumerate((LIMITS.velocity, LIMITS.acceleration, LIMITS.jerk), start=1):
        differences = np.abs(np.diff(path, order, axis=0)) / dt**order
        assert np.all(differences <= limit * (1.0 + slack)), f'derivative {order}'


def _measure(dense):
    """Return the costs of steps that plan nothing, in µs, while points stream in."""
    harness = Harness(planner=InlinePlanner(delay=0.012))
    sent, costs = 0, []
    while sent < 1500 * dense or harness.controller.in_motion:
        if sent < 1500 * dense:  # as the sockets do it, outside the cycle
            angle = 0.3 * np.sin(2.0 * sent / (100.0 * dense))
            harness.send(
                point(sent, [angle, angle / 2, -angle, angle, 0.0, 2 * angle], 0.0, 0.01 / dense)
            )
            sent += 1
        asked = harness.planner.asked
        start = time.perf_counter()
        harness.controller.step(0.004)
        harness.joints  # noqa: B018  as a state message
        cost = time.perf_counter() - start
        harness.planner.step(0.004)
        if harness.planner.asked == asked:
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
