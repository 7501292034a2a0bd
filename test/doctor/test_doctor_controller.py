# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The doctor at the simulated controller: what it learns, what is wrong, what it leaves alone."""

import asyncio
import dataclasses
import struct

import numpy as np
import pytest
from support.driver_harness import MODEL, simulated
from support.event_loop import run
from support.examples import one_in

from epson_driver.doctor import listening
from epson_driver.doctor.asking import IO_KEYS
from epson_driver.doctor.controller_checks import Question, check_controller
from epson_driver.doctor.findings import Findings, Level
from epson_driver.doctor.learning import profile_text, unknown, value_of, why_not
from epson_driver.doctor.why_not import ARM
from epson_driver.profiles.profile import load_controller_profile
from epson_driver.profiles.profile_rules import RULES
from epson_driver.remote_ethernet.client import logged_in
from epson_driver.share import share_file
from epson_driver.sim_controller.condition.states import Event
from epson_driver.sim_controller.faults.fault_kinds import parse
from epson_driver.sim_controller.remote import status_words

NAMES = (
    'abb',
    'fanuc',
    'generic',
    'motoman',
    'rc700a',
    'simulated',
    'spel',
)
KINDS = [
    pytest.param(name, marks=() if name == 'simulated' else pytest.mark.slow) for name in NAMES
]

IO_OF_SPEL = {'flags': 64}
"""Memory bits that the program serves (IO_MEMORY_BYTES of config.inc); the controller has 512."""

SEEN = {
    'byte_order',
    'mode',
    'state.period',
    'state.joint_positions_per_status',
    'state.status_with_joints',
    'state.message',
    'state.in_motion',
    'state.motion_possible',
    'server.state_clients',
    'program.kind',
    'io',
    'ports.state',
    'ports.motion',
    'ports.io',
}
"""What is found out of every profile, but for NOT_OF. More depends on its kind."""

NOT_OF = {
    # one client more replaces one; its I/O answers other messages
    'motoman': {'server.state_clients', 'io', 'ports.io'},
}

BOOTED_S = 1.0
"""A SPEL+ program has opened its ports by then."""


def question(profile, ports, **options):
    allowed = {'may_ask': False, 'may_use_io': False, 'seconds': 5.0} | options
    return Question(
        host='127.0.0.1',
        profile=profile,
        model=MODEL,
        state_port=ports.state,
        motion_port=ports.motion,
        io_port=ports.io,
        remote_port=ports.remote if profile.ports.remote else 0,
        password='',
        **allowed,
    )


def examined(profile='simulated', prepare=None, meanwhile=None, **options):
    """Return facts and findings of the doctor at a simulated controller, in virtual time."""
    held = load_controller_profile(profile)
    findings = Findings(lambda finding: None)
    result = {}

    async def scenario():
        async with simulated(profile=profile) as (controller, ports):
            if held.spel.project:
                await asyncio.sleep(BOOTED_S)
            if prepare is not None:
                prepare(controller)
            task = asyncio.create_task(meanwhile(controller, ports)) if meanwhile else None
            before = controller.joint_position().joints
            result['facts'] = await check_controller(question(held, ports, **options), findings)
            assert np.array_equal(controller.joint_position().joints, before), 'the arm moved'
            if task is not None:
                task.cancel()

    run(scenario(), 120.0)
    return result['facts'], findings


def points_of(profile):
    """Return how many points there are of each type."""
    return {name: getattr(profile, name) for name in IO_KEYS.values()}


def told(findings, level):
    return {each.about: each.found for each in findings.all if each.level is level}


def test_every_profile_is_learned():
    folder = share_file('config', 'controllers', 'simulated.yaml').parent
    there = {path.stem for path in folder.glob('*.yaml')}
    assert there - {'remote'} == set(NAMES)  # of that there is nothing to learn


def test_an_owner_who_has_only_remote_ethernet_is_told_what_there_is():
    facts, findings = examined('remote')
    assert facts == {'ports.remote': facts['ports.remote']}
    assert told(findings, Level.OK)['joints'].startswith('within the limits of a c3_a601s: 0.0')
    assert 'off: the driver switches them on' in told(findings, Level.OK)[ARM]
    assert 'no streams, no plans of points' in told(findings, Level.NOTE)['Remote Ethernet alone']


def test_with_nothing_but_remote_ethernet_an_open_door_is_found():
    _, findings = examined('remote', prepare=lambda controller: controller.apply(Event.DOOR_OPEN))
    assert any('door is open' in each.found for each in findings.all)


def test_a_driver_that_has_the_only_place_is_named():
    held, findings = load_controller_profile('remote'), Findings(lambda finding: None)

    async def scenario():
        async with (
            simulated(profile='remote') as (_, ports),
            logged_in('127.0.0.1', ports.remote, 1000.0),
        ):
            await check_controller(question(held, ports), findings)

    run(scenario(), 120.0)
    (wrong,) = [each for each in findings.all if each.level is Level.WRONG]
    assert 'closed by the controller before it answered Login' in wrong.found
    assert 'stop the other one, which may be the driver' in wrong.remedy


@pytest.mark.parametrize('name', KINDS)
def test_a_learned_profile_has_the_keys_of_the_original_or_says_why_not(tmp_path, name):
    original = load_controller_profile(name)
    facts, _ = examined(name, may_ask=True, may_use_io=True)
    assert facts.keys() >= SEEN - NOT_OF.get(name, set())
    path = tmp_path / 'learned.yaml'
    path.write_text(profile_text('learned', facts, 'generic', 'in a test'), encoding='utf-8')
    learned = load_controller_profile(str(path))  # as the profile's own tests load it
    assert learned.name == 'learned'
    assert all(sentence.endswith('.') for sentence in learned.approximate)
    missing = set(unknown(facts))
    for key in set(RULES) - missing - {'name', 'description', 'approximate'}:
        if key.startswith('ports.'):
            continue  # those of this test
        found, true = value_of(learned, key), value_of(original, key)
        if key == 'state.period':
            assert found == pytest.approx(true, rel=0.02), key
        elif key == 'program.motors' and name != 'motoman':
            seen = 'restart' if name == 'spel' else 'remote_ethernet'
            assert (found, true) == (seen, original.program.motors)
        elif key == 'io':
            ours, theirs = points_of(found), points_of(true)
            assert ours == (theirs | IO_OF_SPEL if name == 'spel' else theirs)
        else:
            assert found == true, key
    text = path.read_text(encoding='utf-8')
    for key in missing:
        assert f'# * {key}: {why_not(key)}' in text
    assert ('# * io: of it the numbers of points only' in text) == ('io' in facts)


@pytest.mark.parametrize('name', KINDS)
def test_the_simulator_with_a_learned_profile_behaves_as_the_original(tmp_path, name):
    facts, _ = examined(name, may_ask=True, may_use_io=True)
    path = tmp_path / 'learned.yaml'
    path.write_text(profile_text('learned', facts, 'generic', 'in a test'), encoding='utf-8')
    again, _ = examined(str(path), may_ask=True, may_use_io=True)
    same = {key for key in facts if not key.startswith('ports.')} - {'state.period'}
    if name == 'spel':
        same.remove('program.motors')  # no program runs there that would have to be stopped
    assert {key: again.get(key) for key in same} == {key: facts[key] for key in same}
    assert again['state.period'] == pytest.approx(facts['state.period'], rel=0.02)


def test_every_key_can_be_found_out_or_has_a_reason_why_not():
    for key in RULES:
        assert why_not(key)


@pytest.mark.parametrize('name', KINDS)
def test_a_profile_fits_its_own_controller(name):
    _, findings = examined(name, may_ask=True)
    assert told(findings, Level.WRONG) == {}
    assert 'fits in' in told(findings, Level.OK)['profile']


def test_another_profile_does_not_fit_and_the_key_is_named():
    held = load_controller_profile('fanuc')
    findings = Findings(lambda finding: None)

    async def scenario():
        async with simulated(profile='simulated') as (_, ports):
            await check_controller(question(held, ports), findings)

    run(scenario(), 120.0)
    wrong = [each.found for each in findings.all if each.level is Level.WRONG]
    assert 'byte_order is little, the profile fanuc says big' in wrong
    assert any(each.startswith('state.period is 0.00') for each in wrong)
    assert findings.exit_code == 1


@pytest.mark.invariant(1)
def test_unless_told_otherwise_only_the_state_port_is_opened(monkeypatch):
    opened = []
    connect = asyncio.open_connection

    async def seen(*where, **options):
        opened.extend(where[1:])
        return await connect(*where, **options)

    monkeypatch.setattr(asyncio, 'open_connection', seen)
    held = load_controller_profile('rc700a')
    findings = Findings(lambda finding: None)
    listening = []

    async def scenario():
        async with simulated(profile=held) as (_, ports):
            opened.clear()
            await check_controller(question(held, ports), findings)
            listening.append(ports)

    run(scenario(), 120.0)
    assert listening[0].state in opened
    assert not {listening[0].motion, listening[0].io, listening[0].remote} & set(opened)
    assert 'motion, I/O, remote port' in told(findings, Level.SKIPPED)


@pytest.mark.invariant(1)
@pytest.mark.parametrize('name', ['simulated', 'motoman'])
def test_with_motors_on_nothing_is_asked(name):
    def motors_on(controller):
        controller.apply(Event.MOTORS_ON)

    facts, findings = examined(name, prepare=motors_on, may_ask=True, may_use_io=True)
    assert 'motors are on' in told(findings, Level.SKIPPED)['motion, I/O port']
    assert 'program.kind' not in facts


def test_a_controller_that_vanishes_while_it_is_examined_is_told_and_that_is_all():
    def cut(controller):
        controller.faults.start(parse('cut:port=state,after=2,for=60'))

    facts, findings = examined(prepare=cut, may_ask=True)
    assert facts == {}
    assert 'after 2.' in told(findings, Level.WRONG)['state port']
    assert findings.exit_code == 1


def test_a_controller_that_falls_silent_is_told():
    def silent(controller):
        controller.faults.start(parse('half_open:port=state'))

    _, findings = examined(prepare=silent)
    assert told(findings, Level.WRONG)['state port'].startswith('accepts, but nothing came in 5')


@pytest.mark.parametrize(('lateness', 'level'), [(0.0, Level.WRONG), (0.7, Level.NOTE)])
def test_a_stream_that_falls_silent_is_wrong_unless_this_machine_is_too_busy_to_tell(
    monkeypatch, lateness, level
):
    def silent(controller):
        enabled(controller)
        controller.faults.start(parse('half_open:port=state,after=1'))

    async def late(self):
        self.heard.lateness = lateness

    monkeypatch.setattr(listening.Conversation, '_watch_lateness', late)
    _, findings = examined(prepare=silent)
    assert told(findings, level)['state port'].endswith('half-open')
    assert findings.exit_code == int(level is Level.WRONG)
    assert ('too busy to tell' in findings.verdict) == (level is Level.NOTE)


def test_a_client_that_is_there_already_is_told():
    held = load_controller_profile('fanuc')
    findings = Findings(lambda finding: None)

    async def scenario():
        async with simulated(profile='fanuc') as (_, ports):
            _, writer = await asyncio.open_connection('127.0.0.1', ports.state)
            await asyncio.sleep(1.0)
            assert await check_controller(question(held, ports), findings) == {}
            writer.close()

    run(scenario(), 120.0)
    assert 'it has a client already' in told(findings, Level.WRONG)['state port']


def test_nobody_there_is_told_with_the_reason():
    held = load_controller_profile('simulated')
    findings = Findings(lambda finding: None)

    async def scenario():
        async with simulated() as (_, ports):
            free = dataclasses.replace(question(held, ports), state_port=1)
            assert await check_controller(free, findings) == {}

    run(scenario(), 120.0)
    assert 'refused' in told(findings, Level.WRONG)['state port'].lower()


@pytest.mark.invariant(7)
@pytest.mark.parametrize(
    'noise', [b'SSH-2.0-OpenSSH_9.2\r\n', b'\0' * 400, struct.pack('<i', 2**30) * 20]
)
def test_something_else_at_the_port_is_told(noise):
    held = load_controller_profile('simulated')
    findings = Findings(lambda finding: None)

    async def chatter(_reader, writer):
        writer.write(noise)
        await asyncio.sleep(30)
        writer.close()

    async def scenario():
        server = await asyncio.start_server(chatter, '127.0.0.1', 0)
        port = server.sockets[0].getsockname()[1]
        async with simulated() as (_, ports):
            other = dataclasses.replace(question(held, ports), state_port=port)
            assert await check_controller(other, findings) == {}
        server.close()
        await asyncio.sleep(31)

    run(scenario(), 120.0)
    said = told(findings, Level.WRONG)['state port']
    assert 'something else answers there' in said or 'nothing came' in said


def test_an_e_stop_is_told_with_what_helps():
    def press(controller):
        controller.press_estop()

    _, findings = examined(prepare=press)
    assert 'pressed' in told(findings, Level.HELD)['E-stop']
    assert all(each.remedy for each in findings.all if each.level is Level.WRONG)


def enabled(controller):
    controller.apply(Event.MOTORS_ON)


def at_manual(controller):
    enabled(controller)
    controller.apply(Event.MODE_MANUAL)


def paused(controller):
    enabled(controller)
    controller.apply(Event.PAUSE)


def ended(controller):
    enabled(controller)
    controller.apply(Event.STOP)


def door_open(controller):
    enabled(controller)
    controller.apply(Event.DOOR_OPEN)


@pytest.mark.parametrize(
    ('prepare', 'about', 'said', 'remedy'),
    [
        (lambda controller: None, 'motors', 'the motors are off', 'enable'),
        (at_manual, 'key switch', 'the key switch is at MANUAL', 'AUTO'),
        (door_open, 'motors', 'the motors are off', 'close the safeguard'),
        (paused, 'the arm', 'motion is not possible (a safeguard is open', 'continue'),
    ],
)
def test_what_keeps_the_arm_from_moving_is_said_first(prepare, about, said, remedy):
    """With the key at MANUAL, or an open door, the doctor said that nothing is wrong."""
    _, findings = examined(prepare=prepare)
    first = findings.all[0]
    assert (first.level, first.about) == (Level.HELD, about)
    assert said in first.found
    assert remedy in first.remedy
    assert findings.verdict == f'the arm cannot move: {first.found}'
    assert findings.exit_code == 1


def test_an_arm_that_could_move_is_said_to():
    _, findings = examined(prepare=enabled)
    assert findings.all[0].level is Level.OK
    assert findings.verdict == 'nothing is wrong'


@pytest.mark.parametrize(
    ('prepare', 'about', 'said'),
    one_in(
        3,
        [
            (door_open, 'safeguard', 'the safeguard door is open'),
            (lambda controller: controller.press_estop(), 'E-stop', 'pressed'),
            (lambda controller: controller.apply(Event.MODE_MANUAL), 'key switch', 'MANUAL'),
            (paused, 'pause', 'the tasks are paused'),
            (ended, 'main', 'main does not run'),
        ],
        several=True,
    ),
)
def test_the_remote_port_tells_what_status_does_not(prepare, about, said):
    _, findings = examined('rc700a', prepare=prepare, may_ask=True)
    held = [each for each in findings.all if each.level is Level.HELD]
    assert held[0].about == about
    assert said in held[0].found
    assert len({each.about for each in held}) == len(held)
    assert 'the arm' not in [each.about for each in held]  # which of three it is, is told
    assert 'Remote Ethernet answers: ' in told(findings, Level.OK)['remote port']


@pytest.mark.slow
def test_tasks_that_a_door_has_paused_are_no_other_profile():
    """A START that has no answer until the tasks go on told of a program that knows none."""

    def door_of_a_robot_in_use(controller):
        enabled(controller)
        door_open(controller)

    _, findings = examined(prepare=door_of_a_robot_in_use, may_ask=True)
    assert told(findings, Level.WRONG) == {}


def test_main_that_does_not_run_and_another_control_device_are_told(monkeypatch):
    monkeypatch.setattr(status_words, 'CONTROL_DEVICE', 21)

    _, findings = examined('spel', prepare=ended, may_ask=True)
    held = told(findings, Level.HELD)
    assert held['control device'].startswith('the control device is the PC with RC+')
    assert held['main'] == 'main does not run'
    assert findings.exit_code == 1
