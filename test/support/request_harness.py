# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Requests without ROS: the test runs the executor's work by hand."""

import asyncio
from contextvars import copy_context
from types import SimpleNamespace
from typing import Any

import pytest
from rclpy.action.server import GoalStatus

from epson_driver.node.loop_bridge import LoopBridge


class Log:
    """A node's logger."""

    def __init__(self):
        self.lines = []

    def __getattr__(self, severity):
        return lambda text: self.lines.append((severity, text))


class Node:
    """A node that records services and subscriptions by name."""

    def __init__(self):
        self.log = Log()
        self.services = []
        self.served = {}
        self.taken = {}
        self.executor = SimpleNamespace(wake=lambda: None)

    def get_logger(self):
        return self.log

    def get_clock(self):
        return None

    def create_service(self, _kind, name, answer, **_):
        self.served[name] = answer

    def create_subscription(self, _kind, topic, callback, *_, **__):
        self.taken[topic] = callback

    def create_publisher(self, *_):
        return None


def done(coroutine):
    """Return the result of a coroutine that never waits."""
    with pytest.raises(StopIteration) as end:
        coroutine.send(None)
    return end.value.value


class Made:
    """A bridge in a loop that runs only on request."""

    def __init__(self):
        self.node = Node()
        self.loop = asyncio.new_event_loop()
        self.faults: list[Any] = []

        async def make():
            return LoopBridge(self.node, copy_context(), self.faults.append)

        self.bridge = self.loop.run_until_complete(make())

    def turn(self):
        self.loop.run_until_complete(asyncio.sleep(0))

    def end(self):
        self.loop.close()
        self.bridge.end()


class RosHandle:
    """A ROS goal. `cancels`: number of reads after which it is canceled."""

    def __init__(self, cancels=None, request=None):
        self._reads = 0
        self._cancels = cancels
        self.goal_id = SimpleNamespace(uuid=bytes(16))
        self.request = request
        self.ended = []

    @property
    def is_cancel_requested(self):
        self._reads += 1
        return self._cancels is not None and self._reads > self._cancels

    @property
    def status(self):
        canceling = self._cancels is not None
        return GoalStatus.STATUS_CANCELING if canceling else GoalStatus.STATUS_EXECUTING

    def succeed(self):
        self.ended.append('succeeded')

    def canceled(self):
        self.ended.append('canceled')

    def abort(self):
        self.ended.append('aborted')
