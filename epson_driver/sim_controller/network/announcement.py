# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Announces a simulated controller to the other processes of this machine, by its remote port.

The panel connects only to announced ports. A real controller may be reachable at an address of
this machine, through a tunnel, and a second client could take the place of its driver.

The announcement is an abstract Unix socket. It exists as long as the process that created it, and
is visible in the same network namespace only.
"""

import socket


def _name(port: int) -> str:
    return f'\0epson_driver sim_controller, remote port {port}'


def announce(port: int) -> socket.socket:
    """Announce a simulated controller until the returned socket is closed.

    Raises OSError if another process has announced one with this remote port.
    """
    result = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    try:
        result.bind(_name(port))
    except OSError:
        result.close()
        raise
    return result


def is_announced(port: int) -> bool:
    """Return whether a simulated controller with this remote port runs on this machine."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as probe:
        return probe.connect_ex(_name(port)) == 0
