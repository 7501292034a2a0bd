# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The doctor with faulty controllers: scripted ports in virtual time."""

import asyncio
import contextlib
import dataclasses
import itertools
import types

import pytest
from support.driver_harness import MODEL
from support.event_loop import accepted, run

from epson_driver.doctor import controller_checks
from epson_driver.doctor.controller_checks import Question, check_controller
from epson_driver.doctor.findings import Findings, Level
from epson_driver.doctor.listening import NoConnectionError, conversation
from epson_driver.profiles.profile import load_controller_profile
from epson_driver.simple_message import (
    LITTLE_ENDIAN,
    Framer,
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
from epson_driver.simple_message.io_messages import IoInfo

OFF = Status(0, 0, 0, 0, 0, 2, 0)
JOINTS = JointPosition(0, joint_data([0.1] * 6))
VACANT = 1
"""A closed port of this machine."""


def sends(*messages, period=0.2, times=None):
    """Return a state port that sends the messages together, periodically."""
    data = b''.join(encode(topic(message), LITTLE_ENDIAN) for message in messages)

    async def talk(_reader, writer):
        for _ in itertools.count() if times is None else range(times):
            writer.write(data)
            await writer.drain()
            await asyncio.sleep(period)
        await asyncio.sleep(600.0)

    return talk


def answers(take):
    """Return a port that replies with `take(message)`, a message or None."""

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


async def disconnects(reader, _writer):
    await reader.read(4096)


class ScriptedPorts:
    """Servers of this machine, by the names of a profile's ports."""

    def __init__(self, **talks):
        self._talks = talks
        self._servers = {}
        self._tasks = set()

    async def __aenter__(self):
        for name, talk in self._talks.items():
            server = await asyncio.start_server(self._attended(talk), '127.0.0.1', 0)
            self._servers[name] = server
        return {name: item.sockets[0].getsockname()[1] for name, item in self._servers.items()}

    async def __aexit__(self, *_):
        await accepted()
        for name in self._servers:
            self.close(name)
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    def close(self, name):
        """Accept no further client."""
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


def examined(scripted, ask=None, **options):
    """Return the doctor's facts and findings at scripted ports."""
    findings = Findings(lambda finding: None)
    facts = {}

    async def scenario():
        async with scripted as ports:
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
    return {item.about: item.text for item in findings.all if item.level is level}


@pytest.mark.parametrize(
    ('talk', 'level', 'about', 'text'),
    [
        (sends(JOINTS), Level.WRONG, 'STATUS', 'none received'),
        (sends(OFF), Level.WRONG, 'joint states', '0 in 1.0 s'),
        (sends(JOINTS, OFF, times=1), Level.WRONG, 'joint states', '1 in 1.0 s'),
        (
            sends(JOINTS, JOINTS, times=1),
            Level.WRONG,
            'joint states',
            '2 in 1.0 s, all simultaneously',
        ),
        (sends(JOINTS, OFF, period=0.5), Level.WRONG, 'joint states', 'longest gap 500 ms'),
        (
            sends(JointPosition(0, joint_data([float('nan')] * 6)), OFF),
            Level.WRONG,
            'joints',
            'must be finite numbers',
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
            Level.INHIBIT,
            'error',
            '2313',
        ),
        (
            sends(JOINTS, Status(1, 0, 2261, 0, 0, 2, 1)),
            Level.NOTE,
            'error',
            'the last error was 2261 (the motion task was stopped, or aborted by',
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
        'last error',
        'unknown',
    ],
)
def test_wrong_messages_are_reported(talk, level, about, text):
    """Simultaneous joint states must not cause a ZeroDivisionError."""
    _, findings = examined(ScriptedPorts(state=talk))
    (finding,) = [item for item in findings.all if item.about == about]
    assert finding.level is level
    assert text in finding.text
    assert finding.remedy


@pytest.mark.parametrize('once', [True, False], ids=['simultaneous', 'two STATUS per joint state'])
def test_irregular_messages_leave_the_period_unknown(once):
    joints = [JOINTS, OFF] * 30 if once else [JOINTS, OFF, OFF]
    talk = sends(*joints, period=0.02, times=1 if once else None)
    facts, _ = examined(ScriptedPorts(state=talk))
    assert facts['state.message'] == 'joint_position'
    assert not [key for key in facts if key in ('state.period', 'state.status_with_joints')]


def test_clock_set_during_the_check_is_noted(monkeypatch):
    walls = iter((1000.0, 1007.5))
    clock = types.SimpleNamespace(time=lambda: next(walls), monotonic=lambda: 50.0)
    monkeypatch.setattr(controller_checks, 'time', clock)
    _, findings = examined(ScriptedPorts(state=sends(JOINTS, OFF)))
    assert 'was set by 7.50 s' in found(findings, Level.NOTE)['clock']


@pytest.mark.invariant(1)
@pytest.mark.parametrize(
    ('messages', 'why'),
    [
        ([JOINTS], 'no STATUS received'),
        ([JOINTS, dataclasses.replace(OFF, in_motion=1)], 'the arm is moving'),
        ([JOINTS, dataclasses.replace(OFF, drives_powered=-1)], 'the motors are on or unknown'),
    ],
)
def test_ports_are_not_opened_with_motors_possibly_on(messages, why):
    asked = []

    async def record(_reader, _writer):
        asked.append('a client')

    scripted = ScriptedPorts(state=sends(*messages), motion=record, io=record)
    _, findings = examined(scripted, may_ask=True, may_use_io=True)
    assert why in found(findings, Level.SKIPPED)['motion, I/O port']
    assert asked == []


def stop_only(message):
    """Reply to STOP only."""
    if getattr(message, 'sequence', None) == SpecialSequence.STOP_TRAJECTORY:
        return reply(JointPosition(SpecialSequence.STOP_TRAJECTORY), ReplyCode.SUCCESS)
    return None


@pytest.mark.parametrize(
    ('talk', 'level', 'text'),
    [
        (None, Level.WRONG, 'refused'),
        (silent, Level.WRONG, 'no reply to a STOP within 5 s'),
        (disconnects, Level.NOTE, 'closed by the controller immediately'),
    ],
    ids=['refused', 'silent', 'disconnects, perhaps because the driver is connected'],
)
def test_unresponsive_motion_port_is_reported(talk, level, text):
    talks = {} if talk is None else {'motion': talk}
    facts, findings = examined(ScriptedPorts(state=sends(JOINTS, OFF), **talks), may_ask=True)
    assert text in found(findings, level)['motion port']
    assert findings.verdict != 'nothing is wrong'
    assert not {'ports.motion', 'program.kind'} & facts.keys()


@pytest.mark.parametrize(
    ('talks', 'missing'),
    [
        ({'motion': answers(stop_only), 'io': disconnects}, 'IoServer (68)'),
        ({'motion': disconnects, 'io': silent}, 'MotionServer (66) and IoServer (68)'),
        ({'state': disconnects}, 'StateServer (67)'),
    ],
    ids=['io', 'motion and io', 'state'],
)
def test_unresponsive_task_of_the_spel_program_is_named(talks, missing):
    scripted = ScriptedPorts(**{'state': sends(JOINTS, OFF), **talks})
    spel = load_controller_profile('spel')
    _, findings = examined(scripted, profile=spel, may_ask=True, may_use_io=True)
    text = found(findings, Level.NOTE)['SPEL+ program']
    assert text == f'RC+ must show {missing} in its Task Manager'


def test_motion_port_that_serves_one_client_once_is_reported():
    scripted = ScriptedPorts(state=sends(JOINTS, OFF), motion=None)

    async def once(reader, writer):
        scripted.close('motion')
        await answers(stop_only)(reader, writer)

    scripted._talks['motion'] = once
    facts, findings = examined(scripted, may_ask=True)
    assert (
        found(findings, Level.WRONG)['motion port']
        == 'does not accept a new client after the last one disconnects'
    )
    assert facts['program.reply'] == 'sequence'
    # the point had no reply either: the tasks may be paused
    assert 'program.special_sequences' not in facts


def test_motion_port_that_closes_after_stop_gets_no_points():
    async def ends(reader, writer):
        await reader.read(4096)
        writer.write(encode(stop_only(JointTrajPt(-4)), LITTLE_ENDIAN))

    facts, _ = examined(ScriptedPorts(state=sends(JOINTS, OFF), motion=ends), may_ask=True)
    assert facts['program.kind'] == 'points'


@pytest.mark.invariant(1)
def test_no_point_is_sent_after_the_motors_are_switched_on():
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

    examined(ScriptedPorts(state=state, motion=answers(take)), may_ask=True)
    assert set(asked) == {
        SpecialSequence.STOP_TRAJECTORY,
        SpecialSequence.START_TRAJECTORY_STREAMING,
    }


def refused(message):
    return reply(message, ReplyCode.FAILURE) if isinstance(message, IoInfo) else None


@pytest.mark.parametrize(
    ('talk', 'text'),
    [
        (None, 'refused'),
        (silent, 'IO_INFO: no answer within 5 s'),
        (disconnects, 'IO_INFO: closed by the controller'),
        (answers(refused), 'IO_INFO: refused: its task is not running'),
    ],
    ids=['closed', 'silent', 'disconnects', 'refuses'],
)
def test_unresponsive_io_port_is_reported(talk, text):
    talks = {} if talk is None else {'io': talk}
    facts, findings = examined(ScriptedPorts(state=sends(JOINTS, OFF), **talks), may_use_io=True)
    wrong = found(findings, Level.WRONG)['I/O port']
    assert text in wrong
    assert not {'io', 'ports.io'} & facts.keys()


def answers_once(line):
    async def talk(reader, writer):
        await reader.readline()
        writer.write(line)
        await reader.read()

    return talk


@pytest.mark.parametrize(
    ('talk', 'text', 'remedy'),
    [
        (answers_once(b'!Login,10\r\n'), 'Login: ', 'password'),
        (answers_once(b'what?\r\n'), "'what?' is not a reply to Login", 'remote_port 0'),
        (silent, 'no answer within 5 s', 'remote_port 0'),
        (None, 'refused', 'remote_port 0'),
    ],
    ids=['password', 'other protocol', 'silent', 'closed'],
)
def test_unresponsive_remote_port_is_reported(talk, text, remedy):
    talks = {} if talk is None else {'remote': talk}
    allowed = {'may_ask': True} | ({'remote_port': VACANT} if talk is None else {})
    facts, findings = examined(ScriptedPorts(state=sends(JOINTS, OFF), **talks), **allowed)
    (wrong,) = [item for item in findings.all if item.about == 'remote port']
    assert wrong.level is Level.WRONG
    assert text in wrong.text
    assert remedy in wrong.remedy
    assert 'wrong' not in wrong.text  # the password
    assert not {'ports.remote', 'program.motors'} & facts.keys()


def test_exclusive_state_port_serves_one_client():
    scripted = ScriptedPorts(state=None)

    async def first(reader, writer):
        scripted.close('state')
        await sends(JOINTS, OFF)(reader, writer)

    scripted._talks['state'] = first
    facts, _ = examined(scripted, may_ask=True)
    assert facts['server.state_clients'] == 1


def test_user_is_asked_for_each_joint_and_the_tool():
    asked = []

    async def user(sentence):
        asked.append(sentence)
        return '' if sentence.startswith('X Y Z') else 's'

    _, findings = examined(ScriptedPorts(state=sends(JOINTS, OFF)), user)
    assert [sentence[:6] for sentence in asked[:6]] == [f'Jog J{n}' for n in range(1, 7)]
    assert asked[6].startswith('X Y Z U V W')
    assert {f'joint {n}' for n in range(1, 7)} | {'tool0'} <= found(findings, Level.SKIPPED).keys()


async def test_unreachable_address_is_reported_with_the_timeout(monkeypatch):
    async def never(*_args, **_options):
        await asyncio.sleep(3600.0)

    monkeypatch.setattr(asyncio.BaseEventLoop, 'create_connection', never)
    with pytest.raises(NoConnectionError, match='no answer within 1 s'):
        async with conversation('192.0.2.1', 11002):
            pass
