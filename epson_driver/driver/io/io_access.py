# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The controller's I/O for the driver's users, whichever protocol it has."""

from collections.abc import Callable, Sequence
from typing import Protocol

from epson_driver.driver.io.io_driver import IoAnswer, IoDriver
from epson_driver.driver.io.motoman_io import MotomanIo
from epson_driver.driver.io.polled_io import PolledIo
from epson_driver.driver.io.remote_ethernet_io import RemoteEthernetIo
from epson_driver.driver.tasks import Notification
from epson_driver.link import Link
from epson_driver.profiles.io_profile import IoProfile
from epson_driver.remote_ethernet.client import Login
from epson_driver.remote_ethernet.turns import RemoteTurns
from epson_driver.simple_message import (
    ByteOrder,
    Dialect,
    IoAddress,
    IoRange,
    IoSetting,
    IoValues,
)


class Io(Protocol):
    """Reads, writes and watches points, with the members of IoDriver."""

    timeout: float
    states: tuple[IoValues, ...]
    reason: str
    ranges: tuple[IoRange, ...]
    on_states: Callable[[], None]
    changed: Notification

    @property
    def used(self) -> bool:
        """Whether there is a port to connect to."""

    @property
    def place(self) -> str:
        """Host and port, as diagnostics name them."""

    @property
    def link(self) -> Link | None:
        """The link of simple messages, if it is by them."""

    async def run(self) -> None:
        """Serve until cancelled."""

    def follow(self, dialect: Dialect) -> None:
        """Write as the state server does."""

    async def read(self, addresses: Sequence[IoAddress]) -> list[IoAnswer]:
        """Return an answer per address, in their order. Raises IoUnavailableError."""

    async def write(self, settings: Sequence[IoSetting]) -> list[IoAnswer]:
        """Set points in order and return one answer each. Raises IoUnavailableError."""


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
