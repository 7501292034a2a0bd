# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The simulated EPSON controller, with asyncio and without ROS.

`assembly.new_controller` creates a controller that uses neither sockets nor real time. Its caller
supplies the elapsed time and the received bytes. `network.servers.ControllerServers` adds ports
and real time.

The layers from the lowest: `clock`, `condition` (state tables, tasks, errors), `ports` (the
session interface), then `arm`, `io`, `faults`, `state` (the STATUS), then `core`, which connects
condition, arm and program, then `programs` (the motion port), `remote` (the remote port),
`spel_host`, `client_connections`, `network` and `assembly`. Import from the modules: the pendant
then loads only the few that it needs.
"""
