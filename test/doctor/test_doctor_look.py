# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The first look at a controller: which profile and model fit the ports that answer."""

import asyncio
import re

import pytest
from doctor.test_doctor_questions import ScriptedPorts, answers_once, silent
from support.driver_harness import simulated
from support.event_loop import run
from support.sim_process import vacant_port

from epson_driver.doctor.findings import Findings, Level
from epson_driver.doctor.look import look_at, report_look
from epson_driver.inputs import InputError
from epson_driver.remote_ethernet import answers
from epson_driver.remote_ethernet.client import logged_in
from epson_driver.rtmc.transport import TransportError


def looked(profile, *, remote=True, real=False, monkeypatch=None, model=None):
    """Return a look at a simulated controller. real: it does not report that it is simulated."""
    if real:
        monkeypatch.setattr(answers, '_SIMULATED', re.compile('never'))
    result = []

    async def scenario():
        async with simulated(profile=profile, model=model) as (_, ports):
            port = ports.remote if remote else 0
            result.append(await look_at('127.0.0.1', '', port, ports.state, 0))

    run(scenario(), 60.0)
    return result[0]


def findings_of(look):
    findings = Findings(lambda finding: None)
    return report_look(look, findings), {item.level: item for item in findings.all}


@pytest.mark.parametrize('profile', ['remote', 'spel', 'simulated'])
def test_simulated_controller_reports_its_profile_and_model(profile):
    look = looked(profile, model='t6_602s')
    assert (look.profile, look.model, look.simulated) == (profile, 't6_602s', True)


@pytest.mark.parametrize('profile', ['remote', 'spel'])
def test_real_controller_with_remote_ethernet_is_identified(monkeypatch, profile):
    look = looked(profile, real=True, monkeypatch=monkeypatch, model='t6_602s')
    assert (look.profile, look.model, look.simulated) == (profile, 't6_602s', False)


@pytest.mark.parametrize('profile', ['simulated', 'generic', 'abb', 'fanuc'])
def test_controller_without_remote_ethernet_is_identified_by_its_messages(profile):
    look = looked(profile, remote=False)
    assert (look.profile, look.model) == (profile, '')
    good, found = findings_of(look)
    assert good
    assert found[Level.NOTE].remedy == 'give it: --robot MODEL'


def test_model_unknown_to_this_package_is_not_used(monkeypatch):
    monkeypatch.setattr('epson_driver.doctor.look.model_name', _unknown)
    look = looked('remote', real=True, monkeypatch=monkeypatch)
    assert look.model == ''
    assert 'a model that is not known' in next(iter(look.answers.values()))


def _unknown(name):
    raise InputError(name)


@pytest.mark.invariant(1)
def test_inv1_only_remote_and_state_ports_are_opened(opened):
    look = looked('spel')
    assert set(opened) == {look.state_port}


@pytest.mark.parametrize(
    ('talk', 'text', 'remedy'),
    [
        (answers_once(b'!Login,13\r\n'), 'the password is wrong', '--password-variable'),
        (silent, 'no reply', 'control device to Remote Ethernet'),
        (None, 'no controller answers', 'control device to Remote Ethernet'),
    ],
    ids=['password', 'silent', 'closed'],
)
def test_unidentifiable_controller_is_reported_as_wrong(talk, text, remedy):
    result = []

    async def scenario():
        async with ScriptedPorts(**({} if talk is None else {'remote': talk})) as ports:
            remote = ports.get('remote', vacant_port())
            result.append(await look_at('127.0.0.1', 'secret', remote, vacant_port(), 0))

    run(scenario(), 60.0)
    good, found = findings_of(result[0])
    assert not good
    assert text in found[Level.WRONG].text
    assert remedy in found[Level.WRONG].remedy
    assert 'secret' not in str(found)


def test_state_port_that_closes_each_connection_is_tried_twice():
    connections = []

    async def leave(reader, writer):
        connections.append(1)

    async def scenario():
        async with ScriptedPorts(state=leave) as ports:
            look = await look_at('127.0.0.1', '', 0, ports['state'], 0)
            assert look.answers == {ports['state']: 'closes each connection'}

    run(scenario(), 60.0)
    assert len(connections) == 2


def test_other_client_of_the_remote_port_is_named():
    result = []

    async def scenario():
        async with (
            simulated(profile='remote') as (_, ports),
            logged_in('127.0.0.1', ports.remote, 1000.0),
        ):
            result.append(await look_at('127.0.0.1', '', ports.remote, ports.state, 0))

    run(scenario(), 60.0)
    good, found = findings_of(result[0])
    assert not good
    assert 'another client may be connected' in found[Level.WRONG].text


@pytest.mark.parametrize(
    ('found', 'profile', 'level', 'text'),
    [
        (True, 'rtmc', Level.NOTE, 'nothing was sent'),
        (False, '', Level.WRONG, 'port 7000: no Real-time Motion Control'),
        (TransportError('build epson_rtmc'), '', Level.NOTE, 'not looked for'),
    ],
)
def test_real_time_motion_is_reported_only_if_it_is_discovered(
    monkeypatch, found, profile, level, text
):
    async def is_there(_host, _port):
        if isinstance(found, Exception):
            raise found
        return found

    monkeypatch.setattr('epson_driver.doctor.look.is_there', is_there)
    look = asyncio.run(look_at('127.0.0.1', '', 0, 0))
    look.model = 'c8_c901s'
    good, findings = findings_of(look)
    assert (look.profile, good) == (profile, found is True)
    assert text in findings[level].text
    assert ('epson_rtmc' in findings[level].remedy) is isinstance(found, Exception)
