# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A ROS node that sees what arrives of each robot of a fleet: links, answers, joint states."""

import time
from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import rclpy
from rcl_interfaces.srv import GetParameters
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from epson_driver.node.ros_transport import udp_by_default
from epson_driver.node.sampling import sampled, take_all

KEPT_STATES = 2000
"""Joint states of one robot that wait to be counted: those of ten seconds."""

TURN_S = 0.1


class Seen(NamedTuple):
    """Messages of one robot in an interval."""

    link: str
    """The driver's `~/link_state`; empty if none came yet."""
    rate: float
    """Joint states per second."""
    answer_s: float | None
    """How long a service call took; None: it was not answered."""


class Watch:
    """Hears the robots of these namespaces until `close`, in one thread."""

    def __init__(self, names: Sequence[str]) -> None:
        with udp_by_default():
            rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
            self._node = rclpy.create_node('fleet')
        self._counter = rclpy.create_node('fleet_counter')
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._links = dict.fromkeys(names, '')
        self._calls: dict[str, tuple[float, Any]] = {}
        self._answers: dict[str, float] = {}
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        states = QoSProfile(depth=KEPT_STATES, reliability=ReliabilityPolicy.BEST_EFFORT)
        self._states: dict[str, Any] = {}
        self._clients: dict[str, Any] = {}
        for name in names:
            driver = f'/{name}/epson_driver'
            self._node.create_subscription(
                String, f'{driver}/link_state', partial(self._on_link, name), latched
            )
            self._clients[name] = self._node.create_client(
                GetParameters, f'{driver}/get_parameters'
            )
            topic = f'/{name}/joint_states'
            self._states[name] = sampled(self._counter, JointState, topic, states, raw=True)

    def close(self) -> None:
        """Leave ROS."""
        self._executor.shutdown()
        self._node.destroy_node()
        self._counter.destroy_node()
        rclpy.shutdown()

    def connected(self) -> list[str]:
        """Return the robots whose driver says that it has its controller."""
        return [name for name, link in self._links.items() if link == 'connected']

    def spin(self, seconds: float) -> None:
        """Spin for `seconds`."""
        until = time.monotonic() + seconds
        while (left := until - time.monotonic()) > 0.0:
            self._executor.spin_once(timeout_sec=min(left, TURN_S))

    def hear(self, seconds: float) -> dict[str, Seen]:
        """Hear for so long, s, and return what came of each robot in that time."""
        self._count()
        began = time.monotonic()
        self._answers.clear()
        for name, client in self._clients.items():
            if name not in self._calls and client.service_is_ready():
                request = GetParameters.Request(names=['robot_model'])
                self._calls[name] = (time.monotonic(), client.call_async(request))
                self._calls[name][1].add_done_callback(partial(self._on_answer, name))
        self.spin(seconds)
        counts = self._count()
        lasted = time.monotonic() - began
        return {
            name: Seen(link, counts[name] / lasted, self._answers.get(name))
            for name, link in self._links.items()
        }

    def forget(self, name: str) -> None:
        """Forget what a robot whose driver has ended said last."""
        self._links[name] = ''
        self._calls.pop(name, None)

    def _count(self) -> dict[str, int]:
        """Take the joint states that waited, and return how many there were of each robot."""
        return {name: len(take_all(each, KEPT_STATES)) for name, each in self._states.items()}

    def _on_link(self, name: str, message: Any) -> None:
        self._links[name] = message.data

    def _on_answer(self, name: str, _future: Any) -> None:
        if name in self._calls:
            self._answers[name] = time.monotonic() - self._calls.pop(name)[0]
