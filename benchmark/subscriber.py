# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A low-cost subscriber: rclpy's wait set without its executor, and raw messages."""

import threading
import time
from collections.abc import Sequence

from rclpy.context import Context
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from benchmark.state_sender import STEP_RAD

QUEUE = 5000
"""Longer than any burst, so that losses are the publisher's."""

LOOK_PERIOD_NS = 100_000_000


class Subscriber:
    """Receives the joint states of topics in a thread, and records their arrival times."""

    def __init__(self, domain: int, topics: Sequence[str]) -> None:
        self._context = Context()
        self._context.init(domain_id=domain)
        self._node = Node('subscriber', context=self._context)
        self._subscriptions = [
            self._node.create_subscription(JointState, topic, _never, QUEUE, raw=True)
            for topic in topics
        ]
        self._came: list[list[tuple[float, bytes]]] = [[] for _ in topics]
        self._ended = False
        self._thread = threading.Thread(target=self._take, daemon=True)
        self._thread.start()

    def __enter__(self) -> 'Subscriber':
        return self

    def __exit__(self, *_: object) -> None:
        self._ended = True
        self._thread.join()
        self._node.destroy_node()
        self._context.shutdown()

    def publishers(self, topic: int) -> int:
        """Return the number of publishers of a topic, given by index."""
        count: int = self._node.count_publishers(self._subscriptions[topic].topic_name)
        return count

    def count(self, topic: int) -> int:
        """Return the number of messages since the last call of `taken`."""
        return len(self._came[topic])

    def taken(self, topic: int) -> dict[int, float]:
        """Return the arrival times by message number, monotonic, s, and clear them."""
        came, self._came[topic] = self._came[topic], []
        return {
            round(deserialize_message(data, JointState).position[0] / STEP_RAD): at
            for at, data in came
        }

    def _take(self) -> None:
        wait_set = rclpy_implementation.WaitSet(
            len(self._subscriptions), 0, 0, 0, 0, 0, self._context.handle
        )
        handles = [subscription.handle for subscription in self._subscriptions]
        while not self._ended:
            wait_set.clear_entities()
            for handle in handles:
                wait_set.add_subscription(handle)
            wait_set.wait(LOOK_PERIOD_NS)
            for place, handle in enumerate(handles):
                while (taken := handle.take_message(JointState, True)) is not None:
                    self._came[place].append((time.monotonic(), taken[0]))


def _never(_message: bytes) -> None:
    raise AssertionError('no executor has this node')
