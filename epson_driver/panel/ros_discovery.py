# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The panel's two ROS nodes, and the drivers that are there.

One node is served by an executor, for answers; the other only holds subscriptions, which are
sampled (`ros_robot.py`).
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

from epson_driver.node.ros_thread import RosThread
from epson_driver.node.ros_transport import udp_by_default
from epson_driver.node.sampling import level, sampled, take_all
from epson_driver.panel.robot_state import MAX_EVENTS, Event
from epson_driver.panel.ros_robot import RosRobot

NAME = 'epson_driver_panel'

SPEED_SERVICE = ('epson_msgs/srv/SetSpeedScaling', '/set_speed_scaling')
"""A service that only this driver has: by its type and name drivers are found."""

GOAL_PATIENCE_S = 3.0
"""How long the end of the panel waits for its goals to end, s."""

MAX_AT_ONCE = 50
"""Messages of one topic that are taken in one turn; the rest in the next."""

MANY = QoSProfile(depth=MAX_AT_ONCE, reliability=ReliabilityPolicy.BEST_EFFORT)

LOG = QoSProfile(
    depth=MAX_AT_ONCE,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
"""The lines written before the panel came, too."""


class RosDiscovery:
    """Connects to ROS with the arguments of the command line. Raises what rclpy.init raises.

    `on_error` is called with what the thread that serves ROS raised. `names`: the drivers' nodes;
    None: all that are found.
    """

    def __init__(
        self,
        arguments: list[str],
        names: list[str] | None,
        on_error: Callable[[str, BaseException], None],
    ) -> None:
        self._context = Context()
        # rclpy's own handler of SIGTERM would only shut ROS down, and leave the page as it is
        with udp_by_default():
            rclpy.init(
                args=arguments,
                context=self._context,
                signal_handler_options=SignalHandlerOptions.NO,
            )
            self._node = self._new_node(NAME)
        self._sampled = self._new_node(f'{NAME}_topics')
        self._diagnostics = sampled(self._sampled, DiagnosticArray, '/diagnostics', MANY)
        self._log = sampled(self._sampled, Log, '/rosout', LOG)
        self._thread = RosThread(on_error, self._context)
        self._thread.executor.add_node(self._node)
        self._thread.start()
        self.robots: dict[str, RosRobot] = {}
        """By the names of their nodes, in the order in which they were found."""
        self._early: deque[tuple[str, Event]] = deque(maxlen=MAX_EVENTS)
        """Lines of nodes that are no drivers, or not known as such yet."""
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
        """Take what is new of every robot."""
        for robot in self.robots.values():
            robot.sample(now)

    def sample_slow(self, now: float) -> None:
        """Take what comes rarely: diagnostics and log lines."""
        for message in take_all(self._diagnostics, MAX_AT_ONCE):
            for status in message.status:
                node, separator, part = status.name.partition(': ')
                robot = self.robots.get(f'/{node}')
                if robot is not None and separator and part == 'arm':
                    robot.on_diagnostics(status, now)
        for line in take_all(self._log, MAX_AT_ONCE):
            at = line.stamp.sec + line.stamp.nanosec * 1e-9
            event = Event(at, level(line), line.msg)
            name = '/' + line.name.replace('.', '/')
            robot = self.robots.get(name)
            if robot is not None:
                robot.state.add_event(event)
            else:
                self._early.append((name, event))

    def look_around(self, now: float) -> None:
        """Look for drivers that have come, and for the parameters of those that are there."""
        if self._find:
            kind, ending = SPEED_SERVICE
            for service, types in self._node.get_service_names_and_types():
                name = service.removesuffix(ending)
                if kind in types and name != service and name not in self.robots:
                    self._add(name)
        for robot in self.robots.values():
            robot.look_for_driver(now)

    def forget_silent(self, now: float, after: float) -> list[str]:
        """Let go of the drivers that were found and have reported nothing for `after` s.

        Returns the names of their nodes.
        """
        if not self._find:
            return []
        silent = [name for name, each in self.robots.items() if now - each.last_heard(now) > after]
        for name in silent:
            self.robots.pop(name).close()
        return silent

    def cancel_goals(self) -> bool:
        """Cancel all goals of the panel and return whether all have ended in time."""
        goals = [goal for robot in self.robots.values() for goal in robot.cancel_goals()]
        return all(goal.ended.wait(GOAL_PATIENCE_S) for goal in goals)

    def close(self) -> None:
        """Leave ROS."""
        self._thread.leave()
        self._thread.executor.shutdown()
        self._node.destroy_node()
        self._sampled.destroy_node()
        rclpy.shutdown(context=self._context)
