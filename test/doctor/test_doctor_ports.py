# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The doctor at ports that are not state ports, and on a busy machine."""

import asyncio
import errno
import os
import random
import socket
import struct

import pytest
from doctor.test_doctor_questions import (
    JOINTS,
    OFF,
    ScriptedPorts,
    answers,
    examined,
    sends,
    silent,
)
from support.examples import one_in

from epson_driver.doctor import listening
from epson_driver.doctor.findings import Level
from epson_driver.doctor.state_facts import rhythm
from epson_driver.link.connection import Connection
from epson_driver.simple_message import LITTLE_ENDIAN, encode, topic
from epson_driver.simple_message.io_messages import IoInfo


async def pings(_reader, writer):
    writer.write(encode(topic(IoInfo(1)), LITTLE_ENDIAN))
    await asyncio.sleep(600.0)


async def falls_silent(reader, writer):
    for _ in range(2):
        writer.write(b''.join(encode(topic(item), LITTLE_ENDIAN) for item in (JOINTS, OFF)))
        await asyncio.sleep(0.1)
    await reader.read()


def state_port_errors(scripted, **options):
    """Return the errors of the state port, and their remedies."""
    _, findings = examined(scripted, **options)
    wrong = [
        item for item in findings.all if item.about == 'state port' and item.level is Level.WRONG
    ]
    assert findings.exit_code == 1
    assert 'nothing is wrong' not in findings.verdict
    assert all(item.remedy for item in wrong)
    return [item.text for item in wrong], [item.remedy for item in wrong]


KINDS = [
    (
        'simple message',
        {'state': pings},
        {},
        'simple message, but neither joint states nor STATUS',
    ),
    ('silence', {'state': silent}, {}, 'accepts, but sent nothing in 1.0 s'),
    (
        'swapped',
        {'state': answers(lambda message: None), 'motion': sends(JOINTS, OFF)},
        {},
        'state and motion are swapped',
    ),
    (
        'half-open',
        {'state': falls_silent},
        {'seconds': 4.0},
        '4 messages received, then none for 3.',
    ),
    ('refused', {}, {}, 'the machine replies, but nothing listens at this port'),
]


@pytest.mark.parametrize(
    ('talks', 'options', 'sentence'), [kind[1:] for kind in KINDS], ids=[kind[0] for kind in KINDS]
)
def test_service_at_a_wrong_port_is_identified(talks, options, sentence):
    options = options if talks else {'state_port': 1}
    result, _ = state_port_errors(ScriptedPorts(**({'state': silent} | talks)), **options)
    assert sentence in result[0]
    others = [kind[3] for kind in KINDS if kind[3] != sentence]
    assert not [other for other in others if any(other in one for one in result)]


@pytest.mark.invariant(7)
@pytest.mark.parametrize(
    'noise', [b'SSH-2.0-OpenSSH_9.2\r\n', b'\0' * 400, struct.pack('<i', 2**30) * 20]
)
def test_other_protocol_at_the_state_port_is_reported(noise):
    async def send_noise(reader, writer):
        writer.write(noise)
        await reader.read()

    facts, findings = examined(ScriptedPorts(state=send_noise))
    (error,) = [item.text for item in findings.all if item.about == 'state port']
    assert 'another program replies there' in error or 'sent nothing' in error
    assert facts == {}


@pytest.mark.parametrize(
    ('error', 'sentence', 'remedy'),
    [
        (
            socket.gaierror(-2, 'Name or service not known'),
            'no machine with this name',
            'spelling',
        ),
        (TimeoutError(errno.ETIMEDOUT, 'x'), 'no reply from this address', 'firewall'),
        (OSError(errno.EHOSTUNREACH, 'x'), 'no route to this address', 'network settings'),
    ],
)
def test_reason_of_a_failed_connection_is_reported(monkeypatch, error, sentence, remedy):
    async def fails(*_args, **_options):
        raise error

    monkeypatch.setattr(asyncio.BaseEventLoop, 'create_connection', fails)
    result, remedies = state_port_errors(ScriptedPorts(state=silent))
    assert sentence in result[0]
    assert remedy in remedies[0]
    assert 'start the program' not in remedies[0]


def test_doctor_reports_a_controller_that_stops_answering_tcp(monkeypatch):
    """TCP keepalive fails, for example because a cable is unplugged."""
    begin = Connection.start

    def gone(connection):
        begin(connection)
        error = TimeoutError(errno.ETIMEDOUT, os.strerror(errno.ETIMEDOUT))
        asyncio.get_running_loop().call_later(0.7, connection.connection_lost, error)

    monkeypatch.setattr(Connection, 'start', gone)
    result, remedies = state_port_errors(ScriptedPorts(state=sends(JOINTS, OFF)))
    assert 'half-open: the connection is up, but the machine is gone' in result[0]
    assert 'cable' in remedies[0]


@pytest.mark.invariant(1)
def test_nothing_is_sent_to_a_silent_port():
    received = []

    async def motion(reader, _writer):
        received.append(await reader.read())

    result, _ = state_port_errors(ScriptedPorts(state=motion))
    assert result[0].startswith('accepts, but sent nothing')
    assert received == [b'']


@pytest.mark.parametrize('seed', range(20))
def test_period_is_correct_on_a_busy_machine(seed):
    """A busy process reads the messages in bursts, without loss."""
    draw = random.Random(seed)
    sent = [0.005 * number for number in range(1000)]
    times, read = [], 0.0
    for item in sent:
        if item > read:  # the process is delayed at random, for up to 80 ms
            read = item + (draw.uniform(0.0, 0.08) if draw.random() < 0.2 else 0.0)
        times.append(max(read, item))
    result = rhythm(times, 0.08)
    assert abs(result - 0.005) <= result.uncertainty + 0.02 * 0.005
    assert result.uncertainty < 0.0005


@pytest.mark.parametrize('seed', one_in(5, range(5)))
def test_period_of_the_profile_fits_despite_bursts_on_a_busy_machine(monkeypatch, seed):
    """The estimated period must not be halved by bursts."""
    draw = random.Random(seed)
    take = listening.Conversation._take
    late = {'until': 0.0}

    def delayed(self, packet):
        now = self.link.last_received
        if now > late['until']:
            late['until'] = now + (draw.uniform(0.0, 0.08) if draw.random() < 0.2 else 0.0)
        self.link.last_received = max(now, late['until'])
        take(self, packet)

    monkeypatch.setattr(listening.Conversation, '_take', delayed)
    from doctor.test_doctor_controller import examined as at_simulated
    from doctor.test_doctor_controller import found_at

    _, findings = at_simulated()
    assert 'profile' not in found_at(findings, Level.WRONG)
    assert 'joint states' not in found_at(findings, Level.WRONG)
