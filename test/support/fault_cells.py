# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Faults, the controllers and motion phases they affect, and the expected results.

A row of FAULTS has what is common to all controllers, and EXCEPTIONS what differs for a controller
or an interface. `fault_play.py` runs a cell.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from epson_driver.driver.outcome import ErrorCode
from epson_driver.sim_controller.condition.states import Event
from support.driver_harness import LIMITS, pose

PROFILES = ('simulated', 'generic', 'fanuc', 'abb', 'motoman', 'spel', 'remote', 'rtmc')
DOWNLOADS = ('simulated', 'spel')
"""Controllers that usually receive points and also accept whole trajectories."""

SETPOINTS = ('simulated', 'generic', 'spel', 'rtmc')
"""Controllers with an interrupted stream of setpoints."""

PHASES = ('standing', 'starting', 'moving', 'arriving', 'stopping')
"""Phases of a goal: no goal, first point accepted, in motion, almost at the end, and canceled at
the moment of the fault."""

USUAL = 'usual'
"""The interface of the profile."""

STATE_TIMEOUT = 0.4
JOINT_1_END = 3.4
"""A position outside the range of joint 1, rad, which only the controller knows."""

WIDER = replace(LIMITS, position_max=LIMITS.position_max + 1.0, velocity=LIMITS.velocity * 1.1)

WAY = tuple(pose(0.15 * count, 0.05 * (count % 2)) for count in range(1, 9))
"""Points of a path that takes a few seconds."""

ABORTED = ErrorCode.PATH_TOLERANCE_VIOLATED
"""Result code of a goal that a fault interrupts."""


@dataclass(frozen=True)
class Row:
    """A fault, its expected results, and the repair by a user.

    events: events at the controller. fault: faults of its connections, in the pendant's words.
    strike: another fault, of fault_strikes.STRIKES. harmless: the goal succeeds, and the arm stays
    enabled. points: the goal's path. canceled: the goal is canceled at the same moment. code: the
    result code. text, gate: patterns for the outcome and the gate's reason.
    repair: a user's actions at the controller, in this order. boots: the controller is restarted
    before, because the links do not return otherwise. reset: the error is reset at the end.
    """

    events: tuple[Event, ...] = ()
    fault: str = ''
    strike: str = ''
    harmless: bool = False
    points: tuple[np.ndarray, ...] = WAY
    canceled: bool = False
    code: ErrorCode = ABORTED
    text: str = ''
    gate: str = ''
    repair: tuple[Event, ...] = ()
    reset: bool = False
    boots: bool = False


LOST = 'the (state|motion|remote|rtmc) link was lost: .*(closed by the controller|reset|silent)'

FAULTS: dict[str, Row] = {
    'e_stop': Row(
        events=(Event.ESTOP_PRESS,),
        text='the E-stop is pressed or not reset',
        gate='the E-stop (is|was) pressed',
        repair=(Event.ESTOP_RELEASE,),
        reset=True,
    ),
    'motors_off': Row(
        events=(Event.MOTORS_OFF,),
        text='the motors are off|motors off',
        gate='the motors are off|the controller (is|was) in error',
        reset=True,
    ),
    'door': Row(
        events=(Event.DOOR_OPEN,),
        text='the motors are off',
        gate='the motors are off',
        repair=(Event.DOOR_CLOSE, Event.STOP, Event.START),
    ),
    'failure_reply': Row(  # a point of the goal is refused
        points=(*WAY[:2], pose(JOINT_1_END)),
        text=r'the controller refused point 3 of 4 \(FAILURE reply\): .*4001',
        gate='the controller (is|was) in error 4001',
        reset=True,
    ),
    'lost_reply': Row(
        fault='lost_reply count=1',
        text=r'no reply to point \d of 9: the arm has not moved for',
        gate='no reply to (point|setpoint)',
    ),
    'silence': Row(
        fault=f'half_open for={STATE_TIMEOUT + 0.2}',
        text=f'the (state|remote|rtmc) link was lost: .*silent for {STATE_TIMEOUT} s',
        gate='the (state|remote|rtmc) link was lost',
    ),
    'cut': Row(fault='cut for=0.3', text=LOST, gate='link was lost'),
    'reboot': Row(fault='reboot for=0.3', text=LOST, gate='link was lost'),
    'wrong_byte_order': Row(
        fault='wrong_byte_order for=0.3',
        reset=True,  # STOP leaves first on a new connection, in the byte order of the fault
        text='the (state|motion) link was lost: .*length',
        gate='link was lost',
    ),
    'wrong_answer': Row(
        strike='wrong_answer',
        text="the remote link was lost: .*'#Hello,0' is not a reply to the request",
        gate='the remote link was lost',
    ),
    'logged_out': Row(
        strike='logged_out',
        text='(the remote link was lost: |refused STOP).*no client is logged in',
        gate='the remote link was lost|refused STOP',
    ),
    'second_client': Row(strike='second_client', harmless=True),
    'other_client_first': Row(strike='other_client_first', text=LOST, gate='link was lost'),
}

REMOTE_ONLY = ('wrong_answer', 'logged_out', 'second_client', 'other_client_first')
"""Faults of controllers with Remote Ethernet alone."""

IN_ERROR_4001 = 'the controller is in error 4001'
STOP_UNANSWERED: dict[str, Any] = {
    'canceled': True,
    'text': 'the controller did not confirm the standstill within',
    'gate': 'the controller did not confirm the standstill within',
}

EXCEPTIONS: dict[tuple[str, str], dict[str, Any]] = {
    # It answers points before the arm moves or never, so only STOP's reply can be lost.
    ('lost_reply', 'abb'): STOP_UNANSWERED,
    ('lost_reply', 'motoman'): STOP_UNANSWERED,
    # It answers all points before the arm has moved far, because of its look-ahead.
    ('lost_reply', 'spel'): STOP_UNANSWERED,
    # A refused point is not an error of the controller. STATUS shows its number.
    ('failure_reply', 'spel'): {'gate': 'refused point 3 of 4', 'reset': False},
    # It may read a message of the driver first, such as a heartbeat, and close the connection.
    **{
        ('wrong_byte_order', name): {
            'text': 'the (state|motion) link was lost: .*(length|closed by the controller)'
        }
        for name in ('spel', 'spel:download')
    },
    # A topic has no reply, so only STATUS shows the error.
    ('failure_reply', 'abb'): {'text': IN_ERROR_4001},
    # Its reply has the reason, and STATUS shows no error.
    ('failure_reply', 'motoman'): {
        'text': r'refused point 3 of 4 \(INVALID: the message is wrong, 3012: a position\)',
        'gate': 'refused point 3 of 4',
    },
    # It accepts the point, refuses it before execution, and closes the connection.
    ('failure_reply', 'fanuc'): {
        'text': '(refused|had accepted all points before) point 3 of 4'
        '.*(4001|the motion link was lost)|the motion link was lost: .*closed by the controller',
        'gate': 'the controller (is|was) in error 4001|the motion link was lost',
    },
    # Points of a download are topics without replies, so only STOP's reply can be lost.
    ('lost_reply', 'download'): STOP_UNANSWERED,
    ('failure_reply', 'download'): {'text': f'{IN_ERROR_4001}|refused point'},
    # It refuses the whole download, and topics have no reply, so the arm just does not start.
    ('failure_reply', 'spel:download'): {
        'text': 'the controller did not confirm the standstill within',
        'gate': 'the controller did not confirm the standstill within',
    },
    # Each setpoint has a reply, which may be missed before the state.
    ('lost_reply', 'setpoints'): {'canceled': False, 'gate': 'no reply to setpoint'},
    ('silence', 'setpoints'): {'gate': 'the (state|rtmc) link was lost|no reply to setpoint'},
    # A motion is one statement, so the answer to it or to STOP can be lost.
    ('lost_reply', 'remote'): STOP_UNANSWERED | {'fault': '', 'strike': 'lost_answer'},
    ('failure_reply', 'remote'): {'points': (pose(JOINT_1_END),), 'text': 'refused point 0 of 1'},
    **{
        (fault, 'remote'): {'fault': f'{text} port=remote for={lasts:g}'}
        for fault, text, lasts in (
            ('silence', 'half_open', STATE_TIMEOUT + 0.2),
            ('cut', 'cut', 0.3),
        )
    },
    ('silence', 'rtmc'): {'reset': True},  # the buffer has run empty
    **{
        ('door', name): dict.fromkeys(('text', 'gate'), 'the safeguard door (is|was) open')
        for name in ('remote', 'rtmc')
    },
}

ANSWER_A_POINT_FIRST = ('simulated', 'generic', 'fanuc')
"""Controllers that answer the pending point before STOP. If only that reply is lost, the gate
stays open because STOP is confirmed, so STOP's reply is lost here."""

LAST_REPLY_ELSEWHERE = ('generic', 'fanuc')
"""Controllers that answer the last point before the arm is near it, or much later."""

STOPPED = 'canceled|the controller did not confirm the standstill'
"""Alternative outcomes of a goal that was canceled when the fault occurred."""


@dataclass(frozen=True)
class Cell:
    """One experiment: a fault, a controller, an interface and a phase."""

    fault: str
    profile: str
    interface: str = USUAL
    phase: str = 'moving'

    @property
    def name(self) -> str:
        """The name in results."""
        usual = self.interface == USUAL
        place = self.profile if usual else f'{self.profile}:{self.interface}'
        return f'{self.fault}-{place}-{self.phase}'

    @property
    def row(self) -> Row:
        """The fault and the expected results."""
        row = FAULTS[self.fault]
        if self.profile == 'remote':
            row = replace(row, points=row.points[-1:])  # a statement has no waypoints
        for key in (self.profile, self.interface, f'{self.profile}:{self.interface}'):
            row = replace(row, **EXCEPTIONS.get((self.fault, key), {}))
        if self.phase == 'stopping':
            row = replace(row, canceled=True)
            if self.fault == 'lost_reply':
                strike = 'lost_abort' if row.strike else ''
                row = replace(row, **STOP_UNANSWERED, strike=strike)
                if self.interface == USUAL and self.profile in ANSWER_A_POINT_FIRST:
                    row = replace(row, fault='lost_reply count=1 skip=1')
        return row

    @property
    def cannot_be(self) -> str:
        """The reason why this cell is impossible, or an empty string."""
        if (self.profile == 'remote') < (self.fault in REMOTE_ONLY):
            return 'it concerns motion by Remote Ethernet'
        if self.profile == 'remote' and self.fault == 'wrong_byte_order':
            return 'text has no byte order'
        if self.profile == 'rtmc' and self.fault in ('lost_reply', 'wrong_byte_order'):
            return 'DDS delivers each message, in one byte order'
        if self.interface == 'setpoints' and self.phase != 'moving':
            return 'a stream of setpoints has no phases'
        if self.fault == 'failure_reply':
            if self.profile == 'rtmc':
                return 'the driver plans the motion, within the limits that it knows'
            if self.phase != 'moving':
                return 'it happens in motion to the previous point'
            if self.interface == 'setpoints':
                return 'a setpoint out of range is clipped'
        if self.fault == 'lost_reply':
            if self.phase == 'standing':
                return 'no reply is pending'
            if self.phase == 'arriving' and self.profile in LAST_REPLY_ELSEWHERE:
                return 'no reply is pending in that phase'
            if self.row.canceled and self.phase != 'stopping' and self.interface != 'setpoints':
                return '' if self.phase == 'moving' else 'its points have no separate replies'
        return ''


def cells() -> Iterator[Cell]:
    """Yield every possible cell."""
    columns = [
        *((profile, USUAL) for profile in PROFILES),
        *((profile, 'download') for profile in DOWNLOADS),
        *((profile, 'setpoints') for profile in SETPOINTS),
    ]
    for phase in PHASES:
        for fault in FAULTS:
            for profile, interface in columns:
                cell = Cell(fault, profile, interface, phase)
                if not cell.cannot_be:
                    yield cell
