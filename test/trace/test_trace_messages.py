# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The messages of a recording: senders, order, and the roles of ports."""

import pytest
from support.link_harness import frame, joints

from epson_driver.link import WireEvent
from epson_driver.rtmc.messages import Request, RtmcMessage
from epson_driver.simple_message import LITTLE_ENDIAN, JointTrajPt, encode, request
from epson_driver.trace.messages import Kind, MessagesError, messages_of
from epson_driver.trace.recording import Step

HOST = '10.0.0.1'
MOTION, STATE = 0, 1
PORTS = {MOTION: 11000, STATE: 11002}
OPENED, SENT, RECEIVED = WireEvent.OPENED, WireEvent.SENT, WireEvent.RECEIVED
POINT = encode(request(JointTrajPt(0)), LITTLE_ENDIAN)
YES = frame(11, 3, 1)


def recorded(*rows):
    """Return steps from (time, connection, event, data)."""
    return [
        Step(1e9 + time, number, (HOST, PORTS[number % 2]), event, *data)
        for time, number, event, *data in rows
    ]


def usual_run():
    return recorded(
        (0.0, STATE, OPENED),
        (0.0, MOTION, OPENED),
        (0.5, STATE, RECEIVED, joints(1.0)),
        (1.0, MOTION, SENT, POINT),
        (1.25, MOTION, RECEIVED, YES),
    )


def ports(steps, controller=None):
    """Return the port of each role."""
    number_of = {step.number: step.server[1] for step in steps}
    roles = messages_of(steps, controller).roles
    return {role: number_of[number] for number, role in roles.items()}


def entries(steps):
    return [(e.time, e.kind, e.connection, e.data) for e in messages_of(steps).entries]


def test_messages_are_in_order_from_the_start():
    assert messages_of(usual_run()).began == 1e9
    assert entries(usual_run()) == [
        (0.0, Kind.OPEN, STATE, b''),
        (0.0, Kind.OPEN, MOTION, b''),
        (0.5, Kind.SEND, STATE, joints(1.0)),
        (1.0, Kind.REQUEST, MOTION, POINT),
        (1.25, Kind.SEND, MOTION, YES),
    ]


def test_truncated_message_and_invalid_bytes_are_returned_raw():
    cut, garbage = joints(2.0)[:30], b'\xff' * 50
    rows = [(0.0, STATE, OPENED), (0.0, MOTION, OPENED), (0.25, STATE, RECEIVED, joints(1.0))]
    rows += [(0.5, STATE, RECEIVED, cut), (0.75, STATE, WireEvent.ENDED)]
    rows += [(1.0, MOTION, RECEIVED, YES), (1.0, MOTION, RECEIVED, garbage)]
    rows += [(1.25, MOTION, WireEvent.RESET)]
    assert entries(recorded(*rows))[2:] == [
        (0.25, Kind.SEND, STATE, joints(1.0)),
        (0.75, Kind.SEND, STATE, cut),
        (0.75, Kind.END, STATE, b''),
        (1.0, Kind.SEND, MOTION, YES),
        (1.0, Kind.SEND, MOTION, garbage),
        (1.25, Kind.RESET, MOTION, b''),
    ]


def test_messages_after_an_unknown_one_of_real_time_motion_control_are_read():
    sent = [RtmcMessage(Request.STATUS), RtmcMessage(4711), RtmcMessage(Request.JOINTS)]
    steps = recorded(
        (0.0, MOTION, OPENED), *((1.0, MOTION, SENT, message.encode()) for message in sent)
    )
    assert [entry.frame for entry in messages_of(steps).entries[1:]] == sent


def test_heartbeats_are_skipped():
    beats = recorded((0.9, MOTION, SENT, frame(1, 1)))
    assert entries(sorted([*usual_run(), *beats], key=lambda s: s.time)) == entries(usual_run())


def test_port_roles_are_detected_from_their_messages():
    steps = usual_run()
    assert ports(steps) == {'motion': 11000, 'state': 11002}
    odd = {11000: 50999, 11002: 50998}
    moved = [
        Step(step.time, step.number, (HOST, odd[step.server[1]]), step.event, step.data)
        for step in steps
    ]
    assert ports(moved) == {'motion': 50999, 'state': 50998}
    quiet = [step for step in moved if step.number == STATE or step.event is OPENED]
    assert ports(quiet) == {'motion': 50999, 'state': 50998}


def test_one_controller_is_chosen_and_others_ignored():
    steps = usual_run()
    web = Step(steps[0].time, 7, ('10.0.0.9', 80), RECEIVED, b'HTTP/1.1 200 OK\r\n' * 5)
    assert ports([*steps, web]) == {'motion': 11000, 'state': 11002}
    second = [Step(s.time, s.number + 8, ('10.0.0.2', 11002), s.event, s.data) for s in steps]
    with pytest.raises(MessagesError, match=r'10\.0\.0\.1, 10\.0\.0\.2 are in the recording'):
        messages_of([*steps, *second])
    assert ports([*steps, *second], HOST) == {'motion': 11000, 'state': 11002}
    with pytest.raises(MessagesError, match='no connection'):
        messages_of([web])
    with pytest.raises(MessagesError, match='no connection'):
        messages_of([])


def test_two_ports_with_equal_roles_are_refused():
    steps = usual_run()
    second = [
        Step(s.time, s.number + 8, (HOST, 50000), s.event, s.data)
        for s in steps
        if s.number == STATE
    ]
    with pytest.raises(MessagesError) as refused:
        messages_of([*steps, *second])
    ports_of_roles = '11000 (motion), 11002 (state), 50000 (state)'
    message = f'the recording has two ports with the same role: {ports_of_roles}'
    assert str(refused.value) == message
