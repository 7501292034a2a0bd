# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Connections to a controller, from the client's side. asyncio, no ROS."""
