# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The panel's two ROS nodes, and the discovery of drivers.

An executor spins one node, which receives answers. The other node has subscriptions only, which
are polled (`ros_robot.py`).
"""

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
from epson_driver.panel.ros_robot import RosRobot

NAME = 'epson_driver_panel'

SPEED_SERVICE = ('epson_msgs/srv/SetSpeedScaling', '/set_speed_scaling')
"""The service that identifies a driver of this package: its type, and the end of its name."""

GOAL_TIMEOUT_S = 3.0
"""Maximum time for the panel's goals to end when the panel closes, s."""

MAX_AT_ONCE = 50
"""Maximum number of messages of a topic that are read at a time."""

MANY = QoSProfile(depth=MAX_AT_ONCE, reliability=ReliabilityPolicy.BEST_EFFORT)

LOG = QoSProfile(
    depth=MAX_AT_ONCE,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
"""Transient local, to receive the lines that were logged before the panel started."""


class RosDiscovery:
    """The panel's connection to ROS, and the drivers in it.

    * arguments: ROS arguments of the command line.
    * names: the drivers' nodes, or None for all drivers that are found.
    * on_error: called with the failed part and an exception of the ROS thread.

    Raises the exceptions of rclpy.init.
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
        self.robots: dict[str, RosRobot] = {}
        """The drivers by the names of their nodes, in the order of discovery."""
        self._early: deque[tuple[str, Event]] = deque(maxlen=MAX_EVENTS)
        """Log lines of nodes that are not known as drivers (yet)."""
        self._find = names is None
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
        """Read the new messages of all drivers. `now`: the panel's clock, s."""
        for robot in self.robots.values():
            robot.sample(now)

    def sample_reports(self, now: float) -> None:
        """Read diagnostics and log lines. `now`: the panel's clock, s."""
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
        """Add new drivers, and request the parameters of all. `now`: the panel's clock, s."""
        if self._find:
            kind, ending = SPEED_SERVICE
            for service, types in self._node.get_service_names_and_types():
                name = service.removesuffix(ending)
                if kind in types and name != service and name not in self.robots:
                    self._add(name)
        for robot in self.robots.values():
            robot.look_for_driver(now)

    def forget_silent(self, now: float, after: float) -> list[str]:
        """Remove discovered drivers that have been silent for `after` s, and return their names.

        `now`: the panel's clock, s.
        """
        if not self._find:
            return []
        silent = [name for name, item in self.robots.items() if now - item.last_seen(now) > after]
        for name in silent:
            self.robots.pop(name).close()
        return silent

    def cancel_goals(self) -> bool:
        """Cancel all goals of the panel, and return whether all ended within GOAL_TIMEOUT_S."""
        goals = [goal for robot in self.robots.values() for goal in robot.cancel_goals()]
        return all(goal.ended.wait(GOAL_TIMEOUT_S) for goal in goals)

    def close(self) -> None:
        """Destroy the nodes, and shut down rclpy."""
        self._thread.leave()
        self._thread.executor.shutdown()
        self._node.destroy_node()
        self._sampled.destroy_node()
        rclpy.shutdown(context=self._context)
