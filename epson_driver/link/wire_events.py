# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What happens on a connection to a controller: told by a link, written and read by traces."""

from collections.abc import Callable
from enum import StrEnum

Address = tuple[str, int]
"""IP address (either version) and port."""


class WireEvent(StrEnum):
    """One step of a connection, from the client's side."""

    OPENED = 'opened'
    SENT = 'sent'
    RECEIVED = 'received'
    ENDED = 'ended'
    """The controller closed it."""
    RESET = 'reset'
    """The controller broke it off."""
    CLOSED = 'closed'
    """The client closed it."""


Tap = Callable[[WireEvent, bytes], None]
"""Called with each step and its bytes as they went over the wire: for SENT and RECEIVED only."""
