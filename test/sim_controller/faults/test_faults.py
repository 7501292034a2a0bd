# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The table of faults, their notation and timing, and the faults of the controller itself."""

import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.fault_harness import JOINTS, FaultHarness, RecordedActions, answer

from epson_driver.sim_controller.clock import Clock
from epson_driver.sim_controller.faults.fault_kinds import (
    DATA_PORTS,
    FAULTS,
    REAL_TIME_PORT,
    REMOTE_PORT,
    FaultError,
    describe,
    parse,
    write,
)
from epson_driver.sim_controller.faults.faults import ANSWER_TIME_S, MAX_ACTIVE_FAULTS, Faults

HERE = Path(__file__)
PAGE = HERE.parents[3] / 'docs' / 'controller.md'


@pytest.fixture
def harness():
    return FaultHarness()


def calls(harness):
    """Return the controller's calls since the last time, without their times."""
    taken, harness.actions.calls = [call[1:] for call in harness.actions.calls], []
    return taken


# Faults of the controller. Faults of connections: test_faulty_transport.py.


def test_frozen_encoder_ends_after_its_time(harness):
    harness.start('frozen_encoder:joint=3,for=2')
    assert harness.actions.frozen == {2}
    harness.wait(1.9)
    assert harness.actions.frozen == {2}
    harness.wait(0.2)
    assert harness.actions.frozen == set()
    assert harness.faults.active() == []


def test_several_frozen_encoder_faults_freeze_all_their_joints(harness):
    harness.start('frozen_encoder 1')
    harness.start('frozen_encoder 6 after=1')
    assert harness.actions.frozen == {0}
    harness.wait(1.0)
    assert harness.actions.frozen == {0, 5}
    harness.start('frozen_encoder for=1')
    assert harness.actions.frozen == set(range(JOINTS))
    harness.wait(1.0)
    assert harness.actions.frozen == {0, 5}
    assert harness.clear('frozen_encoder') == 2
    assert harness.actions.frozen == set()


@pytest.mark.parametrize(
    ('text', 'expected'),
    [
        ('servo_error', ('servo_error', 0, False)),
        ('servo_error:6', ('servo_error', 5, False)),
        ('servo_error joint=2 critical=yes', ('servo_error', 1, True)),
    ],
)
def test_servo_error_occurs_once(harness, text, expected):
    harness.start(text)
    assert calls(harness) == [expected]
    assert harness.faults.active() == []
    harness.clear()
    harness.wait(100.0)
    assert calls(harness) == []


def test_servo_error_is_delayed_or_cleared(harness):
    harness.start('servo_error:after=3')
    assert harness.faults.active() == ['servo_error joint=1 after=3 (starts in 3.0 s)']
    harness.wait(5.0)
    assert harness.actions.calls == [(3.0, 'servo_error', 0, False)]
    harness.start('servo_error:after=3')
    harness.clear('servo_error')
    harness.wait(5.0)
    assert len(harness.actions.calls) == 1


def test_estop_at_point_counts_points_from_its_start(harness):
    harness.faults.point_started()
    harness.start('estop_at_point 3 after=1')
    harness.faults.point_started()
    harness.wait(1.0)
    for _ in range(2):
        harness.faults.point_started()
        harness.wait(1.0)
    assert harness.faults.active() == ['estop_at_point point=3 after=1 (1 points left)']
    assert calls(harness) == []
    harness.faults.point_started()
    assert calls(harness) == []  # the core is still passing the point to the arm
    harness.wait(0.0)
    assert calls(harness) == [('press_estop',)]
    assert harness.faults.active() == []
    for _ in range(10):
        harness.faults.point_started()
        harness.wait(1.0)
    assert calls(harness) == []


def test_reboot_starts_after_the_answer_and_ends_on_time(harness):
    harness.start('reboot:for=4')
    assert calls(harness) == []
    harness.wait(ANSWER_TIME_S)
    assert calls(harness) == [('reboot', 4.0)]
    with pytest.raises(FaultError, match='reboot: it cannot be cleared'):
        harness.clear('reboot')
    harness.start('delay')
    assert harness.clear() == 1
    assert harness.faults.active() == ['reboot for=4 (4.0 s left)']
    harness.wait(4.0)
    assert harness.faults.active() == []
    assert calls(harness) == []


# The table.


@pytest.mark.parametrize('name', FAULTS)
def test_every_fault_is_described_and_has_defaults(name, harness):
    kind = FAULTS[name]
    assert kind.text.endswith('.')
    assert kind.parameters
    assert set(kind.default_ports) <= set(kind.ports) <= {*DATA_PORTS, REMOTE_PORT}
    assert REMOTE_PORT not in kind.default_ports
    for parameter in kind.parameters:
        if parameter.default is not None:
            assert parameter.read(parameter.write(parameter.default)) == parameter.default
    harness.start(name)
    assert name in describe([name])
    assert name in describe()


# Text.


@pytest.mark.parametrize(
    'text',
    [
        'delay:seconds=0.2,port=state+motion,for=3',
        'delay seconds=0.2 port=motion+state for=3',
        'delay,seconds=0.2,port=motion+state,for=3',
        '  DELAY: 0.2, for=3.0  port=motion+state ',
        'delay 0.2 for=3 port=motion+state',
    ],
)
def test_every_notation_of_a_fault_gives_the_same_fault(text):
    fault = parse(text)
    assert fault.name == 'delay'
    assert fault.values == {'seconds': 0.2, 'for': 3.0, 'after': 0.0}
    assert fault.ports == ('motion', 'state')
    assert write(fault) == 'delay seconds=0.2 for=3 port=motion+state'


@pytest.mark.parametrize(
    ('text', 'ports'),
    [
        ('cut', ('motion', 'state', 'io')),
        ('cut port=all', ('motion', 'state', 'io')),
        ('cut port=remote', ('remote',)),
        ('cut port=remote+io+motion+io', ('motion', 'io', 'remote')),
        ('bit_errors', ('state',)),
        ('lost_reply port=all', ('motion', 'state', 'io')),
        ('reboot', ()),
    ],
)
def test_fault_applies_to_its_ports(text, ports):
    assert parse(text).ports == ports


@pytest.mark.parametrize(
    ('text', 'parts'),
    [
        ('', ["'' is not a fault", 'cut, half_open, delay']),
        ('x' * 9999, [f"'{'x' * 40}…' is not a fault"]),
        ('quake', ["'quake' is not a fault: must be one of cut,", 'reboot']),
        ('delay:seconds', ["delay: seconds = 'seconds'", 'a number from 0 to 60 s']),
        ('delay:1,2', ["delay: '2' must be key=value"]),
        ('delay:seconds=', ["delay: 'seconds=' must be key=value"]),
        ('delay:seconds=61', ["delay: seconds = '61': must be a number from 0 to 60 s"]),
        ('delay:seconds=-1', ["seconds = '-1': must be"]),
        ('delay:seconds=nan', ["seconds = 'nan': must be"]),
        ('delay:seconds=inf', ["seconds = 'inf': must be"]),
        ('delay:1,seconds=2', ['delay: seconds is repeated']),
        ('delay:for=3601', ["for = '3601': must be a number from 0 to 3600 s"]),
        ('delay:colour=3', ["'colour' is unknown: must be one of seconds, for, after, port"]),
        ('delay:count=3', ["'count' is unknown"]),
        (
            'delay:port=usb',
            ["port = 'usb': must be all, or one or more of motion, state, io, remote"],
        ),
        (
            'bit_errors:port=remote',
            ["port = 'remote': must be all, or one or more of motion, state, io,"],
        ),
        ('half_open:port=remote', ['port = remote needs for =', 'because it cannot be cleared']),
        ('reboot:port=motion', ["'port' is unknown: must be one of for, after"]),
        ('reboot 0', ["for = '0': must be a number from 0.1 to 3600 s"]),
        ('estop_at_point 0', ["point = '0': must be a whole number from 1 to 1000000"]),
        ('estop_at_point 1.5', ["point = '1.5': must be a whole number"]),
        ('estop_at_point 1' + '0' * 5000, ["point = '1000", '…', 'whole number']),
        ('servo_error 0', ["joint = '0': must be a whole number from 1 to 10"]),
        ('servo_error critical=maybe', ["critical = 'maybe': must be no or yes"]),
        ('bit_errors rate=1.01', ["rate = '1.01': must be a number from 0 to 1"]),
        ('wrong_length value=3000000000', ['from -2147483648 to 2147483647']),
    ],
)
def test_error_names_the_invalid_and_the_allowed_value(text, parts):
    with pytest.raises(FaultError) as caught:
        parse(text)
    for part in parts:
        assert part in str(caught.value)
    assert len(str(caught.value)) < 300


@given(st.text(max_size=200))
def test_any_text_is_a_fault_or_an_error(text):
    for candidate in (text, f'delay {text}', f'wrong_length:value={text}', f'cut:port={text}'):
        try:
            fault = parse(candidate)
        except FaultError:
            continue
        assert parse(write(fault)) == fault


# Active faults.


def test_active_faults_are_listed_without_commas(harness):
    client = harness.client('motion')
    harness.start('cut:for=3')
    harness.start('lost_reply:count=3')
    harness.start('wrong_byte_order:port=io')
    harness.start('jitter:after=2.5,seed=4')
    harness.wait(1.0)
    client = harness.client('motion')
    client.send(answer(1))
    assert harness.faults.active() == [
        'cut for=3 port=motion+state+io (2.0 s left)',
        'lost_reply count=3 port=motion (2 messages left)',
        'wrong_byte_order port=io',
        'jitter seconds=0.05 seed=4 after=2.5 port=motion+state+io (starts in 1.5 s)',
    ]


def test_clear_ends_the_faults_of_one_name_or_all(harness):
    for text in ('delay', 'delay after=5', 'jitter', 'cut for=0'):
        harness.start(text)
    assert harness.clear('delay') == 2
    assert [text.split()[0] for text in harness.faults.active()] == ['jitter', 'cut']
    assert harness.clear() == 2
    assert harness.clear() == 0
    with pytest.raises(FaultError, match='delay: it is not active'):
        harness.clear('delay')
    with pytest.raises(FaultError, match="'quake' is not a fault: must be one of cut"):
        harness.clear('quake')
    harness.wait(10.0)
    assert harness.faults.active() == []


def test_number_of_active_faults_is_limited(harness):
    for _ in range(MAX_ACTIVE_FAULTS):
        harness.start('delay:after=100')
    with pytest.raises(
        FaultError, match=f'delay: {MAX_ACTIVE_FAULTS} faults are active: clear some'
    ):
        harness.start('delay')
    harness.clear()
    harness.start('delay')


@pytest.mark.parametrize('name', ['frozen_encoder', 'servo_error'])
def test_fault_of_a_missing_joint_is_refused(harness, name):
    with pytest.raises(FaultError, match=f'{name}: joint = 7: the robot has 6 joints'):
        harness.start(f'{name} {JOINTS + 1}')
    assert harness.faults.active() == []
    assert calls(harness) == []


def test_fault_of_the_remote_port_starts_after_the_answer(harness):
    remote, state = harness.client('remote'), harness.client('state')
    harness.start('half_open:port=remote+state,for=1')
    harness.start('cut:port=remote,for=1')
    remote.send(b'#Sim,0\r\n')
    assert remote.taken() == [b'#Sim,0\r\n']
    harness.wait(ANSWER_TIME_S)
    assert (remote.hung_up, state.hung_up) == (1, 0)
    assert harness.faults.rejects('remote')
    harness.wait(1.0)
    assert not harness.faults.rejects('remote')


@pytest.mark.parametrize('name', FAULTS)
def test_remote_port_is_disturbed_only_if_named(harness, name):
    remote = harness.client('remote')
    harness.start(name)
    for port in ('all',) if FAULTS[name].ports else ():
        harness.start(f'{name} port={port}')
    remote.send(b'#GetStatus,0\r\n')
    assert remote.taken() == [b'#GetStatus,0\r\n']
    assert remote.transport.receive(b'$Reset\r\n') == b'$Reset\r\n'
    assert remote.hung_up == 0
    assert not harness.faults.rejects('remote')


# The page.


def test_examples_of_the_page_are_valid(harness):
    text = PAGE.read_text('utf-8')
    report = re.findall(r'^pendant fault (?!clear)(\w.*?)(?: +#.*)?$', text, re.MULTILINE)
    (line,) = re.findall(r'^sim_controller (--fault .*)$', text, re.MULTILINE)
    started = re.findall(r'--fault (\S+)', line)
    assert len(report) > 8
    assert len(started) > 2
    for example in report + started:
        harness.start(example)
        harness.clear()


def test_faults_of_real_time_motion_affect_its_port_or_are_refused():
    clock = Clock()
    faults = Faults(clock, 0, RecordedActions(clock), JOINTS, link=REAL_TIME_PORT)
    faults.start(parse('cut port=state for=1'))
    assert faults.rejects(REAL_TIME_PORT)
    assert not faults.rejects('state')
    clock.advance(1.0)
    faults.start(parse('cut port=remote for=1'))  # like all faults of connections
    assert faults.rejects(REAL_TIME_PORT)
    clock.advance(2.0)
    for name in ('lost_reply', 'bit_errors', 'one_byte', 'wrong_byte_order'):
        with pytest.raises(FaultError, match=f'{name}: DDS delivers each message completely'):
            faults.start(parse(name))
