# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Log entries of a link: once per loss or recovery, not for every attempt to reconnect.

A controller that serves one client closes the connections of a second one immediately. After
MAX_SHORT such connections this is logged once, and then nothing until a connection lasts.
"""

import asyncio
import logging

from epson_driver.link.link import Link
from epson_driver.link.states import LinkState

SHORT_S = 0.2
"""Duration below which a connection closed by the controller was not served, s."""

MAX_SHORT = 3

TURNED_AWAY = 'another client is connected, or its program is not running'
"""Explanation for a controller that closes connections immediately."""

_log = logging.getLogger(__name__)


class LinkReports:
    """Reports of one link. Call `tell` on each change of its state, in the event loop.

    `configured_as`: the configured controller and model (the protocol cannot identify the peer).
    """

    def __init__(self, link: Link, configured_as: str = '') -> None:
        self._link = link
        self._peer = f', configured as {configured_as}' if configured_as else ''
        self._missed = False
        self._short = 0
        self._connected_at: float | None = None
        self._lasting: asyncio.TimerHandle | None = None

    def tell(self, why: str) -> None:
        """Log the link's current state, unless already logged. `why`: its cause."""
        link, loop = self._link, asyncio.get_running_loop()
        if self._lasting is not None:
            self._lasting.cancel()
            self._lasting = None
        if link.connected:
            self._connected_at = loop.time()
            if self._short >= MAX_SHORT:
                self._lasting = loop.call_later(SHORT_S, self._served, why)
            else:
                self._connected(why)
        elif link.state is LinkState.BACKING_OFF:
            self._lost(why, loop.time())
        else:
            _log.debug('%s link %s: %s', link.name, link.state.value, why)

    def _served(self, why: str) -> None:
        self._short = 0
        self._connected(why)

    def _connected(self, why: str) -> None:
        self._missed = False
        _log.info('%s link connected: %s%s', self._link.name, why, self._peer)

    def _lost(self, why: str, now: float) -> None:
        connected, self._connected_at = self._connected_at, None
        if connected is not None:
            self._short = self._short + 1 if now - connected < SHORT_S else 0
        if self._short == MAX_SHORT and connected is not None:
            _log.warning(
                '%s link: the controller closed %d connections immediately (%s): %s; retrying '
                'every ≤ 1 s',
                self._link.name,
                MAX_SHORT,
                why,
                TURNED_AWAY,
            )
        elif self._short < MAX_SHORT and not self._missed:
            _log.warning('%s link down: %s; retrying every ≤ 1 s', self._link.name, why)
        self._missed = True
