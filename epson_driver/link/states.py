# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The states of a link and everything that moves it from one to another.

Rules:
1. Every change of a link's state is a row of TRANSITIONS; an event without a row changes nothing
   and is a programming error.
2. A link that is open never gives up: it is CONNECTED, or on its way there. The controller may
   start before or after the client, and may come back at any time.
3. A link that comes back does not mean that the arm may move: the arm gate of the client decides
   that (docs/invariants.md, 4).
"""

from enum import Enum


class LinkState(Enum):
    """The state of a link. Its value is what `~/link_state` publishes."""

    DISCONNECTED = 'disconnected'
    CONNECTING = 'connecting'
    CONNECTED = 'connected'
    BACKING_OFF = 'backing_off'


class LinkEvent(Enum):
    """What happens to a link."""

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

BACK_OFF = (0.0, 0.1, 0.2, 0.4, 0.8, 1.0)
"""Seconds between the beginnings of two attempts: the first retry at once, then at most 1 s."""


def back_off(attempt: int) -> float:
    """Return the time to wait before retry number `attempt` (counted from 0), s."""
    return BACK_OFF[min(attempt, len(BACK_OFF) - 1)]
