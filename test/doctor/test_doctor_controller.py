# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The doctor with the simulated controller: learned profiles, findings, untouched ports."""

import asyncio
import contextlib
import dataclasses

import numpy as np
import pytest
from support.driver_harness import MODEL, simulated
from support.event_loop import run
from support.examples import one_in

from epson_driver.doctor import listening
from epson_driver.doctor.asking import IO_KEYS
from epson_driver.doctor.controller_checks import Question, check_controller
from epson_driver.doctor.findings import ARM, Findings, Level
from epson_driver.doctor.learning import profile_text, unknown, value_of, why_not
from epson_driver.profiles.profile import load_controller_profile
from epson_driver.profiles.profile_rules import RULES
from epson_driver.share import share_path
from epson_driver.sim_controller.condition.states import Event
from epson_driver.sim_controller.faults.fault_kinds import parse
from epson_driver.sim_controller.remote import remote_commands

NAMES = (
    'abb',
    'fanuc',
    'generic',
    'motoman',
    'simulated',
    'spel',
)
KINDS = [
    pytest.param(name, marks=() if name == 'simulated' else pytest.mark.slow) for name in NAMES
]

IO_OF_SPEL = {'flags': 64}
"""Memory bits of the program (IO_MEMORY_BYTES of config.inc). The controller has 512."""

SEEN = {
    'byte_order',
    'mode',
    'state.period',
    'state.joint_positions_per_status',
    'state.status_with_joints',
    'state.message',
    'server.state_clients',
    'program.kind',
    'io',
    'ports.state',
    'ports.motion',
    'ports.io',
}
"""Keys that are learned of every profile except NOT_OF. Some kinds have more."""

NOT_OF = {
    # a second client replaces the first, and its I/O uses other messages
    'motoman': {'server.state_clients', 'io', 'ports.io'},
}

BOOTED_S = 1.0
"""Time until a SPEL+ program has opened its ports, s."""


def question(profile, ports, **options):
    asked = Question(
        host='127.0.0.1',
        profile=profile,
        model=MODEL,
        state_port=ports.state,
        motion_port=ports.motion,
        io_port=ports.io,
        remote_port=ports.remote if profile.ports.remote else 0,
        password='',
        seconds=5.0,
        may_ask=False,
        may_use_io=False,
    )
    return dataclasses.replace(asked, **options)


def examined(profile='simulated', prepare=None, expected=None, inside=None, **options):
    """Return the doctor's facts and findings at a simulated controller, in virtual time.

    `expected`: the profile that the doctor expects. `inside(ports)`: a context of the check.
    """
    held = load_controller_profile(expected or profile)
    findings = Findings(lambda finding: None)
    result = {}

    async def scenario():
        async with simulated(profile=profile) as (controller, ports):
            if held.spel.project:
                await asyncio.sleep(BOOTED_S)
            if prepare is not None:
                prepare(controller)
            before = controller.joint_position().joints
            async with inside(ports) if inside else contextlib.nullcontext():
                asked = question(held, ports, **options)
                result['facts'] = await check_controller(asked, findings)
            assert np.array_equal(controller.joint_position().joints, before), 'the arm moved'

    run(scenario(), 120.0)
    return result['facts'], findings


def points_of(profile):
    """Return the number of points of each type."""
    return {name: getattr(profile, name) for name in IO_KEYS.values()}


def found_at(findings, level):
    return {item.about: item.text for item in findings.all if item.level is level}


def test_every_profile_except_remote_is_tested_here():
    folder = share_path('config', 'controllers', 'simulated.yaml').parent
    there = {path.stem for path in folder.glob('*.yaml')}
    assert there - {'remote', 'rtmc'} == set(NAMES)  # they have nothing to learn


def test_remote_profile_is_examined_by_remote_ethernet():
    facts, findings = examined('remote')
    assert facts == {'ports.remote': facts['ports.remote']}
    assert found_at(findings, Level.OK)['joints'].startswith(
        'within the limits of a c3_a601s: 0.0'
    )
    assert 'off: the driver switches them on' in found_at(findings, Level.OK)[ARM]
    note = found_at(findings, Level.NOTE)['Remote Ethernet alone']
    assert 'only along a straight line of tool0; no streams' in note


def test_remote_profile_reports_an_open_door():
    _, findings = examined('remote', prepare=lambda controller: controller.apply(Event.DOOR_OPEN))
    assert any('door is open' in item.text for item in findings.all)


@pytest.mark.parametrize('name', KINDS)
def test_learned_profile_equals_the_original_or_gives_reasons(tmp_path, name):
    original = load_controller_profile(name)
    facts, findings = examined(name, may_ask=True, may_use_io=True)
    assert facts.keys() >= SEEN - NOT_OF.get(name, set())
    assert 'remote port' not in found_at(findings, Level.NOTE)  # the profile is right
    path = tmp_path / 'learned.yaml'
    path.write_text(profile_text('learned', facts, 'generic', 'in a test'), encoding='utf-8')
    learned = load_controller_profile(str(path))
    assert learned.name == 'learned'
    assert all(sentence.endswith('.') for sentence in learned.approximate)
    missing = set(unknown(facts))
    for key in set(RULES) - missing - {'name', 'description', 'approximate'}:
        if key.startswith('ports.'):
            continue  # chosen by this test
        result, true = value_of(learned, key), value_of(original, key)
        if key == 'state.period':
            assert result == pytest.approx(true, rel=0.02), key
        elif key == 'program.motors' and name != 'motoman':
            seen = 'restart' if name == 'spel' else 'remote_ethernet'
            assert (result, true) == (seen, original.program.motors)
        elif key == 'io':
            ours, theirs = points_of(result), points_of(true)
            assert ours == (theirs | IO_OF_SPEL if name == 'spel' else theirs)
        else:
            assert result == true, key
    text = path.read_text(encoding='utf-8')
    for key in missing:
        assert f'# * {key}: {why_not(key)}' in text
    assert ('# * io: only the numbers of points' in text) == ('io' in facts)


@pytest.mark.parametrize('name', KINDS)
def test_simulator_with_a_learned_profile_behaves_like_the_original(tmp_path, name):
    facts, _ = examined(name, may_ask=True, may_use_io=True)
    path = tmp_path / 'learned.yaml'
    path.write_text(profile_text('learned', facts, 'generic', 'in a test'), encoding='utf-8')
    again, _ = examined(str(path), may_ask=True, may_use_io=True)
    same = {key for key in facts if not key.startswith('ports.')} - {'state.period'}
    if name == 'spel':
        same.remove('program.motors')  # no program runs there
    assert {key: again.get(key) for key in same} == {key: facts[key] for key in same}
    assert again['state.period'] == pytest.approx(facts['state.period'], rel=0.02)


def test_every_key_has_a_reason_if_not_learned():
    for key in RULES:
        assert why_not(key)


def test_wrong_profile_is_reported_by_key():
    _, findings = examined(expected='fanuc')
    wrong = [item.text for item in findings.all if item.level is Level.WRONG]
    assert 'byte_order is little, but big in the profile fanuc' in wrong
    assert any(item.startswith('state.period is 0.00') for item in wrong)
    assert findings.exit_code == 1


@pytest.mark.invariant(1)
def test_only_the_state_port_is_opened_by_default(opened):
    all_ports = []

    @contextlib.asynccontextmanager
    async def record(ports):
        opened.clear()
        all_ports.append(ports)
        yield

    _, findings = examined('spel', inside=record)
    (ports,) = all_ports
    assert ports.state in opened
    assert not {ports.motion, ports.io, ports.remote} & set(opened)
    assert 'motion, I/O, remote port' in found_at(findings, Level.SKIPPED)


@pytest.mark.invariant(1)
@pytest.mark.parametrize('name', ['simulated', 'motoman'])
def test_no_requests_are_sent_with_motors_on(name):
    def motors_on(controller):
        controller.apply(Event.MOTORS_ON)

    facts, findings = examined(name, prepare=motors_on, may_ask=True, may_use_io=True)
    assert 'motors are on' in found_at(findings, Level.SKIPPED)['motion, I/O port']
    assert 'program.kind' not in facts


def test_controller_lost_during_the_check_is_reported():
    def cut(controller):
        controller.faults.start(parse('cut:port=state,after=2,for=60'))

    facts, findings = examined(prepare=cut, may_ask=True)
    assert facts == {}
    assert 'after 2.' in found_at(findings, Level.WRONG)['state port']
    assert findings.exit_code == 1


def test_silent_controller_is_reported():
    def silent(controller):
        controller.faults.start(parse('half_open:port=state'))

    _, findings = examined(prepare=silent)
    assert found_at(findings, Level.WRONG)['state port'].startswith(
        'accepts, but sent nothing in 5'
    )


@pytest.mark.parametrize(('lateness', 'level'), [(0.0, Level.WRONG), (0.7, Level.NOTE)])
def test_interrupted_stream_is_an_error_except_on_a_busy_machine(monkeypatch, lateness, level):
    def silent(controller):
        enabled(controller)
        controller.faults.start(parse('half_open:port=state,after=1'))

    async def late(self):
        self.traffic.lateness = lateness

    monkeypatch.setattr(listening.Conversation, '_ticks', late)
    _, findings = examined(prepare=silent)
    assert found_at(findings, level)['state port'].endswith('half-open')
    assert findings.exit_code == int(level is Level.WRONG)
    assert ('too busy to judge' in findings.verdict) == (level is Level.NOTE)


def test_occupied_state_port_is_reported():
    @contextlib.asynccontextmanager
    async def occupied(ports):
        _, writer = await asyncio.open_connection('127.0.0.1', ports.state)
        await asyncio.sleep(1.0)
        yield
        writer.close()

    facts, findings = examined('fanuc', inside=occupied)
    assert facts == {}
    assert 'another client is connected' in found_at(findings, Level.WRONG)['state port']


def test_closed_state_port_is_reported():
    facts, findings = examined(state_port=1)
    assert facts == {}
    assert 'refused' in found_at(findings, Level.WRONG)['state port'].lower()


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
    ('prepare', 'about', 'text', 'remedy'),
    [
        (at_manual, 'key switch', 'the key switch is at MANUAL', 'AUTO'),
        (paused, 'the arm', 'motion is not possible (a safeguard is open', 'continue'),
    ],
)
def test_reason_why_the_arm_cannot_move_comes_first(prepare, about, text, remedy):
    _, findings = examined(prepare=prepare)
    first = findings.all[0]
    assert (first.level, first.about) == (Level.INHIBIT, about)
    assert text in first.text
    assert remedy in first.remedy
    assert findings.verdict == f'the arm cannot move: {first.text}'
    assert findings.exit_code == 1


@pytest.mark.parametrize('prepare', [lambda controller: None, door_open])
def test_motors_that_are_off_are_a_note_with_the_remedy(prepare):
    _, findings = examined(prepare=prepare)
    first = findings.all[0]
    assert (first.level, first.about, first.text) == (Level.NOTE, 'motors', 'the motors are off')
    assert first.remedy.startswith('enable the arm (ROS: ~/enable, Python: enable()')
    assert 'close the safeguard' in first.remedy
    assert (findings.verdict, findings.exit_code) == (f'the arm cannot move yet: {first.text}', 0)


@pytest.mark.parametrize(
    ('prepare', 'about', 'text'),
    one_in(
        3,
        [
            (door_open, 'safeguard', 'the safeguard door is open'),
            (lambda controller: controller.press_estop(), 'E-stop', 'pressed'),
            (lambda controller: controller.apply(Event.MODE_MANUAL), 'key switch', 'MANUAL'),
            (paused, 'pause', 'the tasks are paused'),
            (ended, 'main', 'main is not running'),
        ],
        several=True,
    ),
)
def test_remote_port_gives_reasons_missing_in_status(prepare, about, text):
    _, findings = examined('spel', prepare=prepare, may_ask=True)
    held = [item for item in findings.all if item.level is Level.INHIBIT]
    assert held[0].about == about
    assert text in held[0].text
    assert len({item.about for item in held}) == len(held)
    assert 'the arm' not in [item.about for item in held]  # the general reason is replaced
    assert 'Remote Ethernet replies: ' in found_at(findings, Level.OK)['remote port']


@pytest.mark.slow
def test_paused_tasks_do_not_contradict_the_profile():
    """A START without an answer while the tasks are paused is not a missing feature."""

    def door_of_a_robot_in_use(controller):
        enabled(controller)
        door_open(controller)

    _, findings = examined(prepare=door_of_a_robot_in_use, may_ask=True)
    assert found_at(findings, Level.WRONG) == {}


def test_stopped_main_and_wrong_control_device_are_reported(monkeypatch):
    rc = remote_commands.COMMANDS['GetContDev']
    rc = dataclasses.replace(rc, run=lambda *_: '21')
    monkeypatch.setitem(remote_commands.COMMANDS, 'GetContDev', rc)

    _, findings = examined('spel', prepare=ended, may_ask=True)
    held = found_at(findings, Level.INHIBIT)
    assert held['control device'].startswith('the control device is the PC with RC+')
    assert held['main'] == 'main is not running'
    assert findings.exit_code == 1
