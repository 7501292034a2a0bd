# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What a port does with one client, without a socket: bytes in, bytes out.

Every port of the controller is a way to open sessions; `port_server.py` gives them sockets, a test
calls them directly.
"""

from collections.abc import Callable
from typing import Protocol

Send = Callable[[bytes], None]
"""Takes the bytes of one message or line."""


class Session(Protocol):
    """One client of one port."""

    def receive(self, data: bytes) -> None:
        """Take bytes from the client, in any segmentation.

        Raises FrameError when the position in the stream is lost: the connection must be closed.
        """

    def closed(self) -> None:
        """The client is gone: send nothing any more. Twice is no error."""


class Client(Protocol):
    """Where a client's bytes go, how its connection ends, and whether it is of this machine."""

    @property
    def local(self) -> bool:
        """Whether the client runs on the machine that the controller runs on."""

    def send(self, data: bytes) -> None:
        """Send bytes; to a closed connection, drop them."""

    def close(self) -> None:
        """Close once everything is sent."""

    def abort(self) -> None:
        """Close at once and drop what is not sent."""
