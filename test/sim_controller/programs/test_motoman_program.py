# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Motoman's program with a simple arm. The client's bytes are built with struct."""

import math
import struct
from collections import deque
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.examples import examples

from epson_driver.motion import JointLimits
from epson_driver.sim_controller.condition.errors import ErrorNumber, ErrorRegister, Rejection
from epson_driver.sim_controller.condition.states import (
    Condition,
    Event,
    Motors,
    RejectedError,
    Tasks,
    after,
)
from epson_driver.sim_controller.programs.motoman_program import MotomanProgram
from epson_driver.simple_message import LITTLE_ENDIAN, Framer, encode

NAN, INF = math.nan, math.inf
LIMITS = JointLimits(
    ('joint_1', 'joint_2'),
    np.array([-2.0, -1.0]),
    np.array([2.0, 1.0]),
    np.array([3.3, 1.0]),
    np.array([10.0, 10.0]),
    np.array([100.0, 100.0]),
)
READY, COUNT, STOP = 200101, 200102, 200111
SERVO_ON, SERVO_OFF, RESET = 200112, 200113, 200114
START, END, DISCONNECT = 200121, 200122, 200130
SUCCESS, BUSY, FAILURE, INVALID, NOT_READY = 0, 1, 2, 3, 5


class Arm:
    """An arm that goes to each point in its duration, and has room for `room` points."""

    limits = LIMITS
    low_power = False
    done = True

    def __init__(self, room=1):
        self.position = np.zeros(2)
        self.room = room
        self.taken = []
        self.ahead = deque()
        self.left = 0.0
        self.braking = self.held = False

    @property
    def velocity(self):
        return np.zeros(2)

    @property
    def moving(self):
        return bool(self.ahead) or self.braking

    @property
    def still(self):
        return self.held or not self.moving

    @property
    def has_room(self):
        return len(self.ahead) < self.room and not self.braking

    def take(self, point):
        assert self.has_room
        assert not self.held
        self.taken.append(point)
        self.ahead.append(point)
        if len(self.ahead) == 1:
            self.left = point.duration

    def stop(self):
        lost = bool(self.ahead)
        self.braking = self.braking or lost
        self.ahead.clear()
        self.held = False
        return lost

    def hold(self):
        self.held = True

    def resume(self):
        self.held = False

    def settle(self, position):
        self.position = position

    def step(self, dt):
        if self.braking:  # it takes one step
            self.braking = False
            return dt
        if not self.ahead or self.held:
            return None
        self.left -= dt
        if self.left > 1e-9:
            return None
        self.position = self.ahead.popleft().target
        rest = max(-self.left, 0.0)
        self.left = self.ahead[0].duration if self.ahead else 0.0
        return rest


class Harness:
    """The program, an arm, and a condition that obeys the controller's tables."""

    def __init__(self, room=1, pending_limit=1, start=True):
        self.condition = Condition()
        self.errors = ErrorRegister()
        self.arm = Arm(room)
        self.planner_ready = True
        self.begun = self.hung_up = 0
        self.sent = bytearray()
        motion = SimpleNamespace(pending_limit=pending_limit)
        self.profile = SimpleNamespace(motion=motion)
        self.clients = SimpleNamespace(hang_up=self._hang_up)
        self.arm.executor = self.arm
        self.program = MotomanProgram(self)
        if start:
            assert self.command(START) == (SUCCESS, 0)

    def apply(self, event):
        before = self.condition
        self.condition = after(before, event)
        if self.condition.motors in (Motors.OFF, Motors.BRAKING) and before.motors is Motors.ON:
            self.program.abort()
        if self.condition.paused:
            self.program.pause()
            self.arm.hold()
        elif before.paused:
            self.arm.resume()
            self.program.resume()

    def motion_rejection(self):
        if not self.planner_ready:
            return Rejection(ErrorNumber.PLANNER_FAILED, 'no planner')
        if self.condition.motors is not Motors.ON or self.condition.estopped:
            return Rejection(ErrorNumber.MOTORS_OFF, 'motors off')
        return None

    def trajectory_starts(self):
        self.begun += 1

    def send_reply(self, packet):
        self.sent.extend(encode(packet, LITTLE_ENDIAN))

    def _hang_up(self, _port):
        self.hung_up += 1

    def send(self, data):
        framer = Framer()
        framer.receive_data(data)
        while (frame := framer.next_frame()) is not None:
            self.program.receive(frame)

    def replies(self):
        """Return robot_id, sequence, command, result, subcode of each MOTION_REPLY sent."""
        data, self.sent[:] = bytes(self.sent), b''
        result = []
        while data:
            length, *header = struct.unpack_from('<4i', data)
            assert (length, *header) == (72, 2002, 3, 1)  # the header always contains SUCCESS
            assert data[36:76] == bytes(40)
            result.append(struct.unpack_from('<5i', data, 16))
            data = data[76:]
        return result

    def command(self, code, robot_id=0, sequence=7):
        self.send(command(code, robot_id, sequence))
        ((*echo, result, subcode),) = self.replies()
        assert echo == [robot_id, sequence, code]
        return result, subcode

    def point(self, sequence, *args, **kwargs):
        self.send(point(sequence, *args, **kwargs))
        ((_, echo, what, result, subcode),) = self.replies()
        assert (echo, what) == (sequence, 14)
        return result, subcode

    def run(self, seconds, dt=0.01):
        for _ in range(round(seconds / dt)):
            self.program.step(dt)

    @property
    def targets(self):
        return [point.target.tolist() for point in self.arm.taken]


def frame(msg_type, comm_type, reply_code, body=b''):
    return struct.pack('<4i', 12 + len(body), msg_type, comm_type, reply_code) + body


def command(code, robot_id=0, sequence=7, comm_type=2):
    return frame(2001, comm_type, 0, struct.pack('<3i10f', robot_id, sequence, code, *[0.0] * 10))


def padded(values):
    return [*values, *[0.0] * (10 - len(values))]


def point(sequence, at=(), time=0.0, velocity=(), robot_id=0, fields=7, acc=(), comm_type=2):
    body = struct.pack('<3if', robot_id, sequence, fields, time)
    body += struct.pack('<30f', *padded(at), *padded(velocity), *padded(acc))
    return frame(14, comm_type, 0, body)


def exact(*angles):
    return [float(np.float32(angle)) for angle in angles]


# ---- points


def test_trajectory_is_executed_at_its_times():
    harness = Harness(room=5)
    assert harness.point(0) == (SUCCESS, 0)
    assert (harness.begun, harness.arm.taken) == (1, [])  # point 0 moves nothing
    assert harness.point(1, (0.5, 0.25), 0.5, (1.0, 0.5)) == (SUCCESS, 0)
    assert harness.point(2, (1.0, 0.5), 0.75) == (SUCCESS, 0)
    assert harness.targets == [[0.5, 0.25], [1.0, 0.5]]
    assert [(taken.sequence, taken.velocity, taken.duration) for taken in harness.arm.taken] == [
        (1, 0.0, 0.5),
        (2, 0.0, 0.25),
    ]
    harness.run(0.5)
    assert harness.arm.position.tolist() == [0.5, 0.25]
    harness.run(0.25)
    assert harness.arm.position.tolist() == [1.0, 0.5]
    assert harness.begun == 1
    assert len(harness.arm.taken) == 2
    assert harness.errors.number == 0


def test_busy_point_may_be_sent_again():
    harness = Harness(room=1, pending_limit=1)
    harness.point(0)
    assert harness.point(1, (0.1,), 0.125) == (SUCCESS, 0)  # the arm has it
    assert harness.point(2, (0.2,), 0.25) == (SUCCESS, 0)  # it waits
    assert harness.command(COUNT) == (SUCCESS, 2)
    assert len(harness.arm.taken) == 1  # the waiting point is not started
    for _ in range(3):
        assert harness.point(3, (0.3,), 0.375) == (BUSY, 0)
    assert harness.point(4, (0.4,), 0.5) == (INVALID, 3005)
    harness.run(0.13)
    assert harness.point(3, (0.3,), 0.375) == (SUCCESS, 0)
    harness.run(0.3)
    assert len(harness.arm.taken) == 3
    assert harness.targets == [exact(0.1, 0.0), exact(0.2, 0.0), exact(0.3, 0.0)]
    assert harness.command(COUNT) == (SUCCESS, 0)


@pytest.mark.parametrize('off', [0.0, 4.9e-4, -4.9e-4])
def test_point_0_may_deviate_by_the_encoder_tolerance(off):
    harness = Harness()
    harness.arm.position = np.array([0.7, 0.3])
    assert harness.point(0, (0.7 + off, 0.3)) == (SUCCESS, 0)
    assert not harness.arm.moving


@pytest.mark.parametrize(
    ('at', 'words'),
    [
        ((0.7006, 0.3), 'joint_1 = 0.7006 rad, but it is at 0.7 rad, more than 0.0005 rad'),
        ((0.7, 0.2994), 'joint_2 = 0.2994 rad, but it is at 0.3 rad'),
        ((), 'joint_1 = 0 rad, but it is at 0.7 rad'),
    ],
)
def test_point_0_elsewhere_is_invalid(at, words, caplog):
    harness = Harness()
    harness.arm.position = np.array([0.7, 0.3])
    assert harness.point(0, at) == (INVALID, 3011)
    assert words in caplog.text
    assert harness.point(1, (0.7, 0.3), 1.0) == (INVALID, 3005)
    assert (harness.begun, harness.arm.taken) == (0, [])


def test_point_0_in_motion_is_invalid():
    harness = Harness()
    harness.point(0)
    harness.point(1, (0.5,), 1.0)
    assert harness.point(0) == (INVALID, 3011)
    assert harness.point(2, (0.5,), 2.0) == (SUCCESS, 0)  # the trajectory continues


FLOAT32_ABOVE = float(np.nextafter(np.float32(3.3), np.float32(4.0)))

WRONG = {
    'group': ({'robot_id': 1}, 3004, 'robot_id = 1: must be 0'),
    'group of all': ({'robot_id': -1}, 3004, 'robot_id = -1'),
    'no fields': ({'fields': 0}, 3015, 'valid_fields = 0: without time, position, velocity'),
    'no time': ({'fields': 6}, 3015, 'valid_fields = 6: without time'),
    'no position': ({'fields': 5}, 3015, 'valid_fields = 5: without position'),
    'no velocity': ({'fields': 3 | 8}, 3015, 'valid_fields = 11: without velocity'),
    'time nan': ({'time': NAN}, 3016, 'time = nan s: must be from 0 to below 14400 s'),
    'time inf': ({'time': INF}, 3016, 'time = inf s'),
    'time negative': ({'time': -0.5}, 3016, 'time = -0.5 s'),
    'time too long': ({'time': 14400.0}, 3016, 'time = 14400 s'),
    'time again': (
        {'time': 1.0},
        3016,
        'time = 1 s: must be later than 1 s of the previous point',
    ),
    'time back': ({'time': 0.5}, 3016, 'time = 0.5 s: must be later than 1 s'),
    'position nan': ({'at': (NAN,)}, 3012, 'positions[0] = nan is not finite'),
    'unused position nan': ({'at': (0,) * 9 + (NAN,)}, 3012, 'positions[9] = nan'),
    'position inf': ({'at': (0, -INF)}, 3012, 'positions[1] = -inf'),
    'above a limit': (
        {'at': (0, 1.01)},
        3012,
        'joint_2 = 1.01 rad is outside the limits -1 … 1 rad',
    ),
    'below a limit': ({'at': (-2.01,)}, 3012, 'joint_1 = -2.01 rad is outside the limits'),
    'velocity nan': ({'velocity': (NAN,)}, 3013, 'velocities[0] = nan is not finite'),
    'velocity inf': ({'velocity': (INF,)}, 3013, 'velocities[0] = inf is not finite'),
    'too fast': (
        {'velocity': (0, 1.01)},
        3013,
        'joint_2: 1.01 rad/s is above the limit, 1 rad/s',
    ),
    'too fast backwards': ({'velocity': (0, -1.01)}, 3013, 'joint_2: -1.01 rad/s is above'),
    'too fast by a digit': ({'velocity': (FLOAT32_ABOVE,)}, 3013, 'joint_1: 3.3'),
    'acceleration nan': ({'fields': 15, 'acc': (NAN,)}, 3014, 'accelerations[0] = nan'),
}


@pytest.mark.parametrize(('change', 'subcode', 'words'), WRONG.values(), ids=WRONG)
def test_invalid_point_may_be_followed_by_a_valid_one(change, subcode, words, caplog):
    harness = Harness(room=5)
    harness.point(0)
    harness.point(1, (0.5,), 1.0)
    assert harness.point(2, **{'at': (0.1,), 'time': 2.0, **change}) == (INVALID, subcode)
    assert words in caplog.text
    assert harness.errors.number == 0
    assert len(harness.arm.taken) == 1
    assert harness.arm.moving  # INVALID does not stop the points before it
    assert harness.point(2, (0.1,), 2.0) == (SUCCESS, 0)


@pytest.mark.parametrize('sequence', [-4, -1, 0, 1, 2, 4, 5])
def test_point_out_of_sequence_is_invalid(sequence):
    harness = Harness(room=5)
    for number in range(3):
        assert harness.point(number, (0.1 * number,), number) == (SUCCESS, 0)
    subcode = 3011 if sequence == 0 else 3005
    assert harness.point(sequence, (0.5,), 9.0) == (INVALID, subcode)
    assert len(harness.arm.taken) == 2


# ---- trajectory mode


def test_points_require_trajectory_mode():
    harness = Harness(start=False)
    harness.apply(Event.MOTORS_ON)
    assert harness.point(0) == (NOT_READY, 5008)
    assert harness.command(READY) == (FAILURE, 5008)
    assert harness.command(START) == (SUCCESS, 0)
    assert harness.command(READY) == (SUCCESS, 0)
    assert harness.point(0) == (SUCCESS, 0)


def test_start_traj_mode_switches_servos_on():
    harness = Harness(start=False)
    assert harness.point(0) == (NOT_READY, 5006)
    assert harness.command(START) == (SUCCESS, 0)
    assert harness.condition.motors is Motors.ON


def test_start_traj_mode_resets_an_alarm():
    harness = Harness(start=False)
    harness.apply(Event.ERROR)
    harness.errors.enter(Rejection(ErrorNumber.PLANNER_FAILED, 'x'))
    assert harness.command(READY) == (FAILURE, 5001)
    assert harness.command(START) == (SUCCESS, 0)
    assert harness.condition == Condition(motors=Motors.ON)
    assert harness.errors.number == 0


STATES = {
    'estop': ((Event.ESTOP_PRESS,), 5003),
    'estop released': ((Event.ESTOP_PRESS, Event.ESTOP_RELEASE), 5003),
    'estop and error': ((Event.ERROR, Event.ESTOP_PRESS), 5001),
    'critical error': ((Event.CRITICAL_ERROR,), 5001),
    'manual': ((Event.MODE_MANUAL,), 5004),
    'pause': ((Event.MOTORS_ON, Event.PAUSE), 5007),
    'door': ((Event.DOOR_OPEN,), 5006),
    'door in motion': ((Event.MOTORS_ON, Event.DOOR_OPEN), 5007),
    'door in motion, at rest': ((Event.MOTORS_ON, Event.DOOR_OPEN, Event.STANDSTILL), 5006),
    'stopped': ((Event.MOTORS_ON, Event.STOP), 5008),
    'stopped without power': ((Event.STOP,), 5006),
}


@pytest.mark.parametrize('mode', [False, True], ids=['before', 'in the mode'])
@pytest.mark.parametrize(('events', 'subcode'), STATES.values(), ids=STATES)
def test_state_that_needs_an_operator_refuses_start_traj_mode(events, subcode, mode):
    harness = Harness(start=mode)
    if mode and Event.MOTORS_ON not in events:
        harness.apply(Event.MOTORS_OFF)
        harness.apply(Event.STANDSTILL)
    for event in events:
        harness.apply(event)
    before = harness.condition
    assert harness.command(READY) == (FAILURE, subcode)
    assert harness.command(START) == (NOT_READY, subcode)
    assert harness.point(0) == (NOT_READY, subcode)
    assert harness.condition == before
    assert (harness.begun, harness.arm.taken) == (0, [])


def test_missing_planner_is_reported_as_not_ready_unspecified():
    harness = Harness(start=False)
    harness.planner_ready = False
    assert harness.command(START) == (NOT_READY, 5000)
    harness.planner_ready = True
    assert harness.point(0) == (NOT_READY, 5008)  # trajectory mode is off


def test_program_error_is_reported_until_start_traj_mode():
    harness = Harness()
    harness.program.restart()
    harness.errors.enter(Rejection(ErrorNumber.PLANNER_FAILED, 'x'))
    assert harness.point(0) == (NOT_READY, 5002)
    assert harness.command(START) == (SUCCESS, 0)


@pytest.mark.parametrize('end', ['abort', 'restart'])
def test_abort_requires_start_traj_mode(end):
    harness = Harness()
    harness.point(0)
    harness.point(1, (0.5,), 1.0)
    harness.point(2, (0.6,), 2.0)
    getattr(harness.program, end)()
    assert harness.replies() == []  # all points are answered already
    assert harness.arm.braking
    assert harness.point(3, (0.7,), 3.0) == (NOT_READY, 5008)
    harness.run(1.0)
    assert len(harness.arm.taken) == 1
    assert harness.command(START) == (SUCCESS, 0)
    assert harness.point(3, (0.7,), 3.0) == (INVALID, 3005)
    assert harness.point(0) == (SUCCESS, 0)


@pytest.mark.invariant(4)
def test_inv4_estop_requires_start_traj_mode_again():
    harness = Harness()
    harness.point(0)
    harness.point(1, (0.5,), 1.0)
    harness.apply(Event.ESTOP_PRESS)
    assert harness.point(2, (0.6,), 2.0) == (NOT_READY, 5003)
    for event in (Event.ESTOP_RELEASE, Event.RESET):
        harness.apply(event)
        harness.run(1.0)
    assert harness.point(0) == (NOT_READY, 5006)
    harness.apply(Event.MOTORS_ON)
    assert harness.point(0) == (NOT_READY, 5008)
    assert len(harness.arm.taken) == 1


def test_stop_traj_mode_requires_an_empty_queue():
    harness = Harness()
    harness.point(0)
    harness.point(1, (0.5,), 1.0)
    assert harness.command(END) == (FAILURE, 0)
    assert harness.command(READY) == (SUCCESS, 0)
    harness.run(1.0)
    assert harness.command(END) == (SUCCESS, 0)
    assert harness.command(READY) == (FAILURE, 5008)
    assert harness.condition.motors is Motors.ON


# ---- commands


def test_stop_motion_brakes_and_empties_the_queue():
    harness = Harness()
    harness.point(0)
    harness.point(1, (0.5,), 1.0)
    harness.point(2, (0.6,), 2.0)
    assert harness.command(STOP) == (SUCCESS, 0)
    assert harness.arm.braking
    assert harness.point(3, (0.7,), 3.0) == (INVALID, 3005)
    assert harness.point(0) == (INVALID, 3011)  # it still brakes
    harness.run(0.1)
    assert len(harness.arm.taken) == 1
    assert harness.command(COUNT) == (SUCCESS, 0)
    assert harness.point(0) == (SUCCESS, 0)  # the mode stays


@pytest.mark.parametrize(
    'events', [(), (Event.ESTOP_PRESS,), (Event.MODE_MANUAL,), (Event.PAUSE,), (Event.STOP,)]
)
@pytest.mark.parametrize('robot_id', [0, -1, 3])
def test_stop_motion_works_in_every_condition(events, robot_id):
    harness = Harness()
    harness.point(0)
    harness.point(1, (0.5,), 1.0)
    for event in events:
        harness.apply(event)
    assert harness.command(STOP, robot_id) == (SUCCESS, 0)
    assert not harness.arm.ahead


def test_servos_are_switched_on_and_off():
    harness = Harness(start=False)
    assert harness.command(SERVO_ON) == (SUCCESS, 0)
    assert harness.condition.motors is Motors.ON
    assert harness.command(START) == (SUCCESS, 0)
    harness.point(0)
    harness.point(1, (0.5,), 1.0)
    assert harness.command(SERVO_OFF) == (SUCCESS, 0)
    assert harness.arm.braking
    assert harness.condition.motors is Motors.BRAKING
    assert harness.point(2, (0.5,), 2.0) == (NOT_READY, 5006)
    harness.apply(Event.STANDSTILL)
    assert harness.command(SERVO_OFF) == (SUCCESS, 0)  # they are off
    harness.apply(Event.ESTOP_PRESS)
    assert harness.command(SERVO_ON) == (FAILURE, 0)
    assert harness.condition.motors is Motors.OFF


def test_reset_alarm_clears_errors_except_an_estop():
    harness = Harness(start=False)
    harness.errors.enter(Rejection(ErrorNumber.CORRUPT_MESSAGE, 'x'))
    assert harness.command(RESET) == (SUCCESS, 0)
    assert harness.errors.number == 0
    harness.apply(Event.ERROR)
    assert harness.command(RESET) == (SUCCESS, 0)
    assert harness.condition == Condition()
    harness.apply(Event.ESTOP_PRESS)
    assert harness.command(RESET) == (FAILURE, 0)
    harness.apply(Event.ESTOP_RELEASE)
    assert harness.command(RESET) == (SUCCESS, 0)
    assert harness.condition == Condition()


def test_disconnect_command_is_refused_until_the_queue_is_empty():
    harness = Harness()
    harness.point(0)
    harness.point(1, (0.5,), 1.0)
    assert harness.command(DISCONNECT) == (FAILURE, 0)
    assert harness.hung_up == 0
    harness.run(1.0)
    harness.send(command(DISCONNECT))
    assert (harness.replies(), harness.hung_up) == ([], 1)
    assert harness.command(READY) == (FAILURE, 5008)


# ---- pause


def test_points_wait_in_a_pause_and_new_ones_are_refused():
    harness = Harness()
    harness.point(0)
    harness.point(1, (0.5,), 1.0)
    harness.point(2, (0.6,), 2.0)
    harness.run(0.5)
    harness.apply(Event.PAUSE)
    assert harness.program.paused
    harness.run(5.0)
    assert harness.point(3, (0.7,), 3.0) == (NOT_READY, 5007)
    assert harness.arm.position.tolist() == [0.0, 0.0]
    harness.apply(Event.CONTINUE)
    assert not harness.program.paused
    harness.run(1.5)
    assert harness.arm.position.tolist() == exact(0.6, 0.0)
    assert harness.point(3, (0.7,), 3.0) == (SUCCESS, 0)


# ---- other messages

OTHERS = {
    'a point of the generic kind': (frame(11, 2, 0, bytes(52)), (-1, -1, 11, INVALID, 3003)),
    'a version request': (frame(2, 2, 0), (-1, -1, 2, INVALID, 3003)),
    'an unknown type': (frame(60000, 2, 0, b'x'), (-1, -1, 60000, INVALID, 3003)),
    'type 0': (frame(0, 2, 0), (-1, -1, 0, INVALID, 3003)),
    'a negative type': (frame(-14, 2, 0, bytes(136)), (-1, -1, -14, INVALID, 3003)),
    'a point that is too short': (point(5, robot_id=3)[:-1], (3, 5, 14, INVALID, 3001)),
    'a point without body': (frame(14, 2, 0), (0, 0, 14, INVALID, 3001)),
    'a command that is too short': (command(START, 2, 9)[:-4], (2, 9, START, INVALID, 3001)),
    'a command with half a sequence': (
        frame(2001, 2, 0, struct.pack('<ih', 1, 8)),
        (1, 8, 0, INVALID, 3001),
    ),
    'a command that is too long': (command(STOP) + bytes(4), (0, 7, STOP, INVALID, 3001)),
    'a point with a reply code': (frame(14, 2, 1, bytes(136)), (-1, -1, 14, INVALID, 3002)),
    'a point with comm type 0': (frame(14, 0, 0, bytes(136)), (-1, -1, 14, INVALID, 3002)),
    'a point as a topic': (point(0, comm_type=1), (0, 0, 14, INVALID, 3002)),
    'a command as a topic': (command(START, 0, 7, 1), (0, 7, START, INVALID, 3002)),
    'a point with float64': (
        frame(14, 2, 0, struct.pack('<3i31d', 0, 0, 7, *[0.0] * 31)),
        (0, 0, 14, INVALID, 3001),
    ),
}


@pytest.mark.parametrize(('data', 'expected'), OTHERS.values(), ids=OTHERS)
def test_messages_other_than_points_and_commands_are_invalid(data, expected):
    harness = Harness()
    harness.send(struct.pack('<i', len(data) - 4) + data[4:])
    assert harness.replies() == [expected]
    assert (harness.begun, harness.arm.taken) == (0, [])


@pytest.mark.parametrize('reply_code', [0, 1, 2, 9])
@pytest.mark.parametrize('msg_type', [0, 11, 14, 2001, 2002])
def test_reply_from_a_client_is_not_answered(msg_type, reply_code):
    harness = Harness()
    harness.send(frame(msg_type, 3, reply_code, point(0)[16:] if msg_type == 14 else b''))
    assert harness.sent == b''
    assert harness.begun == 0


@pytest.mark.parametrize(('msg_type', 'size'), [(13, 28), (15, 132), (2002, 60)])
def test_unsupported_message_of_motoros_ends_the_connection(msg_type, size):
    harness = Harness()
    harness.send(frame(msg_type, 2, 0, bytes(size)))
    assert harness.sent == b''
    assert harness.hung_up == 1


@pytest.mark.invariant(4)
def test_inv4_lost_client_leaves_trajectory_mode_and_accepted_points():
    harness = Harness(room=1, pending_limit=1)
    harness.point(0)
    assert harness.point(1, (0.5,), 1.0) == (SUCCESS, 0)  # entered
    assert harness.point(2, (0.6,), 2.0) == (SUCCESS, 0)  # it waits
    harness.program.detach()
    assert harness.program.ready
    assert harness.command(COUNT) == (SUCCESS, 1)
    harness.run(3.0)
    assert harness.arm.position.tolist() == exact(0.5, 0.0)


REALS = st.floats(width=32) | st.floats(-3.0, 3.0, width=32)
TEN = st.lists(REALS, min_size=10, max_size=10)
COMMANDS = st.sampled_from([READY, COUNT, STOP, SERVO_ON, SERVO_OFF, RESET, START, END])
MESSAGES = st.one_of(
    st.builds(point, st.integers(-1, 4), TEN, REALS, TEN, st.sampled_from([0, 0, 0, 1])),
    st.builds(point, st.integers(0, 4), st.just(()), st.floats(0.0, 9.0, width=32)),
    st.builds(command, COMMANDS),
    st.builds(frame, st.sampled_from([11, 14, 2001]), st.integers(0, 3), st.integers(0, 2)),
    st.sampled_from(list(Event)),
)


@pytest.mark.invariant(2, 7)
@settings(max_examples=examples(200))
@given(script=st.lists(MESSAGES, max_size=30))
def test_inv2_and_7_any_messages_are_answered_and_stay_within_limits(script):
    harness = Harness(room=2, start=False)
    harness.send(command(START))
    harness.replies()
    for item in script:
        if isinstance(item, Event):
            try:
                harness.apply(item)
            except RejectedError:
                continue
        else:
            before = harness.arm.taken[-1:]
            harness.send(item)
            possible = harness.condition.motors is Motors.ON
            assert possible or harness.arm.taken[-1:] == before
            is_reply = struct.unpack_from('<i', item, 8)[0] == 3
            assert len(harness.replies()) == (0 if is_reply else 1)
        if harness.condition.tasks is Tasks.RUNNING:
            harness.program.step(0.05)
    for taken in harness.arm.taken:
        assert np.all(taken.target >= LIMITS.position_min)
        assert np.all(taken.target <= LIMITS.position_max)
        assert 0.0 < taken.duration < 14400.0


def test_unknown_command_is_invalid():
    assert Harness().command(200199) == (INVALID, 3006)


def test_queue_of_another_group_is_unknown():
    assert Harness().command(COUNT, robot_id=1) == (FAILURE, -1)
