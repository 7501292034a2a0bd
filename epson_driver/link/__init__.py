# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Client-side connections to a controller, with asyncio and without ROS."""

from epson_driver.link.connection import WireEvent
from epson_driver.link.link import Link, LinkStatistics
from epson_driver.link.replies import PendingRequest
from epson_driver.link.states import LinkState

__all__ = ['Link', 'LinkState', 'LinkStatistics', 'PendingRequest', 'WireEvent']
