# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Random sequences of events, clients and faults. The invariants hold at every step.

The numbers refer to docs/invariants.md.
"""

import struct

import numpy as np
import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule
from support.controller_harness import (
    FAILURE,
    LIMITS,
    MODEL,
    SIMULATED,
    STOP,
    SUCCESS,
    InlinePlanner,
    Peer,
    point,
    split,
)
from support.examples import examples

from epson_driver.sim_controller.assembly import new_controller
from epson_driver.sim_controller.condition.states import Event, Motors, RejectedError, Tasks
from epson_driver.simple_message import FrameError

pytestmark = pytest.mark.invariant(1, 2, 3, 4)

DT = 0.004
JOINTS = 6

OPERATOR_EVENTS = tuple(
    event
    for event in Event
    if event
    not in (
        Event.CLIENT_LOST,
        Event.STANDSTILL,
        Event.RECOVERED,
        Event.PROGRAM_POWER_HIGH,
        Event.ERROR,
        Event.CRITICAL_ERROR,
        Event.BOOT,
    )
)
"""Events that an operator can cause."""

READY = (
    Event.DOOR_CLOSE,
    Event.MODE_AUTO,
    Event.ESTOP_RELEASE,
    Event.CONTINUE,
    Event.RESET,
    Event.START,
    Event.MOTORS_ON,
)

ENABLES = (Event.MOTORS_ON, Event.CONTINUE, Event.START, Event.RESET)

angles = st.tuples(*(st.floats(-0.375, 0.375, width=32) for _ in range(JOINTS)))


class Sequences(RuleBasedStateMachine):
    """A controller with an operator, a motion client and a state client."""

    PLANNER: type[InlinePlanner] | None = None

    def __init__(self):
        super().__init__()
        planner = self.PLANNER and self.PLANNER()
        self.controller = new_controller(MODEL, SIMULATED, planner=planner)
        self.state = Peer()
        self.controller.connect('state', self.state)
        self.peer, self.connection = Peer(), None
        self.sequence = 0
        self.unanswered = 0
        self.before = self.joints()
        self.may_move = False  # whether motion was enabled since it was last forbidden
        self.silence = 0.0
        self.moved = 0

    def joints(self):
        return np.array(self.controller.servo.position)

    # Actions.

    @rule(event=st.sampled_from(OPERATOR_EVENTS))
    def apply_event(self, event):
        try:
            self.controller.apply(event)
        except RejectedError as error:
            assert len(str(error).split()) > 2  # noqa: PT017  the sentence
        else:
            self.may_move |= event in ENABLES

    @rule(data=st.data(), number=st.integers(2, 5), seconds=st.floats(0.02, 0.3))
    def enable_and_move(self, data, number, seconds):
        for event in READY:
            self.apply_event(event)
        self.time_passes(0.3)  # to brake, or to return to the interrupted path
        self.apply_event(Event.MOTORS_ON)
        if self.connection is None:
            self.client_connects()
        self.client_sends_points(number, data)
        self.time_passes(seconds)
        if self.controller.in_motion:
            self.moved += 1

    @precondition(lambda self: self.controller.moving)
    @rule(
        events=st.sampled_from(
            [
                (Event.PAUSE, Event.CONTINUE),
                (Event.DOOR_OPEN, Event.DOOR_CLOSE, Event.CONTINUE),
                (Event.PAUSE, Event.DOOR_OPEN, Event.DOOR_CLOSE, Event.CONTINUE),
                (Event.DOOR_OPEN, Event.DOOR_CLOSE, Event.CONTINUE, Event.DOOR_OPEN),
            ]
        ),
        seconds=st.floats(0.0, 0.5),
        push=st.floats(-0.2, 0.2),
        disturbance=st.sampled_from(['nothing', 'client_stops', 'client_leaves', 'nonsense']),
        when=st.integers(0, 3),
    )
    def interrupt_motion(self, events, seconds, push, disturbance, when):
        for number, event in enumerate(events):
            self.apply_event(event)
            self.time_passes(seconds)
            if number == when and self.connection is not None:
                if disturbance == 'nonsense':
                    self.client_sends_nonsense((9.0,))
                elif disturbance != 'nothing':
                    getattr(self, disturbance)()
            if event is Event.DOOR_OPEN:
                self.push_arm(0, push)
                self.time_passes(seconds)

    @precondition(lambda self: self.connection is None)
    @rule()
    def client_connects(self):
        self.peer = Peer()
        self.connection = self.controller.connect('motion', self.peer)
        self.sequence = self.unanswered = 0

    @precondition(lambda self: self.connection is not None)
    @rule(number=st.integers(1, 5), data=st.data())
    def client_sends_points(self, number, data):
        for _ in range(number):
            joints = data.draw(angles)
            self.connection.receive(point(self.sequence, joints, data.draw(st.floats(0.0, 1.0))))
            self.sequence += 1
            self.unanswered += 1
        self.read_replies()

    @precondition(lambda self: self.connection is not None)
    @rule()
    def client_stops(self):
        self.connection.receive(point(STOP))
        self.unanswered += 1
        self.read_replies()
        assert self.unanswered == 0  # it answers all pending points

    @precondition(lambda self: self.connection is not None)
    @rule(joints=st.sampled_from([(9.0,), (float('nan'),), (0.0, -7.0), (1e30,)]))
    def client_sends_nonsense(self, joints):
        self.connection.receive(point(0, joints))
        self.unanswered += 1
        self.read_replies()

    @precondition(lambda self: self.connection is not None)
    @rule(data=st.binary(min_size=1, max_size=200))
    def client_sends_garbage(self, data):
        try:
            self.connection.receive(b'\xff' + data)
            self.client_leaves()
        except FrameError:
            self.client_leaves()

    @precondition(lambda self: self.connection is not None)
    @rule()
    def client_leaves(self):
        self.connection.closed()
        self.connection = None
        assert self.controller.condition.motors is not Motors.ON

    @rule(joint=st.integers(0, JOINTS - 1), angle=st.floats(-0.3, 0.3))
    def push_arm(self, joint, angle):
        try:
            self.controller.disturb(joint, angle)
        except RejectedError:
            return
        self.before = self.joints()  # motion by the operator

    @rule(joint=st.integers(0, JOINTS - 1))
    def servo_fails(self, joint):
        self.controller.servo_error(joint)

    @rule(seconds=st.floats(0.0, 0.4))
    def time_passes(self, seconds):
        for _ in range(round(seconds / DT)):
            condition, at_rest = self.controller.condition, not self.controller.in_motion
            self.controller.step(DT)
            self.check(condition, at_rest)
        self.read_replies()

    # Checks.

    def check(self, condition, at_rest):
        """Check one cycle against the invariants."""
        now = self.joints()
        pulse = 1e-6
        assert np.all(now >= LIMITS.position_min - pulse), 'invariant 2'
        assert np.all(now <= LIMITS.position_max + pulse), 'invariant 2'
        moved = np.abs(now - self.before)
        assert np.all(moved <= LIMITS.velocity * DT + 2 * pulse), 'invariant 2'
        if at_rest and not condition.powered:
            assert np.all(moved == 0.0), 'invariants 1 and 4'
        if at_rest and (condition.paused or condition.tasks in (Tasks.STOPPED, Tasks.ABORTED)):
            assert np.all(moved <= pulse), 'invariant 3'
        if np.any(moved > pulse) and at_rest:
            assert self.may_move, 'invariant 4'
        self.before = now
        self.silence = 0.0 if self.state.take() else self.silence + DT
        assert self.silence < 0.1

    def read_replies(self):
        for msg_type, comm_type, code, body in split(self.peer.take()):
            assert (msg_type, comm_type) == (10, 3)
            assert code in (SUCCESS, FAILURE)
            if code == FAILURE and struct.unpack_from('<i', body)[0] != STOP:
                self.sequence = 0
            self.unanswered -= 1
        assert self.unanswered >= 0, 'unexpected reply'

    @invariant()
    def status_is_true(self):
        controller = self.controller
        status, condition = controller.status(), controller.condition
        assert status.in_motion == controller.in_motion
        assert status.drives_powered == condition.powered
        assert status.e_stopped == condition.estopped
        assert status.in_error == (status.error_code != 0)
        if status.motion_possible:
            assert condition.motors is Motors.ON
            assert condition.tasks is Tasks.RUNNING
            assert not status.e_stopped
        if status.e_stopped:
            assert status.error_code == 2261
        if (
            not condition.powered
            and not controller.in_motion
            and condition.tasks
            in (
                Tasks.STOPPED,
                Tasks.ABORTED,
            )
        ):
            assert not controller.moving, 'invariant 4: a motion is pending'

    @invariant()
    def forbidden_stays_forbidden(self):
        condition = self.controller.condition
        if not condition.powered and not self.controller.in_motion:
            self.may_move = False

    def teardown(self):
        """The arm comes to rest after an E-stop without a client (invariant 3)."""
        if self.connection is not None:
            self.client_leaves()
        self.controller.apply(Event.ESTOP_PRESS)
        for _ in range(1000):
            if not self.controller.in_motion:
                break
            self.controller.step(DT)
        assert not self.controller.in_motion
        assert not self.controller.condition.powered


TestSequences = Sequences.TestCase
TestSequences.settings = settings(
    max_examples=examples(200),
    stateful_step_count=40,
    suppress_health_check=list(HealthCheck),
)


class SmoothSequences(Sequences):
    """The same rules with smooth motion."""

    PLANNER = InlinePlanner


TestSmoothSequences = SmoothSequences.TestCase
TestSmoothSequences.pytestmark = [pytest.mark.slow]
TestSmoothSequences.settings = settings(TestSequences.settings, max_examples=examples(40))
