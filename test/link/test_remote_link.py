# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The link to a remote port against a scripted one: slow, wrong, hostile, silent."""

import asyncio
import contextlib
import sys

import pytest
from support.event_loop import run, until
from support.remote_peer import HOME, READY, RemotePeer

from epson_driver.link.connection import READ_SIZE_BYTES
from epson_driver.link.remote_link import MAX_LINE_BYTES, LineFramer, RemoteLink
from epson_driver.remote_ethernet.client import RemoteError
from epson_driver.simple_message import FrameError, JointPosition, Status, TriState

MOVE = 'Go JA(1, 0, 0, 0, 0, 0)'


class Linked:
    """A link that runs, what it told, and the answers to its commands."""

    def __init__(self, port, password=''):
        self.told = []
        self.states = []
        self.answers = []
        self.link = RemoteLink(
            '127.0.0.1',
            port,
            ['rad'] * 6,
            on_packet=lambda packet: self.told.append(packet.message),
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

    def told_of(self, kind):
        return [message for message in self.told if isinstance(message, kind)]

    def why(self, state='backing_off'):
        return next(why for name, why in self.states if name == state)


def motion(answer):
    """Return what answers a motion with `answer`, and all else that is executed with joints."""
    return lambda line: HOME if 'Print' in line else answer


async def test_the_state_is_joints_in_rad_and_what_the_flags_say():
    peer = RemotePeer(Execute='#execute,"90 0 0 0 0 -180 0"', GetStatus=READY.lower())
    async with peer, Linked(peer.port) as there:
        await until(lambda: there.told_of(JointPosition))
    (position, *_), (status, *_) = there.told_of(JointPosition), there.told_of(Status)
    assert position.joints[:6] == pytest.approx((1.5707963, 0, 0, 0, 0, -3.1415927))
    assert status.drives_powered == TriState.FALSE
    assert status.in_motion == TriState.FALSE
    assert not there.link.joints_withheld


@pytest.mark.parametrize('flag', range(7))
async def test_no_joints_are_asked_for_where_the_controller_would_refuse(flag):
    """Of Test, Teach, SError, Safeguard, EStop, Error and Paused each forbids $Execute."""
    places = (0, 1, 4, 5, 6, 7, 8)
    flags = ''.join('1' if place in (2, places[flag]) else '0' for place in range(11))

    peer = RemotePeer(GetStatus=f'#GetStatus,{flags},0000')
    async with peer, Linked(peer.port) as there:
        await until(lambda: len(there.told) > 2)
    assert not peer.given('Execute')
    assert not there.told_of(JointPosition)
    assert there.told[0].motion_possible == TriState.FALSE


@pytest.mark.invariant(6)
async def test_while_a_statement_is_under_way_there_are_no_joints_and_the_arm_moves():
    peer = RemotePeer(Execute=motion(None))
    async with peer, Linked(peer.port) as there:
        await until(lambda: there.told_of(JointPosition))
        there.link.move(MOVE, there.answers.append)
        assert there.link.joints_withheld
        there.told.clear()
        await until(lambda: len(there.told) > 3)
        assert not there.told_of(JointPosition)
        assert all(status.in_motion == TriState.TRUE for status in there.told_of(Status)[1:])
        with pytest.raises(RemoteError, match='another command is being executed'):
            await there.link.ask('Execute,"Print Oport(1)"')


@pytest.mark.invariant(3)
async def test_abort_passes_a_statement_and_both_answers_find_who_asked():
    peer = RemotePeer(Execute=motion(None))
    peer.answers['Abort'] = '!Execute,99\r\n#Abort,0'
    async with peer, Linked(peer.port) as there:
        await until(lambda: there.told_of(JointPosition))
        there.link.move(MOVE, there.answers.append)
        await until(lambda: len(peer.given('Execute')) > 1)
        there.link.abort(there.answers.append)
        await until(lambda: len(there.answers) == 2)
    moved, stopped = there.answers
    assert moved.number == 99
    assert stopped == '0'


@pytest.mark.invariant(3)
async def test_a_motion_that_was_not_sent_yet_is_never_sent_after_a_stop():
    peer = RemotePeer(delay=0.2)
    async with peer, Linked(peer.port) as there:
        await until(lambda: there.told_of(JointPosition))
        before = len(peer.given('Execute'))
        await until(lambda: len(peer.given('Execute')) > before)  # the state is being asked
        there.link.move(MOVE, there.answers.append)
        there.link.abort(there.answers.append)
        await until(lambda: len(there.answers) == 2)
        there.told.clear()
        await until(lambda: there.told_of(JointPosition))
    assert isinstance(there.answers[0], RemoteError)
    assert not any('Go' in line for line in peer.lines)


@pytest.mark.invariant(9)
async def test_an_aborted_statement_that_is_not_answered_ends_the_connection():
    peer = RemotePeer(Execute=motion(None))
    async with peer, Linked(peer.port) as there:
        await until(lambda: there.told_of(JointPosition))
        there.link.move(MOVE, there.answers.append)
        there.link.abort(there.answers.append)
        await until(lambda: peer.connections == 2)
    assert 'the aborted command is not answered' in there.why()
    assert 'goes on to the end of the command' in there.why()


@pytest.mark.parametrize(
    ('answers', 'why'),
    [
        ({'Login': '!Login,13'}, 'Login: the password is wrong (error 13)'),
        ({'Login': '!Login,11'}, 'error 11'),
        ({'GetStatus': '#GetStatus,hello'}, "'hello' is no status"),
        ({'GetStatus': '!GetStatus,20'}, 'error 20'),
        ({'Execute': '#Execute,"1 2 3"'}, 'is no answer to Execute'),
        ({'Execute': '#Execute,"a b c d e f g"'}, 'is no answer to Execute'),
        ({'GetStatus': '#GetIO,1'}, "'#GetIO,1' is no answer to what was asked"),
        ({'GetStatus': 'hello'}, "'hello' is no answer to what was asked"),
        ({'GetStatus': '!GetStatus,' + '9' * 5000}, 'is no answer to what was asked'),
        ({'GetStatus': 'x' * 10_000}, 'a line has at most'),
        ({'GetStatus': None}, 'silent for 1 s'),
        ({'Login': None}, 'silent for 1 s'),
    ],
)
@pytest.mark.invariant(7)
def test_a_port_that_answers_wrongly_is_left_with_the_reason(answers, why):
    async def scenario():
        peer = RemotePeer(**answers)
        async with peer, Linked(peer.port, 'secret') as there:
            await until(lambda: peer.connections > 1)
        assert why in there.why()
        assert not there.told_of(JointPosition)
        assert not any('secret' in why for _, why in there.states)

    run(scenario())


async def test_a_port_that_hangs_up_at_the_login_serves_another_client():
    async def hang_up(_reader, writer):
        writer.close()

    server = await asyncio.start_server(hang_up, '127.0.0.1', 0)
    async with server, Linked(server.sockets[0].getsockname()[1]) as there:
        await until(lambda: len(there.states) > 3)
    assert 'it serves one client of Remote Ethernet and has one' in there.why()
    assert not any(state == 'connected' for state, _ in there.states)


async def test_slow_answers_are_waited_for():
    peer = RemotePeer(delay=0.4)
    async with peer, Linked(peer.port) as there:
        await until(lambda: len(there.told_of(JointPosition)) > 2)
    assert peer.connections == 1


@pytest.mark.invariant(7)
async def test_the_password_is_in_no_trace():
    peer = RemotePeer()
    async with peer, Linked(peer.port, 'secret') as there:
        taken = []
        there.link.trace = lambda _, data: taken.append(data)
        await until(lambda: there.told_of(JointPosition))
    assert b'$Login\r\n' in taken
    assert not any(b'secret' in data for data in taken)
    assert peer.given('Login') == ['$Login,secret']


@pytest.mark.parametrize('cut', [1, 2, 3, 100])
def test_lines_come_out_whole_however_they_arrive(cut):
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
async def test_a_flood_of_empty_lines_costs_a_few_calls_per_read(end):
    """A mebibyte of it goes before each answer of a state, which all come."""
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
            await until(lambda: len(there.told_of(JointPosition)) > 1)
        finally:
            sys.setprofile(None)
    assert reads >= 2 * 2**20 / READ_SIZE_BYTES
    assert calls < 20 * reads
    assert peer.connections == 1


@pytest.mark.invariant(6, 7)
@pytest.mark.parametrize('answered', ['Login', 'GetStatus', 'Abort'])
async def test_a_peer_that_sends_without_answering_is_lost_and_may_recover(answered):
    """It sends empty lines, and answers the login, the flags, or what another part asks."""
    peer = RemotePeer()
    usual = dict(peer.answers)
    order = ['Login', 'GetStatus', 'Abort', 'Execute']
    peer.answers |= dict.fromkeys(order[order.index(answered) + 1 :])
    peer.blank = 0.1

    async def ask_on(link):
        while True:
            await asyncio.sleep(0.2)
            with contextlib.suppress(ConnectionError):
                await link.ask('Abort')

    async with peer, Linked(peer.port) as there:
        asking = asyncio.create_task(ask_on(there.link))
        await until(lambda: peer.connections == 2)
        assert there.why().endswith('silent for 1 s')
        assert not there.told_of(JointPosition)
        peer.answers = usual
        await until(lambda: there.told_of(JointPosition))
        asking.cancel()
        await asyncio.gather(asking, return_exceptions=True)


@pytest.mark.invariant(7)
def test_a_line_without_end_is_refused_and_not_kept():
    framer = LineFramer()
    framer.receive_data(b'x' * (MAX_LINE_BYTES + 1))
    with pytest.raises(FrameError, match='at most 8192 bytes'):
        framer.next_packet()
    assert not framer.unread
