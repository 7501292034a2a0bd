# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Log messages about the state of a link: one per loss or recovery, not one per attempt.

A controller that serves only one client closes the connections of a second client immediately.
After MAX_SHORT such connections, a warning is logged, and then nothing until a connection lasts.
"""

import asyncio
import logging

from epson_driver.link.link import Link
from epson_driver.link.states import LinkState

SHORT_S = 0.2  # duration below which a connection counts as closed immediately, s
MAX_SHORT = 3  # successive short connections after which a likely cause is logged

TURNED_AWAY = 'another client is connected, or its program is not running'

_log = logging.getLogger(__name__)


class LinkReports:
    """Logs the state of one link. `configured_as`: the configured controller and model."""

    def __init__(self, link: Link, configured_as: str = '') -> None:
        self._link = link
        self._peer = f', configured as {configured_as}' if configured_as else ''
        self._failure_logged = False
        self._short = 0
        self._connected_at: float | None = None
        self._timer: asyncio.TimerHandle | None = None

    def log_state(self, why: str) -> None:
        """Log the link's new state and its reason, unless this repeats a logged failure."""
        link, loop = self._link, asyncio.get_running_loop()
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if link.connected:
            self._connected_at = loop.time()
            if self._short >= MAX_SHORT:
                self._timer = loop.call_later(SHORT_S, self._served, why)
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
        self._failure_logged = False
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
        elif self._short < MAX_SHORT and not self._failure_logged:
            _log.warning('%s link down: %s; retrying every ≤ 1 s', self._link.name, why)
        self._failure_logged = True
