# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The simulated RC800 with Real-time Motion Control, in virtual time without DDS."""

import itertools
import math
import struct
from dataclasses import replace

import numpy as np
import pytest

from epson_driver.profiles.profile import load_controller_profile
from epson_driver.robots import load_robot_model
from epson_driver.rtmc.conditions import Detail, Refusal
from epson_driver.rtmc.messages import (
    ECCENTRIC_DATA,
    JOINTS_DATA,
    MOVED_DATA,
    NUMBER_DATA,
    REPLY_DATA,
    TARGET_DATA,
    WEIGHT_DATA,
    OperationMode,
    Request,
    RtmcMessage,
    RtmcStatus,
    decode,
)
from epson_driver.sim_controller.assembly import new_controller
from epson_driver.sim_controller.condition.states import Event, Motors
from epson_driver.sim_controller.faults.fault_kinds import parse
from epson_driver.sim_controller.faults.faults import ANSWER_TIME_S
from epson_driver.sim_controller.rtmc_port import RtmcPort
from epson_driver.simple_message import IoType

REMOTE = load_controller_profile('remote')
PROFILE = replace(REMOTE, rtmc=replace(REMOTE.rtmc, port=7000))
CYCLE = PROFILE.rtmc.cycle
MODEL = load_robot_model('c8_c901s')
CLIENT, OTHER = 1, 2
NOTICES = (Request.STATUS_NOTICE, Request.JOINTS_NOTICE)


class Cell:
    """A controller, and a client that sends one request at a time."""

    def __init__(self, model=MODEL, profile=PROFILE):
        self.sent = []
        self.controller = new_controller(model, profile)
        self.polls = []
        self.port = RtmcPort(
            self.controller, lambda data: self.sent.append(decode(data)), self.polls.append
        )

    def send(self, number, low=0, data=b'\0', sender=CLIENT):
        """Return the reply, or None if there is none yet."""
        self.sent.clear()
        self.port.receive(sender, RtmcMessage(number, low, 0, data).encode())
        return self.replied()

    def replied(self):
        replies = [message for message in self.sent if message.number not in NOTICES]
        assert len(replies) <= 1
        for message in replies:
            if message.high and message.number in REPLY_DATA:
                assert len(message.data) == REPLY_DATA[message.number].size
        return replies[0] if replies else None

    def do(self, number, low=0, data=b'\0'):
        """Return the low word of a reply with success."""
        reply = self.send(number, low, data)
        assert (reply.number, reply.high) == (number, 1), reply
        return reply.low

    def refused(self, number, low=0, data=b'\0'):
        """Return the low word of a refusal."""
        reply = self.send(number, low, data)
        assert (reply.number, reply.high) == (number, 0), reply
        return reply.low

    def enable(self, buffer=10):
        self.do(Request.CONNECT, 1)
        self.do(Request.SET_BUFFER, buffer)
        assert self.do(Request.CHECK_MODEL, data=b'C8-C901S')
        self.do(Request.RESET)
        self.do(Request.SET_MOTORS, 1)
        self.do(Request.SET_POWER, 1)
        self.do(Request.SET_MODE, 1)
        return self

    def target(self, first=0.0, outputs=0):
        """Send a target of the first joint, rad, and return the reply or None."""
        return self.send(Request.MOVE, data=TARGET_DATA.pack(first, 0, 0, 0, 0, 0, outputs))

    def stream(self, positions):
        """Send targets as a client does: the next one after the reply."""
        for first in positions:
            reply = self.target(first)
            while reply is None:
                self.controller.step(CYCLE)
                reply = self.replied()
            if not reply.high:
                return reply
        return reply

    def rest(self, seconds=1.0):
        for _ in range(round(seconds / CYCLE)):
            self.controller.step(CYCLE)

    @property
    def status(self):
        return RtmcStatus.decode(self.send(Request.STATUS))


def sine(cycles=500, amplitude=0.05):
    """Return positions of a smooth motion from rest to rest, rad."""
    phase = np.linspace(0.0, 2.0 * math.pi, cycles)
    return (amplitude * (1.0 - np.cos(phase)) * np.sin(phase / 2) ** 2).tolist()


def test_session_of_the_genuine_client_moves_the_arm():
    cell = Cell().enable()
    positions = sine()
    largest = 0.0
    for first in [*positions, *[0.0] * 10]:
        reply = cell.stream([first])
        assert reply.high
        largest = max(largest, reply.values(MOVED_DATA)[1])
    assert largest == pytest.approx(max(positions), rel=0.02)
    assert cell.do(Request.SET_MODE, 0) == 0
    cell.do(Request.SET_MOTORS, 0)
    cell.rest()
    assert cell.controller.condition.motors is Motors.OFF
    cell.do(Request.CONNECT, 0)
    assert cell.send(Request.STATUS) is None


@pytest.mark.parametrize('size', [2, 5, 10])
def test_full_buffer_paces_the_client(size):
    cell = Cell().enable(size)
    replies = [cell.target() for _ in range(size + 1)]
    assert [reply is None for reply in replies] == [False] * size + [True]
    assert replies[0].values(MOVED_DATA)[0] == 0
    start = cell.controller.clock.now
    cell.controller.step(CYCLE)
    assert cell.replied().values(MOVED_DATA)[0] == 1
    cell.stream([0.0] * 100)
    assert cell.controller.clock.now - start == pytest.approx(101 * CYCLE, abs=1e-6)


@pytest.mark.invariant(9)
def test_messages_wait_only_while_the_buffer_is_full():
    cell = Cell().enable(2)
    cell.stream([0.0] * 2)
    cell.target()
    cell.polls.clear()
    for _ in range(3):  # the waiting target fills the buffer in the first cycle
        cell.controller.step(CYCLE)
    assert cell.polls == [True, True, False]
    cell.stream([0.0] * 3)
    cell.controller.step(CYCLE)
    assert cell.polls[-1]
    cell.controller.press_estop()
    assert not cell.polls[-1]


def test_late_simulation_makes_up_for_missed_cycles_and_loses_no_time():
    cell = Cell().enable(10)
    cell.stream([0.0] * 11)
    start = cell.controller.clock.now
    for index, first in enumerate(sine()):
        reply = cell.target(first)
        while reply is None:
            cell.controller.step((4 if index % 10 == 5 else 1) * CYCLE)
            reply = cell.replied()
    assert cell.controller.clock.now - start == pytest.approx(500 * CYCLE, abs=5 * CYCLE)
    assert cell.port.motion.ran_empty == 0


@pytest.mark.parametrize('late', [1, 4])
def test_empty_buffer_is_an_error_unless_the_machine_is_busy(late):
    cell = Cell().enable(10)
    cell.stream(sine()[:60])
    cell.controller.step(late * CYCLE)
    for _ in range(20):
        cell.controller.step(CYCLE)
    assert bool(cell.port.motion.ran_empty) == (late == 1)
    for _ in range(10):  # a delay while it waits does not prolong this
        cell.controller.step(4 * CYCLE)
    assert cell.port.motion.ran_empty


def test_very_late_simulation_waits_until_the_buffer_is_full():
    cell = Cell().enable(10)
    for first in sine()[:11]:
        cell.target(first)
    cell.controller.step(1.0)
    assert len(cell.port.motion.targets) == 5
    for _ in range(10):
        cell.controller.step(CYCLE)
    assert len(cell.port.motion.targets) == 5
    cell.stream(sine()[11:])
    assert cell.port.motion.ran_empty == 0


@pytest.mark.invariant(2)
@pytest.mark.parametrize(
    ('positions', 'cause'),
    [
        ([0.01], 'velocity'),
        ([0.0, 0.0003], 'acceleration'),
        ([math.nan], 'finite'),
        ([math.inf], 'finite'),
    ],
)
def test_target_beyond_a_limit_is_an_error_without_motion(positions, cause):
    cell = Cell().enable()
    reply = cell.stream(positions)
    cell.rest()
    assert cell.status.error == (4001 if cause == 'finite' else 5042)
    assert cell.controller.condition.motors is Motors.OFF
    assert not np.any(cell.controller.servo.position)
    assert cell.refused(Request.SET_MOTORS, 1) == Refusal.ERROR
    assert reply.high == (cause != 'finite')


@pytest.mark.invariant(2)
def test_target_outside_the_position_limits_is_an_error():
    cell = Cell()
    high = MODEL.limits.position_max[0]
    cell.enable()
    cell.controller.arm.executor.position = np.array([high, 0, 0, 0, 0, 0])
    cell.stream([high + 1e-6])
    cell.rest()
    assert cell.status.error == 5042
    assert cell.controller.arm.commanded[0] <= high


def accelerate(cell):
    """Stream until the arm moves fast, and keep the buffer full."""
    cell.stream(sine()[:150])
    assert abs(cell.port.motion.velocity[0]) > 0.1


def test_buffer_that_runs_empty_is_an_error_and_the_arm_brakes():
    cell = Cell().enable()
    accelerate(cell)
    cell.rest()
    assert cell.port.motion.ran_empty == 1
    assert cell.status.error == 5042
    assert cell.controller.condition.motors is Motors.OFF
    assert not cell.controller.in_motion


def test_buffer_may_be_empty_at_rest():
    cell = Cell().enable()
    cell.stream([*sine(), *[0.0] * 10])
    cell.rest()
    assert cell.status.error == 0
    assert cell.do(Request.MODE) == 1


STOPS = {
    'estop': (lambda cell: cell.press_estop(), Refusal.ESTOP),
    'door': (lambda cell: cell.apply(Event.DOOR_OPEN), Refusal.SAFEGUARD),
    'teach': (lambda cell: cell.apply(Event.MODE_MANUAL), Refusal.NOT_AUTO),
    'error': (lambda cell: cell.servo_error(0), Refusal.ERROR),
    'motors': (lambda cell: cell.apply(Event.MOTORS_OFF), Refusal.MOTION_MODE),
}


@pytest.mark.invariant(6)
@pytest.mark.parametrize('stop', STOPS)
def test_stop_ends_the_motion_mode_and_refuses_the_waiting_target(stop):
    act, reason = STOPS[stop]
    cell = Cell().enable()
    accelerate(cell)
    while cell.target(cell.port.motion.position[0]) is not None:
        pass
    cell.sent.clear()
    act(cell.controller)
    reply = cell.replied()
    assert (reply.high, reply.low) == (0, reason)
    places = []
    for _ in range(500):
        cell.controller.step(CYCLE)
        places.append(cell.controller.arm.commanded[0])
    speeds = np.diff(places) / CYCLE
    assert abs(speeds[-1]) == 0.0
    assert np.abs(np.diff(speeds) / CYCLE).max() <= 1.05 * MODEL.limits.acceleration[0]
    assert not cell.controller.condition.powered
    assert cell.target() is not None
    assert cell.sent[0].high == 0
    cell.rest()
    assert cell.controller.arm.commanded[0] == places[-1]


def test_pause_ends_the_motion_mode_without_an_error():
    simulated = load_controller_profile('simulated')
    cell = Cell(profile=replace(simulated, rtmc=PROFILE.rtmc)).enable()
    accelerate(cell)
    while cell.target(cell.port.motion.position[0]) is not None:
        pass
    cell.sent.clear()
    cell.controller.apply(Event.PAUSE)
    assert (cell.replied().high, cell.replied().low) == (0, Refusal.MOTION_MODE)
    cell.rest()
    assert not cell.controller.in_motion
    assert (cell.status.error, cell.do(Request.MODE)) == (0, 0)


def test_lost_client_brakes_and_switches_the_motors_off():
    cell = Cell().enable()
    accelerate(cell)
    cell.port.receive(OTHER, None)
    assert cell.port.enabled
    cell.port.receive(CLIENT, None)
    assert not cell.port.enabled
    cell.rest()
    assert cell.controller.condition.motors is Motors.OFF
    assert cell.send(Request.CONNECT, 1, sender=OTHER).high == 1


def test_second_client_is_not_answered():
    cell = Cell()
    assert cell.send(Request.STATUS) is None
    cell.do(Request.CONNECT, 1)
    assert cell.send(Request.CONNECT, 1, sender=OTHER) is None
    assert cell.send(Request.SET_MOTORS, 1, sender=OTHER) is None


def test_connection_needs_the_password():
    cell = Cell()
    assert cell.refused(Request.CONNECT, 1, b'wrong') == Detail.PASSWORD << 8
    assert cell.send(Request.STATUS) is None
    cell.do(Request.CONNECT, 1, b'')


def test_requests_are_refused_before_the_model_check_and_with_motors_off():
    cell = Cell()
    cell.do(Request.CONNECT, 1)
    assert cell.refused(Request.SET_MOTORS, 1) == Refusal.MODEL_NOT_CHECKED
    assert cell.do(Request.CHECK_MODEL, data=b'C4-A601S') == 0
    assert cell.refused(Request.SET_WEIGHT, data=WEIGHT_DATA.pack(1)) == Refusal.MODEL_NOT_CHECKED
    cell.do(Request.CHECK_MODEL, data=b'C8-C901S\0')
    assert cell.do(Request.MODEL_CHECKED) == 1
    assert cell.refused(Request.SET_MODE, 1) == Detail.MOTORS_OFF << 8
    assert cell.target().low == Refusal.MOTION_MODE
    assert cell.refused(1999) == 0
    assert cell.refused(Request.SET_BUFFER, 3) == 0
    assert cell.send(Request.MODEL).data == b'C8-C901S\0'


def test_motion_mode_is_refused_while_the_arm_brakes():
    cell = Cell().enable()
    accelerate(cell)
    cell.do(Request.SET_MODE, 0)
    assert cell.refused(Request.SET_MODE, 1) == Detail.DECELERATING << 8
    cell.rest()
    cell.do(Request.SET_MODE, 1)
    assert cell.stream([cell.controller.arm.commanded[0]] * 20).high


def test_payload_survives_a_reboot_and_formats_do_not():
    cell = Cell().enable()
    cell.do(Request.SET_MODE, 0)
    cell.do(Request.SET_WEIGHT, data=WEIGHT_DATA.pack(2.5))
    cell.do(Request.SET_INERTIA, 1, ECCENTRIC_DATA.pack(0.1, 30))
    cell.do(Request.SET_SEND_FORMAT, 1)
    for bad in (-1.0, math.nan, math.inf):
        assert cell.refused(Request.SET_WEIGHT, data=WEIGHT_DATA.pack(bad)) == 0
    cell.controller.reboot(0.1)
    assert cell.send(Request.WEIGHT) is None
    cell.rest(0.1)
    cell.do(Request.CONNECT, 1)
    assert cell.send(Request.WEIGHT).values(WEIGHT_DATA) == (2.5,)
    assert cell.send(Request.INERTIA, 1).data[:10] == ECCENTRIC_DATA.pack(0.1, 30)
    assert cell.do(Request.SEND_FORMAT) == 0
    assert cell.do(Request.MODEL_CHECKED) == 0


def test_notices_are_sent_at_each_change_and_periodically():
    cell = Cell()
    cell.do(Request.CONNECT, 1)
    cell.sent.clear()
    cell.rest(0.5)
    assert 4 <= len(cell.sent) <= 6
    cell.sent.clear()
    cell.controller.apply(Event.ESTOP_PRESS)
    assert RtmcStatus.decode(cell.sent[0]).estop
    cell.controller.apply(Event.MODE_MANUAL)
    kinds = [message.number for message in cell.sent]
    assert kinds[-1] == Request.JOINTS_NOTICE
    assert RtmcStatus.decode(cell.sent[-2]).mode is OperationMode.TEACH


def test_client_gets_the_text_of_an_error():
    cell = Cell()
    cell.do(Request.CONNECT, 1)
    data = cell.send(Request.MESSAGES, 5042).data
    size = len(data) - 4  # no warning
    assert data[:4] == struct.pack('<HH', 0, size)
    assert size > 2
    assert data.endswith(b'\0')
    assert cell.send(Request.MESSAGES).data == bytes(4)


def test_inputs_are_read_and_outputs_written():
    cell = Cell()
    io = cell.controller.io
    cell.do(Request.CONNECT, 1)
    cell.do(Request.SET_OUTPUTS, 3, b'\1')
    cell.do(Request.SET_OUTPUTS, 1 | 1 << 8, b'\x80')
    assert cell.send(Request.OUTPUTS, 2 << 8).values(NUMBER_DATA) == (0x8008,)
    io.set_input(IoType.DIGITAL_INPUT, 23, 1)
    assert cell.send(Request.INPUTS, 2 | 1 << 8).values(NUMBER_DATA) == (0x80,)
    assert cell.refused(Request.INPUTS, 3 << 8) == 0
    assert cell.refused(Request.OUTPUTS, 16) == 0
    cell.do(Request.SET_SEND_FORMAT, 1)
    cell.do(Request.SET_RECEIVE_FORMAT, 1)
    cell.enable()
    assert cell.target(outputs=0x1234).values(MOVED_DATA)[-1] == 1 << 23
    assert io.read_port(IoType.DIGITAL_OUTPUT, 0, 16) == 0x1234


def test_reset_with_pressed_estop_has_no_effect():
    cell = Cell()
    cell.do(Request.CONNECT, 1)
    cell.controller.apply(Event.ESTOP_PRESS)
    cell.do(Request.RESET)
    assert cell.status.estop
    cell.controller.apply(Event.ESTOP_RELEASE)
    cell.do(Request.RESET)
    assert not cell.status.estop


def test_scara_uses_millimetres():
    cell = Cell(load_robot_model('ls6_b602s'))
    cell.do(Request.CONNECT, 1)
    units = cell.controller.model.limits.units
    joint = units.index('m')
    metres = cell.controller.servo.position[joint]
    values = cell.send(Request.JOINTS).values(JOINTS_DATA)
    assert values[joint] == pytest.approx(1000.0 * metres)
    assert values[4:] == (0.0, 0.0)


@pytest.mark.invariant(1)
def test_command_window_cannot_move_the_arm_in_the_motion_mode():
    cell = Cell().enable()
    answers = []
    cell.controller.command_window.execute('Go XY(300, 0, 500, 0)', answers.append)
    for _ in itertools.repeat(None, 100):
        cell.controller.step(CYCLE)
    assert 'real-time motion' in str(answers[0])
    assert not np.any(cell.controller.arm.commanded)


@pytest.mark.parametrize('fault', ['cut for=1', 'half_open for=1', 'reboot for=1'])
def test_fault_of_the_link_silences_the_controller(fault):
    cell = Cell(profile=load_controller_profile('rtmc'))
    cell.enable()
    cell.controller.faults.start(parse(fault))
    cell.controller.step(ANSWER_TIME_S)
    assert cell.send(Request.STATUS) is None
    assert cell.send(Request.CONNECT, 1, sender=OTHER) is None
    cell.controller.step(1.0)
    cell.port.receive(CLIENT, None)
    cell.do(Request.CONNECT, 1)
    assert not cell.port.enabled


def test_delay_of_the_link_delays_replies():
    cell = Cell(profile=load_controller_profile('rtmc'))
    cell.do(Request.CONNECT, 1)
    cell.controller.faults.start(parse('delay seconds=0.05'))
    assert cell.send(Request.MODE) is None
    cell.controller.step(0.06)
    assert cell.replied().number == Request.MODE
