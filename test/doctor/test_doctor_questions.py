# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The doctor at controllers that do something wrong: scripted ports, in virtual time."""

import asyncio
import contextlib
import dataclasses
import itertools
import types

import pytest
from support.driver_harness import MODEL
from support.event_loop import accepted, run

from epson_driver.doctor import controller_checks, listening
from epson_driver.doctor.controller_checks import Question, check_controller
from epson_driver.doctor.findings import Findings, Level
from epson_driver.doctor.listening import NoConnectionError, conversation
from epson_driver.profiles.profile import load_controller_profile
from epson_driver.simple_message import (
    LITTLE_ENDIAN,
    Framer,
    IoInfo,
    JointPosition,
    JointTrajPt,
    ReplyCode,
    SpecialSequence,
    Status,
    TriState,
    decode,
    encode,
    joint_data,
    reply,
    topic,
)

OFF = Status(0, 0, 0, 0, 0, 2, 0)
JOINTS = JointPosition(0, joint_data([0.1] * 6))
VACANT = 1
"""A port of this machine at which nobody listens."""


def sends(*messages, period=0.2, times=None):
    """Return a state port that sends the messages in one piece, again and again."""
    data = b''.join(encode(topic(message), LITTLE_ENDIAN) for message in messages)

    async def talk(_reader, writer):
        for _ in itertools.count() if times is None else range(times):
            writer.write(data)
            await writer.drain()
            await asyncio.sleep(period)
        await asyncio.sleep(600.0)

    return talk


def answers(take):
    """Return a port at which `take(message)` gives the reply to a request: a message or None."""

    async def talk(reader, writer):
        framer = Framer()
        while data := await reader.read(4096):
            framer.receive_data(data)
            while (frame := framer.next_frame()) is not None:
                if (message := take(decode(frame).message)) is not None:
                    writer.write(encode(message, LITTLE_ENDIAN))

    return talk


async def silent(reader, _writer):
    await reader.read()


async def hangs_up(reader, _writer):
    await reader.read(4096)


class Served:
    """Servers of this machine, by the names of a profile's ports."""

    def __init__(self, **talks):
        self._talks = talks
        self._servers = {}
        self._tasks = set()

    async def __aenter__(self):
        for name, talk in self._talks.items():
            server = await asyncio.start_server(self._attended(talk), '127.0.0.1', 0)
            self._servers[name] = server
        return {name: each.sockets[0].getsockname()[1] for name, each in self._servers.items()}

    async def __aexit__(self, *_):
        await accepted()
        for name in self._servers:
            self.close(name)
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    def close(self, name):
        """Let nobody else in."""
        self._servers[name].close()

    def _attended(self, talk):
        def accept(reader, writer):
            self._tasks.add(asyncio.create_task(attend(reader, writer)))

        async def attend(reader, writer):
            try:
                with contextlib.suppress(ConnectionError):
                    await talk(reader, writer)
            finally:
                writer.close()

        return accept


def examined(served, ask=None, **options):
    """Return facts and findings of the doctor at ports that a test has scripted."""
    findings = Findings(lambda finding: None)
    facts = {}

    async def scenario():
        async with served as ports:
            question = Question(
                host='127.0.0.1',
                profile=load_controller_profile('simulated'),
                model=MODEL,
                state_port=ports['state'],
                motion_port=ports.get('motion', VACANT),
                io_port=ports.get('io', VACANT),
                remote_port=ports.get('remote', 0),
                password='wrong',
                seconds=1.0,
                may_ask=False,
                may_use_io=False,
            )
            facts.update(
                await check_controller(dataclasses.replace(question, **options), findings, ask)
            )

    run(scenario(), 300.0)
    return facts, findings


def found(findings, level):
    return {each.about: each.found for each in findings.all if each.level is level}


@pytest.mark.parametrize(
    ('talk', 'level', 'about', 'said'),
    [
        (sends(JOINTS), Level.WRONG, 'STATUS', 'none came'),
        (sends(OFF), Level.WRONG, 'joint states', '0 in 1.0 s'),
        (sends(JOINTS, OFF, times=1), Level.WRONG, 'joint states', '1 in 1.0 s'),
        (sends(JOINTS, JOINTS, times=1), Level.WRONG, 'joint states', '2 in 1.0 s, all at once'),
        (sends(JOINTS, OFF, period=0.5), Level.WRONG, 'joint states', 'longest gap 500 ms'),
        (
            sends(JointPosition(0, joint_data([float('nan')] * 6)), OFF),
            Level.WRONG,
            'joints',
            'are not all numbers',
        ),
        (
            sends(JointPosition(0, joint_data([0.0, 90.0])), OFF),
            Level.WRONG,
            'joints',
            'joint_2 = 90.0000 is outside',
        ),
        (
            sends(JointPosition(0, joint_data([0.0] * 6 + [0.2])), OFF),
            Level.NOTE,
            'joints',
            'joint 7 is not 0, but a c3_a601s has 6',
        ),
        (
            sends(JOINTS, Status(0, 0, 2313, 1, 0, 2, 0)),
            Level.HELD,
            'error',
            '2313',
        ),
        (
            sends(JOINTS, Status(0, 0, 0, 0, TriState.UNKNOWN, 2, TriState.UNKNOWN)),
            Level.NOTE,
            'STATUS fields',
            'in_motion, motion_possible UNKNOWN',
        ),
    ],
    ids=[
        'no STATUS',
        'no joints',
        'one',
        'all at once',
        'gaps',
        'no numbers',
        'degrees',
        'seven joints',
        'error',
        'unknown',
    ],
)
def test_what_is_wrong_with_the_messages_is_named(talk, level, about, said):
    """Two joint states in one piece of the stream ended the doctor with a ZeroDivisionError."""
    _, findings = examined(Served(state=talk))
    (finding,) = [each for each in findings.all if each.about == about]
    assert finding.level is level
    assert said in finding.found
    assert finding.remedy


@pytest.mark.parametrize('once', [True, False], ids=['all at once', 'two STATUS for each'])
def test_messages_without_a_rhythm_leave_the_period_unknown(once):
    joints = [JOINTS, OFF] * 30 if once else [JOINTS, OFF, OFF]
    talk = sends(*joints, period=0.02, times=1 if once else None)
    facts, _ = examined(Served(state=talk))
    assert facts['state.message'] == 'joint_position'
    assert not [key for key in facts if key in ('state.period', 'state.status_with_joints')]


def test_a_clock_that_was_set_meanwhile_is_noted(monkeypatch):
    walls = iter((1000.0, 1007.5))
    clock = types.SimpleNamespace(time=lambda: next(walls), monotonic=lambda: 50.0)
    monkeypatch.setattr(controller_checks, 'time', clock)
    _, findings = examined(Served(state=sends(JOINTS, OFF)))
    assert 'was set by 7.50 s' in found(findings, Level.NOTE)['clock']


@pytest.mark.invariant(1)
@pytest.mark.parametrize(
    ('messages', 'why'),
    [
        ([JOINTS], 'no STATUS came'),
        ([JOINTS, dataclasses.replace(OFF, in_motion=1)], 'the arm moves'),
        ([JOINTS, dataclasses.replace(OFF, drives_powered=-1)], 'or nobody knows'),
    ],
)
def test_what_may_stand_on_the_motors_is_left_alone(messages, why):
    asked = []

    async def noted(_reader, _writer):
        asked.append('a client')

    served = Served(state=sends(*messages), motion=noted, io=noted)
    _, findings = examined(served, may_ask=True, may_use_io=True)
    assert why in found(findings, Level.SKIPPED)['motion, I/O port']
    assert asked == []


def stop_only(message):
    """Answer a STOP; nothing else has a reply."""
    if getattr(message, 'sequence', None) == SpecialSequence.STOP_TRAJECTORY:
        return reply(JointPosition(SpecialSequence.STOP_TRAJECTORY), ReplyCode.SUCCESS)
    return None


@pytest.mark.parametrize(
    ('talk', 'level', 'said'),
    [
        (None, Level.WRONG, 'refused'),
        (silent, Level.WRONG, 'no reply to a STOP within 5 s'),
        (hangs_up, Level.NOTE, 'closed by the controller as soon as it was open'),
    ],
    ids=['nobody', 'silent', 'hangs up: it may be the driver that has the place'],
)
def test_a_motion_port_that_does_not_answer_is_told(talk, level, said):
    talks = {} if talk is None else {'motion': talk}
    facts, findings = examined(Served(state=sends(JOINTS, OFF), **talks), may_ask=True)
    assert said in found(findings, level)['motion port']
    assert findings.verdict != 'nothing is wrong'
    assert not {'ports.motion', 'program.kind'} & facts.keys()


@pytest.mark.parametrize(
    ('talks', 'missing'),
    [
        ({'motion': answers(stop_only), 'io': hangs_up}, 'IoServer (68)'),
        ({'motion': hangs_up, 'io': silent}, 'MotionServer (66) and IoServer (68)'),
        ({'state': hangs_up}, 'StateServer (67)'),
    ],
    ids=['io', 'motion and io', 'state'],
)
def test_the_task_of_the_spel_program_that_does_not_serve_is_named(talks, missing):
    served = Served(**{'state': sends(JOINTS, OFF), **talks})
    spel = load_controller_profile('spel')
    _, findings = examined(served, profile=spel, may_ask=True, may_use_io=True)
    said = found(findings, Level.NOTE)['SPEL+ program']
    assert said == f'RC+ must show {missing} in its Task Manager'


def test_a_motion_port_that_serves_one_client_once_is_told():
    served = Served(state=sends(JOINTS, OFF), motion=None)

    async def once(reader, writer):
        served.close('motion')
        await answers(stop_only)(reader, writer)

    served._talks['motion'] = once
    facts, findings = examined(served, may_ask=True)
    assert found(findings, Level.WRONG)['motion port'] == 'serves nobody after its client has left'
    assert facts['program.reply'] == 'sequence'
    # nor had the point a reply: the tasks may be paused
    assert 'program.special_sequences' not in facts


def test_a_motion_port_that_hangs_up_after_the_stop_is_asked_nothing_more():
    async def ends(reader, writer):
        await reader.read(4096)
        writer.write(encode(stop_only(JointTrajPt(-4)), LITTLE_ENDIAN))

    facts, _ = examined(Served(state=sends(JOINTS, OFF), motion=ends), may_ask=True)
    assert facts['program.kind'] == 'points'


@pytest.mark.invariant(1)
def test_no_point_is_sent_to_motors_that_were_switched_on_meanwhile():
    motors = {'on': 0}
    asked = []

    async def state(_reader, writer):
        while True:
            for message in (JOINTS, dataclasses.replace(OFF, drives_powered=motors['on'])):
                writer.write(encode(topic(message), LITTLE_ENDIAN))
            await writer.drain()
            await asyncio.sleep(0.2)

    def take(message):
        asked.append(message.sequence)
        motors['on'] = 1
        return stop_only(message)

    examined(Served(state=state, motion=answers(take)), may_ask=True)
    assert set(asked) == {
        SpecialSequence.STOP_TRAJECTORY,
        SpecialSequence.START_TRAJECTORY_STREAMING,
    }


def refused(message):
    return reply(message, ReplyCode.FAILURE) if isinstance(message, IoInfo) else None


@pytest.mark.parametrize(
    ('talk', 'said'),
    [
        (None, 'refused'),
        (silent, 'IO_INFO: no answer within 5 s'),
        (hangs_up, 'IO_INFO: closed by the controller'),
        (answers(refused), 'IO_INFO: refused: its task does not run'),
    ],
    ids=['nobody', 'silent', 'hangs up', 'refuses'],
)
def test_an_io_port_that_does_not_answer_is_told(talk, said):
    talks = {} if talk is None else {'io': talk}
    facts, findings = examined(Served(state=sends(JOINTS, OFF), **talks), may_use_io=True)
    wrong = found(findings, Level.WRONG)['I/O port']
    assert said in wrong
    assert not {'io', 'ports.io'} & facts.keys()


def says(line):
    async def talk(reader, writer):
        await reader.readline()
        writer.write(line)
        await reader.read()

    return talk


@pytest.mark.parametrize(
    ('talk', 'said', 'remedy'),
    [
        (says(b'!Login,10\r\n'), 'Login: ', 'password'),
        (says(b'what?\r\n'), "'what?' is no answer to Login", 'remote_port 0'),
        (silent, 'no answer within 5 s', 'remote_port 0'),
        (None, 'refused', 'remote_port 0'),
    ],
    ids=['password', 'something else', 'silent', 'nobody'],
)
def test_a_remote_port_that_does_not_answer_is_told(talk, said, remedy):
    talks = {} if talk is None else {'remote': talk}
    allowed = {'may_ask': True} | ({'remote_port': VACANT} if talk is None else {})
    facts, findings = examined(Served(state=sends(JOINTS, OFF), **talks), **allowed)
    (wrong,) = [each for each in findings.all if each.about == 'remote port']
    assert wrong.level is Level.WRONG
    assert said in wrong.found
    assert remedy in wrong.remedy
    assert 'wrong' not in wrong.found  # the password
    assert not {'ports.remote', 'program.motors'} & facts.keys()


def test_a_state_port_that_lets_nobody_else_in_serves_one_client():
    served = Served(state=None)

    async def first(reader, writer):
        served.close('state')
        await sends(JOINTS, OFF)(reader, writer)

    served._talks['state'] = first
    facts, _ = examined(served, may_ask=True)
    assert facts['server.state_clients'] == 1


def test_a_person_is_asked_for_each_joint_and_for_the_tool():
    asked = []

    async def person(sentence):
        asked.append(sentence)
        return '' if sentence.startswith('X Y Z') else 's'

    _, findings = examined(Served(state=sends(JOINTS, OFF)), person)
    assert [sentence[:6] for sentence in asked[:6]] == [f'Jog J{n}' for n in range(1, 7)]
    assert asked[6].startswith('X Y Z U V W')
    assert {f'joint {n}' for n in range(1, 7)} | {'tool0'} <= found(findings, Level.SKIPPED).keys()


async def test_an_address_that_never_answers_is_told_with_the_time(monkeypatch):
    async def never(*_args, **_options):
        await asyncio.sleep(3600.0)

    monkeypatch.setattr(listening.asyncio, 'open_connection', never)
    with pytest.raises(NoConnectionError, match='no answer within 5 s'):
        async with conversation('192.0.2.1', 11002):
            pass
