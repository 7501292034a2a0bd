# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Ports that a SPEL+ program opens itself."""

from collections.abc import Callable
from typing import Protocol

from epson_driver.sim_controller.ports.session import Send, Session


class ProgramPorts(Protocol):
    """Which ports the program has open, and what it does with a client of one."""

    listen: Callable[[int], None]
    """Called when the program opens a TCP port that has no name here. May raise OSError."""

    def rejection(self, port: str) -> str | None:
        """Return why a client of a port cannot be served now, or None."""

    def session(self, port: str, send: Send, close: Callable[[], None]) -> Session:
        """Serve a client that is not rejected; `close` ends its connection."""
