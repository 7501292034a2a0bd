# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The remote link with a scripted port: slow, faulty, hostile or silent."""

import asyncio
import contextlib
import sys

import pytest
from support.event_loop import until
from support.remote_peer import HOME, READY, RemotePeer

from epson_driver.link.connection import READ_SIZE_BYTES
from epson_driver.link.remote_link import AFTER_MOTION_S, MAX_LINE_BYTES, LineFramer, RemoteLink
from epson_driver.remote_ethernet.client import RemoteError
from epson_driver.simple_message import (
    FrameError,
    GetVersion,
    JointPosition,
    Ping,
    Status,
    TriState,
)

MOVE = 'Go JA(1, 0, 0, 0, 0, 0)'


class Linked:
    """A running link, its messages, and the answers to its commands."""

    def __init__(self, port, password=''):
        self.messages = []
        self.states = []
        self.answers = []
        self.link = RemoteLink(
            '127.0.0.1',
            port,
            ['rad'] * 6,
            on_packet=lambda packet: self.messages.append(packet.message),
            on_state=lambda state, why: self.states.append((state.value, why)),
            password=password,
        )

    async def __aenter__(self):
        self._task = asyncio.create_task(self.link.run())
        return self

    async def __aexit__(self, *_):
        self._task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await self._task

    def received(self, kind):
        return [message for message in self.messages if isinstance(message, kind)]

    def reason(self, state='backing_off'):
        return next(why for name, why in self.states if name == state)


def motion(answer):
    """Return replies in which only motions have this answer, and joints are available."""
    return lambda line: HOME if 'Print' in line else answer


async def test_state_has_joints_in_rad_and_the_flags():
    peer = RemotePeer(Execute='#execute,"90 0 0 0 0 -180 0"', GetStatus=READY.lower())
    async with peer, Linked(peer.port) as there:
        await until(lambda: there.received(JointPosition))
    (position, *_), (status, *_) = there.received(JointPosition), there.received(Status)
    assert position.joints[:6] == pytest.approx((1.5707963, 0, 0, 0, 0, -3.1415927))
    assert status.drives_powered == TriState.FALSE
    assert status.in_motion == TriState.FALSE
    assert not there.link.joints_withheld


@pytest.mark.parametrize('flag', range(7))
async def test_joints_are_not_polled_while_the_controller_refuses_execute(flag):
    """Test, Teach, SError, Safeguard, EStop, Error and Paused each prevent $Execute."""
    places = (0, 1, 4, 5, 6, 7, 8)
    flags = ''.join('1' if place in (2, places[flag]) else '0' for place in range(11))

    peer = RemotePeer(GetStatus=f'#GetStatus,{flags},0000')
    async with peer, Linked(peer.port) as there:
        await until(lambda: len(there.messages) > 2)
    assert not peer.given('Execute')
    assert not there.received(JointPosition)
    assert there.messages[0].motion_possible == TriState.FALSE


@pytest.mark.invariant(6)
async def test_inv6_during_a_statement_joints_are_unavailable_and_the_arm_moves():
    peer = RemotePeer(Execute=motion(None))
    async with peer, Linked(peer.port) as there:
        await until(lambda: there.received(JointPosition))
        there.link.move(MOVE, there.answers.append)
        assert there.link.joints_withheld
        there.messages.clear()
        await until(lambda: len(there.messages) > 3)
        assert not there.received(JointPosition)
        assert all(status.in_motion == TriState.TRUE for status in there.received(Status)[1:])
        with pytest.raises(RemoteError, match='another command is being executed'):
            await there.link.ask('Execute,"Print Oport(1)"')


async def test_joints_are_polled_twice_directly_after_a_motion():
    peer = RemotePeer(Execute=motion('#Execute,0'))
    async with peer, Linked(peer.port) as there:
        await until(lambda: there.received(JointPosition))
        there.link.move(MOVE, there.answers.append)
        await until(lambda: there.answers)
        there.messages.clear()
        await asyncio.sleep(1.5 * AFTER_MOTION_S)
        assert len(there.received(JointPosition)) == 2


@pytest.mark.invariant(3)
async def test_inv3_abort_overtakes_a_statement_and_both_get_their_answers():
    peer = RemotePeer(Execute=motion(None))
    peer.answers['Abort'] = '!Execute,99\r\n#Abort,0'
    async with peer, Linked(peer.port) as there:
        await until(lambda: there.received(JointPosition))
        there.link.move(MOVE, there.answers.append)
        await until(lambda: len(peer.given('Execute')) > 1)
        there.link.abort(there.answers.append)
        await until(lambda: len(there.answers) == 2)
    moved, stopped = there.answers
    assert moved.number == 99
    assert stopped == '0'


@pytest.mark.invariant(3)
async def test_inv3_unsent_motion_is_not_sent_after_a_stop():
    peer = RemotePeer(delay=0.2)
    async with peer, Linked(peer.port) as there:
        await until(lambda: there.received(JointPosition))
        before = len(peer.given('Execute'))
        await until(lambda: len(peer.given('Execute')) > before)  # a query is pending
        there.link.move(MOVE, there.answers.append)
        there.link.abort(there.answers.append)
        await until(lambda: len(there.answers) == 2)
        there.messages.clear()
        await until(lambda: there.received(JointPosition))
    assert isinstance(there.answers[0], RemoteError)
    assert not any('Go' in line for line in peer.lines)


@pytest.mark.invariant(1)
async def test_inv1_messages_for_a_motion_port_are_refused_and_not_sent():
    async with RemotePeer() as peer, Linked(peer.port) as there:
        await until(lambda: there.received(JointPosition))
        with pytest.raises(ConnectionError, match='cannot be sent to a Remote Ethernet port'):
            there.link.post(GetVersion(), print)
        with pytest.raises(ConnectionError, match='cannot be sent to a Remote Ethernet port'):
            there.link.send_topic(Ping())
    assert not peer.given('Abort')
    assert peer.connections == 1


@pytest.mark.invariant(9)
async def test_inv9_unanswered_aborted_statement_ends_the_connection():
    peer = RemotePeer(Execute=motion(None))
    async with peer, Linked(peer.port) as there:
        await until(lambda: there.received(JointPosition))
        there.link.move(MOVE, there.answers.append)
        there.link.abort(there.answers.append)
        await until(lambda: peer.connections == 2)
    assert 'no reply to the aborted command' in there.reason()
    assert 'completes its command' in there.reason()


@pytest.mark.parametrize(
    ('answers', 'reason'),
    [
        ({'Login': '!Login,13'}, 'Login: the password is wrong (error 13)'),
        ({'Login': '!Login,11'}, 'error 11'),
        ({'GetStatus': '#GetStatus,hello'}, "'hello' is not a status"),
        ({'GetStatus': '!GetStatus,20'}, 'error 20'),
        ({'Execute': '#Execute,"1 2 3"'}, 'is not a reply to Execute'),
        ({'Execute': '#Execute,"a b c d e f g"'}, 'is not a reply to Execute'),
        ({'GetStatus': '#GetIO,1'}, "'#GetIO,1' is not a reply to the request"),
        ({'GetStatus': 'hello'}, "'hello' is not a reply to the request"),
        ({'GetStatus': '!GetStatus,' + '9' * 5000}, 'is not a reply to the request'),
        ({'GetStatus': 'x' * 10_000}, 'a line has at most'),
        ({'GetStatus': None}, 'silent for 1 s'),
        ({'Login': None}, 'silent for 1 s'),
    ],
)
@pytest.mark.invariant(7)
async def test_inv7_port_with_faulty_answers_is_disconnected_with_the_reason(answers, reason):
    peer = RemotePeer(**answers)
    async with peer, Linked(peer.port, 'secret') as there:
        await until(lambda: peer.connections > 1)
    assert reason in there.reason()
    assert not there.received(JointPosition)
    assert not any('secret' in why for _, why in there.states)


async def test_connection_closed_at_login_reports_another_client():
    async def close(_reader, writer):
        writer.close()

    server = await asyncio.start_server(close, '127.0.0.1', 0)
    async with server, Linked(server.sockets[0].getsockname()[1]) as there:
        await until(lambda: len(there.states) > 3)
    assert 'another Remote Ethernet client is connected' in there.reason()
    assert not any(state == 'connected' for state, _ in there.states)


async def test_slow_answers_do_not_end_the_connection():
    peer = RemotePeer(delay=0.4)
    async with peer, Linked(peer.port) as there:
        await until(lambda: len(there.received(JointPosition)) > 2)
    assert peer.connections == 1


@pytest.mark.invariant(7)
async def test_inv7_password_is_in_no_trace():
    peer = RemotePeer()
    async with peer, Linked(peer.port, 'secret') as there:
        traced = []
        there.link.trace = lambda _, data: traced.append(data)
        await until(lambda: there.received(JointPosition))
    assert b'$Login\r\n' in traced
    assert not any(b'secret' in data for data in traced)
    assert peer.given('Login') == ['$Login,secret']


@pytest.mark.parametrize('cut', [1, 2, 3, 100])
def test_framer_returns_complete_lines_of_any_chunks(cut):
    framer, data = LineFramer(), b'#Login,0\r\n\n#GetStatus,1\r#Abort,0\n#Exe'
    lines = []
    for at in range(0, len(data), cut):
        framer.receive_data(data[at : at + cut])
        while (line := framer.next_packet()) is not None:
            lines.append(line)
    assert lines == ['#Login,0', '#GetStatus,1', '#Abort,0']
    assert framer.unread == b'#Exe'


@pytest.mark.invariant(7)
@pytest.mark.parametrize('end', [b'\n', b'\r\n'])
async def test_inv7_empty_lines_cost_few_calls_per_read(end):
    """A mebibyte of them precedes each answer, and every answer arrives."""
    calls = reads = 0

    def count(frame, event, _argument):
        nonlocal calls, reads
        if isinstance(frame.f_locals.get('self'), LineFramer):
            calls += event == 'c_call'
            reads += event == 'call' and frame.f_code.co_name == 'receive_data'

    peer = RemotePeer()
    flood = (end * (2**20 // len(end))).decode()
    peer.answers |= {'Execute': flood + HOME, 'GetStatus': flood + READY}
    async with peer, Linked(peer.port) as there:
        sys.setprofile(count)
        try:
            await until(lambda: len(there.received(JointPosition)) > 1)
        finally:
            sys.setprofile(None)
    assert reads >= 2 * 2**20 / READ_SIZE_BYTES
    assert calls < 20 * reads
    assert peer.connections == 1


@pytest.mark.invariant(6, 7)
@pytest.mark.parametrize('answered', ['Login', 'GetStatus', 'Abort'])
async def test_inv7_peer_that_sends_without_answering_is_lost_and_may_recover(answered):
    """It sends empty lines and answers the login, the flags or another user's command."""
    peer = RemotePeer()
    usual = dict(peer.answers)
    order = ['Login', 'GetStatus', 'Abort', 'Execute']
    peer.answers |= dict.fromkeys(order[order.index(answered) + 1 :])
    peer.blank = 0.1

    async def query(link):
        while True:
            await asyncio.sleep(0.2)
            with contextlib.suppress(ConnectionError):
                await link.ask('Abort')

    async with peer, Linked(peer.port) as there:
        querying = asyncio.create_task(query(there.link))
        await until(lambda: peer.connections == 2)
        assert there.reason().endswith('silent for 1 s')
        assert not there.received(JointPosition)
        peer.answers = usual
        await until(lambda: there.received(JointPosition))
        querying.cancel()
        await asyncio.gather(querying, return_exceptions=True)


@pytest.mark.invariant(7)
def test_inv7_line_without_end_is_refused_and_dropped():
    framer = LineFramer()
    framer.receive_data(b'x' * (MAX_LINE_BYTES + 1))
    with pytest.raises(FrameError, match='at most 8192 bytes'):
        framer.next_packet()
    assert not framer.unread
