# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The panel's two ROS nodes, and the discovery of drivers.

An executor spins one node, which receives answers. The other node has subscriptions only, which
are polled (`ros_robot.py`).
"""

import math
from collections import deque
from collections.abc import Callable

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import Log
from rclpy.context import Context
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions

from epson_driver.node.ros_process import (
    RosThread,
    level,
    polled_subscription,
    take_all,
    udp_by_default,
)
from epson_driver.panel.robot_state import MAX_EVENTS, Event
from epson_driver.ros_panel.ros_robot import RosRobot

NAME = 'epson_driver_panel'
SPEED_SERVICE = ('epson_msgs/srv/SetSpeedScaling', '/set_speed_scaling')
REPORTS_PERIOD_S = 0.2  # period for reading diagnostics and log, s
GONE_AFTER_S = 60.0  # silence of a driver after which its robot is removed from the page, s
MAX_AT_ONCE = 50  # maximum number of messages of a topic that are read at a time

MANY = QoSProfile(depth=MAX_AT_ONCE, reliability=ReliabilityPolicy.BEST_EFFORT)

LOG = QoSProfile(
    depth=MAX_AT_ONCE,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
"""QoS for the log: transient local, to receive lines that were logged before the panel started."""


class RosDiscovery:
    """The panel's connection to ROS, and the drivers that it finds.

    `names`: nodes of the drivers, or None for all drivers. Raises the exceptions of rclpy.init.
    """

    def __init__(
        self,
        arguments: list[str],
        names: list[str] | None,
        on_error: Callable[[str, BaseException], None],
    ) -> None:
        self._context = Context()
        # rclpy's own SIGTERM handler would shut down ROS only, and the page would stay open
        with udp_by_default():
            rclpy.init(
                args=arguments,
                context=self._context,
                signal_handler_options=SignalHandlerOptions.NO,
            )
            self._node = self._new_node(NAME)
        self._sampled = self._new_node(f'{NAME}_topics')
        self._diagnostics = polled_subscription(
            self._sampled, DiagnosticArray, '/diagnostics', MANY
        )
        self._log = polled_subscription(self._sampled, Log, '/rosout', LOG)
        self._thread = RosThread(on_error, self._context)
        self._thread.executor.add_node(self._node)
        self._thread.start()
        self.robots: dict[str, RosRobot] = {}  # by node, in the order of discovery
        self._early: deque[tuple[str, Event]] = deque(maxlen=MAX_EVENTS)  # of unknown nodes
        self._find = names is None
        self._reports_read = -math.inf
        for name in names or ():
            self._add(name)

    def _new_node(self, name: str) -> Node:
        return Node(
            name, context=self._context, enable_rosout=False, start_parameter_services=False
        )

    def _add(self, name: str) -> None:
        robot = self.robots[name] = RosRobot(
            self._node, self._thread.executor, self._sampled, name
        )
        for node, event in self._early:
            if node == name:
                robot.state.add_event(event)

    def sample(self, now: float) -> None:
        for robot in self.robots.values():
            robot.sample(now)
        if now - self._reports_read >= REPORTS_PERIOD_S:
            self._reports_read = now
            self._sample_reports(now)

    def _sample_reports(self, now: float) -> None:
        for message in take_all(self._diagnostics, MAX_AT_ONCE):
            for status in message.status:
                node, separator, part = status.name.partition(': ')
                robot = self.robots.get(f'/{node}')
                if robot is not None and separator and part == 'arm':
                    robot.on_diagnostics(status, now)
        for line in take_all(self._log, MAX_AT_ONCE):
            stamp = line.stamp.sec + line.stamp.nanosec * 1e-9
            event = Event(stamp, level(line), line.msg)
            name = '/' + line.name.replace('.', '/')
            robot = self.robots.get(name)
            if robot is not None:
                robot.state.add_event(event)
            else:
                self._early.append((name, event))

    def discover(self, now: float) -> None:
        if self._find:
            kind, ending = SPEED_SERVICE
            for service, types in self._node.get_service_names_and_types():
                name = service.removesuffix(ending)
                if kind in types and name != service and name not in self.robots:
                    self._add(name)
        for robot in self.robots.values():
            robot.look_for_driver(now)
        for name, robot in list(self.robots.items()):
            if self._find and now - robot.last_seen(now) > GONE_AFTER_S:
                self.robots.pop(name).close()

    def close(self) -> None:
        self._thread.leave()
        self._thread.executor.shutdown()
        self._node.destroy_node()
        self._sampled.destroy_node()
        rclpy.shutdown(context=self._context)
