# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The simulated EPSON controller. asyncio, no ROS.

`core.Controller` has no clock and no sockets: it is stepped by time and fed with bytes. Around it,
`servers.ControllerServers` has the four ports and the real time. Import from the modules: what the
pendant needs of them is light.
"""
