# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The simulated EPSON controller, with asyncio and without ROS.

`assembly.new_controller` creates a controller without sockets and real time: its caller supplies
the elapsed time and the received bytes. `network.servers.ControllerServers` adds ports and real
time.

The layers from the lowest: `clock`, `condition` (state tables, tasks, errors), `ports` (the
session interface), then `arm`, `io`, `faults`, `state` (the state port) and `programs` (the motion
port), then `remote` (the remote port), then `core`, which connects condition, arm and program,
then `client_connections` and `assembly`. Import from the modules: the pendant then loads only the
few that it needs.
"""
