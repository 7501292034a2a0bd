# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Chooses the I/O client that a controller's profile asks for."""

from epson_driver.driver.io.io_driver import Io, IoDriver
from epson_driver.driver.io.motoman_io import MotomanIo
from epson_driver.driver.io.polled_io import PolledIo
from epson_driver.driver.io.remote_ethernet_io import RemoteEthernetIo
from epson_driver.profiles.io_profile import IoProfile
from epson_driver.remote_ethernet.client import Login
from epson_driver.remote_ethernet.turns import RemoteTurns
from epson_driver.simple_message import (
    ByteOrder,
)


def make_io(
    profile: IoProfile,
    host: str,
    ports: tuple[int, int],
    *,
    byte_order: ByteOrder | None,
    timeout: float,
    turns: RemoteTurns,
    login: Login | None = None,
) -> Io:
    """Return the I/O client that a profile asks for. `ports`: I/O port, remote port.

    login: how to be logged in at the latter; None: anew for each request.
    """
    io_port, remote_port = ports
    if profile.access == 'server':
        return IoDriver(host, io_port, byte_order=byte_order, timeout=timeout)
    if profile.access == 'motoman':
        return PolledIo(MotomanIo(host, io_port, byte_order), profile, timeout)
    return PolledIo(RemoteEthernetIo(host, remote_port, turns, login), profile, timeout)
