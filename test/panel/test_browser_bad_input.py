# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Malicious or invalid driver messages neither run scripts in the page nor break it."""

import math
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

pytest.importorskip('websockets')

import rclpy
from control_msgs.msg import JointTrajectoryControllerState
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from epson_msgs.msg import IoRange, IoStates
from epson_msgs.srv import SetSpeedScaling
from industrial_msgs.msg import RobotStatus
from rcl_interfaces.msg import Log
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import Float64, String
from support.browser import chromium
from support.panel_client import PanelProcess
from support.panel_page import Page
from support.spin_thread import SpinThread

from epson_driver.processes.processes import free_ros_domain

pytestmark = pytest.mark.slow  # a browser

HTML = '<img src=x onerror="window.run = 1"><script>window.run = 1</script>'
LONG = 'joint_' + 'very_' * 400
NAMES = {
    'HTML': [f'{HTML}{j}' for j in range(6)],
    'long': [f'{LONG}{j}' for j in range(6)],
    '200 joints': [f'joint_{j}' for j in range(200)],
    'none': [],
    'two of one name': ['joint_1'] * 6,
    'usual': [f'joint_{j}' for j in range(1, 7)],
}
VALUES = (math.nan, math.inf, 1e308, -1e308, 1e5, 0.1)

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class HostileDriver:
    """A node like the driver that publishes one text in all its topics."""

    def __init__(self, context: rclpy.Context) -> None:
        self.node = node = Node('epson_driver', context=context)
        for name, value in {
            'robot_model': 'c3_a601s',
            'joint_names': NAMES['usual'],
            'robot_ip': HTML,
            'remote_port': 0,
            'controller': HTML,
        }.items():
            node.declare_parameter(name, value)
        node.create_service(SetSpeedScaling, '~/set_speed_scaling', lambda _, answer: answer)
        self.topics = {
            kind: node.create_publisher(kind, topic, qos)
            for kind, topic, qos in (
                (RobotStatus, 'robot_status', 1),
                (JointTrajectoryControllerState, '~/controller_state', 1),
                (String, '~/link_state', LATCHED),
                (Float64, '~/speed_scaling', LATCHED),
                (IoStates, '~/io_states', LATCHED),
                (DiagnosticArray, '/diagnostics', 1),
                (
                    Log,
                    '/rosout',
                    QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL),
                ),
            )
        }

    def publish(self, names: list[str], value: float, text: str) -> None:
        """Publish one message of each type."""
        values = [value] * len(names)
        state = JointTrajectoryControllerState(joint_names=names)
        state.reference.positions = state.error.positions = state.feedback.positions = values
        fields = dict.fromkeys(('arm gate', 'cause', 'remedy', 'advice'), text)
        arm = DiagnosticStatus(
            name='epson_driver: arm',
            message=text,
            values=[KeyValue(key=key, value=item) for key, item in fields.items()],
        )
        for message in (
            RobotStatus(error_codes=[2**31 - 1] * 50),
            state,
            String(data=text),
            Float64(data=value),
            IoStates(valid=False, message=text),
            IoStates(valid=True, ranges=[IoRange(type=250, values=[1] * 9)]),
            DiagnosticArray(status=[arm]),
            Log(name='epson_driver', msg=text, level=40),
        ):
            self.topics[type(message)].publish(message)


@pytest.fixture
def hostile_driver(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[tuple[HostileDriver, PanelProcess]]:
    """A hostile driver and a panel that is connected to it."""
    domain = free_ros_domain()
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=domain)
    result = HostileDriver(context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(result.node)
    thread = SpinThread(executor)
    thread.start()
    panel = PanelProcess(tmp_path, domain, patience=False)
    try:
        yield result, panel
    finally:
        code = panel.end()
        thread.end()
        result.node.destroy_node()
        context.try_shutdown()
    assert code == 0


def test_driver_text_is_not_executed_and_does_not_break_layout(
    hostile_driver: tuple[HostileDriver, PanelProcess],
) -> None:
    driver, panel = hostile_driver
    with chromium('--disable-3d-apis') as browser:
        page = Page(browser, panel.address, {'width': 390, 'height': 844}, link='unknown')
        made = page.page.evaluate('() => document.querySelectorAll("img, script").length')
        stop = page.page.locator('#stop').bounding_box()
        for kind, names in NAMES.items():
            for value in VALUES if kind == 'usual' else VALUES[-1:]:
                text = f'{kind} {value} {HTML} {LONG}'
                for _ in range(4):
                    driver.publish(names, value, text)
                    time.sleep(0.1)
            page.wait(lambda kind=kind: kind in page.text('log'), kind)
            wide = page.page.evaluate(
                """() => [...document.querySelectorAll('main *')].filter((each) =>
                    each.getBoundingClientRect().right > innerWidth + 1
                ).map((each) => each.outerHTML.slice(0, 80))"""
            )
            assert wide == []
            assert page.page.locator('#stop').bounding_box() == stop
        assert page.page.evaluate('() => window.run') is None
        result = page.page.evaluate('() => document.querySelectorAll("img, script").length')
        assert result == made
        # The panel shows joints that jumped again after consistent values for some time.
        shown, deadline = (
            page.page.locator('#joints').get_by_text('5.7 °').first,
            time.monotonic() + 60,
        )
        while not shown.is_visible():
            assert time.monotonic() < deadline
            driver.publish(NAMES['usual'], 0.1, 'usual')
            time.sleep(0.1)
        assert [error for error in page.errors if 'WebGL' not in error] == []
