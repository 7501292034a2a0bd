# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Faults, transports and a clock for tests, and a controller that records its calls."""

from epson_driver.sim_controller.clock import Clock
from epson_driver.sim_controller.faults.fault_kinds import parse
from epson_driver.sim_controller.faults.faults import Faults, FaultyTransport
from epson_driver.simple_message import (
    LITTLE_ENDIAN,
    JointPosition,
    Opaque,
    ReplyCode,
    encode,
    joint_data,
    reply,
    request,
    topic,
)

JOINTS = 6


def state(number, dialect=LITTLE_ENDIAN):
    """Return a JOINT_POSITION topic that is different for each number."""
    return encode(topic(JointPosition(0, joint_data([0.001 * number]))), dialect)


def answer(number, dialect=LITTLE_ENDIAN):
    """Return the reply to the point of this sequence."""
    return encode(reply(JointPosition(number, joint_data([])), ReplyCode.SUCCESS), dialect)


def ask(number):
    """Return a request of a client."""
    return encode(request(Opaque(11, bytes([number]) * 52)), LITTLE_ENDIAN)


class RecordedActions:
    """The controller's side of faults. It records its calls and their times."""

    def __init__(self, clock):
        self.clock = clock
        self.calls = []
        self.frozen = set()

    def freeze(self, joint):
        self.frozen = set() if joint is None else self.frozen | {joint}

    def servo_error(self, joint, critical=False):
        self.calls.append((self.clock.now, 'servo_error', joint, critical))

    def press_estop(self):
        self.calls.append((self.clock.now, 'press_estop'))

    def reboot(self, seconds):
        self.calls.append((self.clock.now, 'reboot', seconds))


class Client:
    """The peer of a transport: received segments with their times, and disconnections."""

    def __init__(self, harness, port):
        self.harness = harness
        self.segments = []
        self.hung_up = 0
        self.transport = FaultyTransport(
            port, harness.clock, harness.faults, self._take, self._end
        )

    def _take(self, data):
        self.segments.append((self.harness.clock.now, data))

    def _end(self):
        self.hung_up += 1

    def send(self, *messages):
        for message in messages:
            self.transport.send(message)

    def taken(self):
        """Return the segments since the last time, without their times."""
        segments, self.segments = [data for _, data in self.segments], []
        return segments

    def times(self):
        """Return when segments came since the last time, ms."""
        segments, self.segments = [round(1000 * time) for time, _ in self.segments], []
        return segments


class FaultHarness:
    """Faults on a manual clock, and clients as needed."""

    def __init__(self, seed=0):
        self.clock = Clock()
        self.actions = RecordedActions(self.clock)
        self.faults = Faults(self.clock, seed, self.actions, JOINTS)

    def client(self, port='state', **options):
        return Client(self, port, **options)

    def start(self, text):
        self.faults.start(parse(text))

    def clear(self, name=None):
        return self.faults.clear(name)

    def wait(self, seconds):
        self.clock.advance(self.clock.now + seconds)

    def stream(self, client, count, period=0.005):
        """Send `count` state messages, one per period, and return them."""
        messages = [state(number) for number in range(count)]
        for message in messages:
            client.send(message)
            self.wait(period)
        return messages
