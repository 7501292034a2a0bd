# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`/diagnostics` shows the driver's state with the matching level."""

import asyncio
from itertools import pairwise

import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus
from support.driver_harness import Harness, ScriptedController, open_gate
from support.event_loop import now, until

from epson_driver.link import LinkState
from epson_driver.node.diagnostics import Diagnostics
from epson_driver.sim_controller.network.servers import Ports
from epson_driver.simple_message import Status

STAMP = Time(sec=5)
OK, WARN = DiagnosticStatus.OK, DiagnosticStatus.WARN
ERROR, STALE = DiagnosticStatus.ERROR, DiagnosticStatus.STALE


@pytest.fixture
def harness():
    return Harness(Ports(1, 2, 0, 0))  # it never runs


@pytest.fixture
def diagnostics(harness):
    return Diagnostics(harness.driver, 'cell_1/epson_driver', lambda _: 1)


def rows(message):
    return {status.name.rpartition(': ')[2]: status for status in message.status}


def values(status):
    return {value.key: value.value for value in status.values}


def connect(harness):
    for link in (harness.driver.state_link, harness.driver.motion_link):
        link.state = LinkState.CONNECTED
    harness.driver.robot.on_joints((0.0,) * 10, 99.995)
    harness.driver.robot.on_joints((0.0,) * 10, 100.0)
    harness.driver.robot.on_status(Status(1, 0, 0, 0, 0, 2, 1), 100.0)


def test_diagnostic_statuses_have_names_and_hardware_ids(diagnostics):
    message = diagnostics.build(STAMP, 100.0)
    assert message.header.stamp == STAMP
    assert [(status.name, status.hardware_id) for status in message.status] == [
        ('cell_1/epson_driver: state link', '127.0.0.1:2'),
        ('cell_1/epson_driver: motion link', '127.0.0.1:1'),
        ('cell_1/epson_driver: arm', '127.0.0.1'),
    ]


def test_refused_plans_and_streams_have_a_reason(harness, diagnostics):
    arm = values(rows(diagnostics.build(STAMP, 100.0))['arm'])
    assert not {'plans refused', 'streams refused'} & set(arm)
    delivery = harness.driver.stopper.delivery
    delivery.no_plans, delivery.no_streams = 'no points', 'no setpoints'
    arm = values(rows(diagnostics.build(STAMP, 100.0))['arm'])
    assert (arm['plans refused'], arm['streams refused']) == ('no points', 'no setpoints')


@pytest.mark.parametrize('state', LinkState)
def test_unconnected_link_has_diagnostic_level_error(harness, diagnostics, state):
    harness.driver.motion_link.state = state
    link = rows(diagnostics.build(STAMP, 100.0))['motion link']
    assert link.level == (OK if state is LinkState.CONNECTED else ERROR)
    assert link.message == state.value
    assert values(link)['state'] == state.value


def test_arm_without_state_has_diagnostic_level_stale(harness, diagnostics):
    arm = rows(diagnostics.build(STAMP, 100.0))['arm']
    assert (arm.level, arm.message) == (
        STALE,
        'no link to the controller: the state link to 127.0.0.1:2 is disconnected',
    )
    assert values(arm)['cause'] == 'NO_STATE_LINK'
    assert values(arm)['remedy'] == 'CONNECT'
    assert 'age of joint state [ms]' not in values(arm)


def test_disabled_arm_has_diagnostic_level_warn_with_the_reason(harness, diagnostics):
    connect(harness)
    arm = rows(diagnostics.build(STAMP, 100.0))['arm']
    assert arm.level == WARN
    assert arm.message == 'the arm is not enabled (not enabled since the driver started)'
    assert (values(arm)['cause'], values(arm)['remedy']) == ('NOT_ENABLED', 'ENABLE')
    assert values(arm)['arm gate'] == 'closed'
    assert values(arm)['arm gate reason'] == 'not enabled since the driver started'


def test_enabled_arm_has_level_ok_and_every_value(harness, diagnostics):
    connect(harness)
    open_gate(harness.driver.gate)
    arm = rows(diagnostics.build(STAMP, 100.25))['arm']
    assert (arm.level, arm.message) == (OK, 'enabled')
    assert values(arm) == {
        'cause': 'NONE',
        'remedy': 'NONE',
        'advice': '',
        'arm gate': 'open',
        'goal running': 'False',
        'stream followed': 'none',
        'stream source': '',
        'stream lag [ms]': '0',
        **{
            f'setpoints {counter}': '0'
            for counter in ('received', 'late', 'left behind', 'clipped', 'refused')
        },
        'goals without a smooth motion': '0',
        'goals at another speed than planned': '0',
        'age of joint state [ms]': '250.0',
        'age of status [ms]': '250.0',
        'velocities beyond what a joint can do': '0',
        'error code': '0',
    }


def test_heartbeat_gap_and_timeout_are_shown():
    driver = Harness(Ports(1, 2, 0, 0), client_timeout=0.5).driver
    driver.heartbeat.longest_gap = 0.4321
    arm = values(rows(Diagnostics(driver, 'r1', lambda _: 0).build(STAMP, 100.0))['arm'])
    assert arm['heartbeat longest gap [ms]'] == '432'
    assert arm['heartbeat time-out [ms]'] == '500'


def test_controller_error_is_shown_with_number_text_and_advice(harness, diagnostics):
    connect(harness)
    open_gate(harness.driver.gate)
    harness.driver.robot.on_status(Status(1, 0, 4001, 1, 0, 2, 0), 100.0)
    arm = rows(diagnostics.build(STAMP, 100.0))['arm']
    assert (arm.level, arm.message) == (
        ERROR,
        'the controller is in error 4001 (the arm would leave its motion range, not confirmed)',
    )
    assert values(arm)['error code'] == '4001'
    assert values(arm)['error'] == 'the arm would leave its motion range'
    assert values(arm)['advice'] == 'send points inside the limits'
    assert (values(arm)['cause'], values(arm)['remedy']) == ('ERROR', 'RESET')
    assert values(arm)['error text confirmed'] == 'False'


@pytest.mark.parametrize(
    ('status', 'text'),
    [
        (Status(1, 1, 0, 0, 0, 2, 0), 'the E-stop is pressed or not reset'),
        (Status(1, 0, 0, 1, 0, 2, 0), 'the controller is in error 0'),
    ],
)
def test_estop_or_error_without_number_has_diagnostic_level_error(
    harness, diagnostics, status, text
):
    connect(harness)
    harness.driver.robot.on_status(status, 100.0)
    arm = rows(diagnostics.build(STAMP, 100.0))['arm']
    assert (arm.level, arm.message) == (ERROR, text)


def test_motors_off_has_diagnostic_level_warn_with_the_gate_s_reason(harness, diagnostics):
    connect(harness)
    open_gate(harness.driver.gate)
    harness.driver.gate.close('the motors are off')
    harness.driver.robot.on_status(Status(0, 0, 0, 0, 0, 2, 0), 100.0)
    arm = rows(diagnostics.build(STAMP, 100.0))['arm']
    assert (arm.level, arm.message) == (WARN, 'the arm is not enabled (the motors are off)')


@pytest.mark.invariant(6)
@pytest.mark.parametrize(
    ('joints', 'status', 'level', 'text'),
    [
        (99.01, 99.01, OK, 'enabled'),
        (98.9, 99.9, STALE, 'no joint state for 1.1 s'),
        (99.9, 97.9, STALE, 'no STATUS for 2.1 s'),
        (99.9, None, STALE, 'no STATUS'),
    ],
)
def test_inv6_stale_state_hides_other_conditions(
    harness, diagnostics, joints, status, level, text
):
    connect(harness)
    robot = harness.driver.robot
    open_gate(harness.driver.gate)
    robot.on_joints((0.0,) * 10, joints)
    fine = Status(1, 0, 0, 0, 0, 2, 1)
    wrong = Status(1, 1, 4001, 1, 0, 2, 0)
    if status is None:
        robot.status = None
    else:
        robot.on_status(wrong if level == STALE else fine, status)
    arm = rows(diagnostics.build(STAMP, 100.0))['arm']
    assert (arm.level, arm.message) == (level, text)


def test_joint_state_rate_jitter_and_longest_gap_are_shown(harness, diagnostics):
    robot = harness.driver.robot
    robot.on_joints((0.0,) * 10, 99.99)
    first = values(rows(diagnostics.build(STAMP, 100.0))['arm'])
    assert 'joint state rate [Hz]' not in first  # no interval to count over yet
    for number in range(100):  # 8 ms and 12 ms in turn
        robot.on_joints((0.0,) * 10, 100.001 + number * 0.01 + (number % 2) * 0.002)
    second = values(rows(diagnostics.build(STAMP, 101.0))['arm'])
    assert second['joint state rate [Hz]'] == '100.0'
    assert float(second['joint state jitter [ms]']) == pytest.approx(2.0, abs=0.02)
    assert second['joint state longest gap [ms]'] == '12.00'
    third = values(rows(diagnostics.build(STAMP, 102.0))['arm'])
    assert third['joint state rate [Hz]'] == '0.0'
    assert 'joint state jitter [ms]' not in third


def test_io_link_is_shown_if_used_and_at_most_a_warning():
    harness = Harness(Ports(1, 2, 0, 0), io_port=3)
    diagnostics = Diagnostics(harness.driver, 'x', lambda _: 1)
    io = rows(diagnostics.build(STAMP, 100.0))['io link']
    assert (io.level, io.message, io.hardware_id) == (WARN, 'connecting', '127.0.0.1:3')
    harness.driver.io.reason = ''
    harness.driver.io.link.state = LinkState.CONNECTED
    io = rows(diagnostics.build(STAMP, 101.0))['io link']
    assert (io.level, io.message) == (OK, 'connected')
    assert values(io)['frame rate [Hz]'] == '0.0'


def test_link_counters_rates_and_latencies_are_shown(harness, diagnostics):
    link = harness.driver.state_link
    link.statistics.frames_received = 1000
    first = values(rows(diagnostics.build(STAMP, 100.0))['state link'])
    assert first['frames received'] == '1000'
    assert 'frame rate [Hz]' not in first  # no interval to count over yet
    link.statistics.frames_received = 1360
    link.statistics.connections = 3
    link.statistics.bad_frames['body'] = 2
    link.statistics.bad_frames['length'] = 1
    link.statistics.unsolicited_replies = 4
    link.statistics.reply_latencies.extend([0.001, 0.002, 0.003])
    second = values(rows(diagnostics.build(STAMP, 102.0))['state link'])
    assert second['frame rate [Hz]'] == '180.0'
    assert second['connections'] == '3'
    assert second['reconnects'] == '2'
    assert second['bad frames'] == '3'
    assert second['bad frames: body'] == '2'
    assert second['bad frames: length'] == '1'
    assert second['replies nobody waited for'] == '4'
    assert second['reply latency median [ms]'] == '2.00'
    assert 2.0 <= float(second['reply latency p99 [ms]']) <= 3.0
    third = values(rows(diagnostics.build(STAMP, 103.0))['state link'])
    assert third['frame rate [Hz]'] == '0.0'


async def test_diagnostics_are_sent_every_second_and_on_a_new_cause():
    sent = []
    async with ScriptedController() as controller, Harness(controller.ports) as harness:
        await harness.ready()
        diagnostics = Diagnostics(harness.driver, 'epson_driver', lambda _: 1)

        def publish(message):
            sent.append((now(), values(rows(message)['arm'])['cause']))

        task = asyncio.create_task(diagnostics.run(lambda: STAMP, publish))
        await until(lambda: len(sent) == 3)
        await controller.__aexit__()
        gone = now()
        await until(lambda: len(sent) == 4)
        task.cancel()
    assert [round(second - first, 2) for (first, _), (second, _) in pairwise(sent[:3])] == [
        1.0
    ] * 2
    assert sent[3][1] == 'NO_STATE_LINK'
    assert sent[3][0] - gone < 0.2
