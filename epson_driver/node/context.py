# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What the interfaces of one node share."""

from dataclasses import dataclass
from typing import Any

from rclpy.node import Node

from epson_driver.driver.driver import Driver
from epson_driver.node.loop_bridge import LoopBridge
from epson_driver.setup.setup import Setup


@dataclass(frozen=True)
class NodeContext:
    """A node's driver, what that was made with, and the way from rclpy's thread to its loop."""

    driver: Driver
    setup: Setup
    bridge: LoopBridge

    @property
    def node(self) -> Node:
        """The node of rclpy."""
        return self.bridge.node

    @property
    def values(self) -> dict[str, Any]:
        """The node's parameters by name, which may change."""
        return self.setup.values
