# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Heartbeats for a controller that stops the arm when its motion client stalls.

Heartbeats are sent only if the profile enables them and the controller's program supports them.
The driver requests the program's version on the state port. It repeats the request with each
enable until a version that supports heartbeats is confirmed. No other program receives heartbeats,
because an unknown message may terminate it.

A heartbeat is a PING sent as a topic. Topics have no replies (REP-I0006), so heartbeats do not
affect the matching of replies to requests. The first heartbeat precedes the first point. The event
loop that does all other work sends the next ones, so none is sent while that loop is stalled.

A stalled driver applies the same timeout to itself. It ends its goal or stream, even if the arm
has come to rest at its last point before the controller stopped it.
"""

import asyncio
import contextlib
from collections.abc import Callable

from epson_driver.link import Link, PendingRequest
from epson_driver.simple_message import GetVersion, Packet, Ping, ReplyCode

BEAT = 0.05
"""Period of the heartbeats as a fraction of the timeout."""

BUSY = 'this machine is too busy: '
REMEDY = ', end other programs or allow a higher priority (docs/troubleshooting.md)'
"""Texts before and after the first report of a stall."""

FIRST_VERSION = (0, 2)
"""First version of the controller program that supports heartbeats."""


class Heartbeat:
    """Sends heartbeats on the `motion` link while `has_points` returns True.

    `has_points` returns whether the controller may have points of this driver to execute.
    `timeout`: the controller's heartbeat timeout, s; 0 disables heartbeats. `on_stall` is called
    with the reason if no heartbeat was sent for longer than `timeout`.
    """

    def __init__(
        self,
        motion: Link,
        state: Link,
        timeout: float,
        has_points: Callable[[], bool],
        on_stall: Callable[[str], None],
    ) -> None:
        self._motion = motion
        self._state = state
        self._timeout = timeout
        self._has_points = has_points
        self._on_stall = on_stall
        self._request: PendingRequest | None = None
        self._supported = False
        self._sent = 0.0
        self._reported = False
        self.longest_gap = 0.0
        """Longest time between two heartbeats during a motion, s."""

    def request_version(self) -> None:
        """Request the version of the controller's program, once per state connection."""
        if self._timeout and self._request is None:
            with contextlib.suppress(ConnectionError):
                self._request = self._state.post(GetVersion(), self._on_version)

    def repeat_request(self) -> None:
        """Request the version again if no version that supports heartbeats was received."""
        if self._request is not None and not self._supported:
            self._state.give_up(self._request)
            self._request = None
            self.request_version()

    def reset(self) -> None:
        """Discard the version of the controller's program, because the state link was lost."""
        self._request, self._supported = None, False

    def before_point(self) -> None:
        """Send a heartbeat before a motion. Raises ConnectionError if the loop has stalled."""
        if not self._supported:
            return
        if not self._has_points():
            self._send()
        elif (why := self.check_stall()) is not None:
            raise ConnectionError(why)

    async def run(self) -> None:
        """Send heartbeats until cancelled."""
        while self._timeout:
            await asyncio.sleep(BEAT * self._timeout)
            if self._supported and self._has_points():
                self.check_stall()
                self._send()

    def _on_version(self, packet: Packet, now: float) -> None:
        message = packet.message
        if packet.reply_code is ReplyCode.SUCCESS and isinstance(message, GetVersion):
            self._supported = message.version >= FIRST_VERSION
            self._sent = now

    def _send(self) -> None:
        self._sent = _now()
        with contextlib.suppress(ConnectionError):  # without a link the controller stops anyway
            self._motion.send_topic(Ping())

    def check_stall(self, *, stopped: bool = False) -> str | None:
        """End the motion and return the reason if the loop was stalled since the last heartbeat.

        Returns None without a stall, or if no heartbeats are needed now. `stopped`: the controller
        reports that its heartbeat timeout expired, so a gap of half the timeout counts as a stall.
        """
        if not (self._supported and self._has_points()):
            return None
        gap = _now() - self._sent
        self.longest_gap = max(self.longest_gap, gap)
        if gap <= self._timeout * (0.5 if stopped else 1.0):
            return None
        why = f'this driver was stalled for {gap:.3g} s, the controller waits {self._timeout:g} s'
        if not self._reported:
            self._reported, why = True, f'{BUSY}{why}{REMEDY}'
        self._sent = _now()
        self._on_stall(why)
        return why


def _now() -> float:
    return asyncio.get_running_loop().time()
