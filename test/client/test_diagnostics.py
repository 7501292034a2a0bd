# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`/diagnostics` says the same as the driver knows, with the level of its condition."""

import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus
from driver_bench import JOINTS, Bench, now, run

from epson_driver.client.diagnostics import Diagnostics
from epson_driver.controller.network.servers import Ports
from epson_driver.link import LinkState
from epson_driver.simple_message import Status

STAMP = Time(sec=5)
OK, WARN = DiagnosticStatus.OK, DiagnosticStatus.WARN
ERROR, STALE = DiagnosticStatus.ERROR, DiagnosticStatus.STALE


@pytest.fixture
def bench():
    return Bench(Ports(1, 2, 0, 0))  # it never runs


@pytest.fixture
def diagnostics(bench):
    return Diagnostics(bench.driver, 'cell_1/epson_driver')


def rows(message):
    return {status.name.rpartition(': ')[2]: status for status in message.status}


def values(status):
    return {value.key: value.value for value in status.values}


def connect(bench):
    for link in (bench.driver.state_link, bench.driver.motion_link):
        link.state = LinkState.CONNECTED
    bench.driver.robot.on_joints((0.0,) * 10, 100.0)
    bench.driver.robot.on_status(Status(1, 0, 0, 0, 0, 2, 1), 100.0)


def test_names_and_hardware(diagnostics):
    message = diagnostics.build(STAMP, 100.0)
    assert message.header.stamp == STAMP
    assert [(status.name, status.hardware_id) for status in message.status] == [
        ('cell_1/epson_driver: state link', '127.0.0.1:2'),
        ('cell_1/epson_driver: motion link', '127.0.0.1:1'),
        ('cell_1/epson_driver: arm', '127.0.0.1'),
    ]


@pytest.mark.parametrize('state', LinkState)
def test_a_link_is_an_error_unless_it_is_connected(bench, diagnostics, state):
    bench.driver.motion_link.state = state
    link = rows(diagnostics.build(STAMP, 100.0))['motion link']
    assert link.level == (OK if state is LinkState.CONNECTED else ERROR)
    assert link.message == state.value
    assert values(link)['state'] == state.value


def test_the_arm_without_state_is_stale(bench, diagnostics):
    arm = rows(diagnostics.build(STAMP, 100.0))['arm']
    assert (arm.level, arm.message) == (STALE, 'no joint state')
    assert 'age of joint state [ms]' not in values(arm)


def test_the_arm_that_is_not_enabled_is_a_warning_with_its_reason(bench, diagnostics):
    connect(bench)
    arm = rows(diagnostics.build(STAMP, 100.0))['arm']
    assert arm.level == WARN
    assert arm.message == 'not enabled: not enabled since the driver started'
    assert values(arm)['arm gate'] == 'closed'


def test_the_arm_that_is_enabled_is_fine(bench, diagnostics):
    connect(bench)
    bench.driver.gate.open()
    arm = rows(diagnostics.build(STAMP, 100.25))['arm']
    assert (arm.level, arm.message) == (OK, 'enabled')
    assert values(arm) == {
        'arm gate': 'open',
        'goal running': 'False',
        'age of joint state [ms]': '250.0',
        'age of status [ms]': '250.0',
        'error code': '0',
    }


def test_an_error_of_the_controller_is_an_error_with_its_number(bench, diagnostics):
    connect(bench)
    bench.driver.gate.open()
    bench.driver.robot.on_status(Status(1, 0, 4001, 1, 0, 2, 0), 100.0)
    arm = rows(diagnostics.build(STAMP, 100.0))['arm']
    assert (arm.level, arm.message) == (ERROR, 'error 4001')


def test_counters_and_rates(bench, diagnostics):
    link = bench.driver.state_link
    link.statistics.frames_received = 1000
    first = values(rows(diagnostics.build(STAMP, 100.0))['state link'])
    assert first['frames received'] == '1000'
    assert 'frame rate [Hz]' not in first  # there is no time yet to count over
    link.statistics.frames_received = 1360
    link.statistics.connections = 3
    link.statistics.bad_frames['body'] = 2
    link.statistics.bad_frames['length'] = 1
    link.statistics.unsolicited_replies = 4
    link.statistics.reply_latencies.extend([0.001, 0.002, 0.003])
    second = values(rows(diagnostics.build(STAMP, 102.0))['state link'])
    assert second['frame rate [Hz]'] == '180.0'
    assert second['connections'] == '3'
    assert second['bad frames'] == '3'
    assert second['bad frames: body'] == '2'
    assert second['bad frames: length'] == '1'
    assert second['replies nobody waited for'] == '4'
    assert second['reply latency median [ms]'] == '2.00'
    assert 2.0 <= float(second['reply latency p99 [ms]']) <= 3.0
    third = values(rows(diagnostics.build(STAMP, 103.0))['state link'])
    assert third['frame rate [Hz]'] == '0.0'


def test_a_running_driver_without_a_controller():
    async def scenario():
        async with Bench(Ports(1, 1, 0, 0)) as bench:
            message = Diagnostics(bench.driver, 'epson_driver').build(STAMP, now())
            assert {row.level for row in message.status} == {ERROR, STALE}

    run(scenario())


def test_the_arm_knows_its_joints(bench):
    assert bench.driver.robot.on_joints((0.0,) * 10, 1.0).positions.shape == (JOINTS,)
