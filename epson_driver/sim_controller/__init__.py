# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The simulated EPSON controller. asyncio, no ROS.

`assembly.new_controller` makes one. It has no sockets, and time is passed in: it is stepped by
time and fed with bytes. `network.servers.ControllerServers` gives it ports and the real time.

From the lowest layer up: `clock`, `condition` (state tables, tasks, errors), `ports` (what a
session is); `arm`, `io`, `faults`, `state` (the state port), `programs` (the motion port);
`remote` (the remote port); `core`, which connects condition, arm and program;
`client_connections`; `assembly`. Import from the modules: what the pendant needs of them is light.
"""
