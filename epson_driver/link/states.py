# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The states of a link and all transitions between them.

Rules:
1. Every change of a link's state is a row of TRANSITIONS. An event without a row is a programming
   error and raises KeyError.
2. An open link never gives up. It is either CONNECTED or tries to connect. The controller may
   start before or after the driver, and may return at any time.
3. A new connection does not allow the arm to move. The driver's gate decides that
   (docs/invariants.md, 4).
"""

from enum import Enum


class LinkState(Enum):
    """State of a link. Its value is published on `~/link_state`."""

    DISCONNECTED = 'disconnected'
    CONNECTING = 'connecting'
    CONNECTED = 'connected'
    BACKING_OFF = 'backing_off'


class LinkEvent(Enum):
    OPEN = 'open'
    ESTABLISHED = 'established'
    FAILED = 'failed'
    LOST = 'lost'
    RETRY = 'retry'
    CLOSE = 'close'


TRANSITIONS: dict[tuple[LinkState, LinkEvent], LinkState] = {
    (LinkState.DISCONNECTED, LinkEvent.OPEN): LinkState.CONNECTING,
    (LinkState.CONNECTING, LinkEvent.ESTABLISHED): LinkState.CONNECTED,
    (LinkState.CONNECTING, LinkEvent.FAILED): LinkState.BACKING_OFF,
    (LinkState.CONNECTING, LinkEvent.CLOSE): LinkState.DISCONNECTED,
    (LinkState.CONNECTED, LinkEvent.LOST): LinkState.BACKING_OFF,
    (LinkState.CONNECTED, LinkEvent.CLOSE): LinkState.DISCONNECTED,
    (LinkState.BACKING_OFF, LinkEvent.RETRY): LinkState.CONNECTING,
    (LinkState.BACKING_OFF, LinkEvent.CLOSE): LinkState.DISCONNECTED,
}

BACK_OFF = (0.0, 0.1, 0.2, 0.4, 0.8, 1.0)  # waits between attempts, s


def back_off(attempt: int) -> float:
    return BACK_OFF[min(attempt, len(BACK_OFF) - 1)]
