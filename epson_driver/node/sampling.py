# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Polled subscriptions: messages are read on request, not by an executor.

An executor would rebuild its wait set for each of hundreds of messages a second.
"""

from typing import Any

from rcl_interfaces.msg import Log
from rclpy.node import Node
from rclpy.qos import QoSProfile


def sampled(node: Node, kind: Any, topic: str, qos: QoSProfile | int, *, raw: bool = False) -> Any:
    """Return a subscription for `take`."""
    return node.create_subscription(kind, topic, _never, qos, raw=raw)


def take(subscription: Any) -> Any:
    """Return the next message, or None."""
    with subscription.handle:
        taken = subscription.handle.take_message(subscription.msg_type, subscription.raw)
    return None if taken is None else taken[0]


def take_all(subscription: Any, most: int) -> list[Any]:
    """Return the pending messages, at most `most`. The others remain pending."""
    messages: list[Any] = []
    while len(messages) < most and (message := take(subscription)) is not None:
        messages.append(message)
    return messages


def level(line: Log) -> int:
    """Return the level of a line of `/rosout`, which is bytes in some distributions."""
    return line.level if isinstance(line.level, int) else int.from_bytes(line.level, 'little')


def _never(_message: Any) -> None:
    raise RuntimeError('no executor serves this subscription')
