# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Heartbeats for a controller that stops the arm when its motion client stalls.

Heartbeats are sent only if the profile enables them and the controller's program supports them.
The driver requests the program's version on the state port. It repeats the request each time the
arm is enabled, until the program reports a version that supports heartbeats. No other program
receives heartbeats, because an unknown message may terminate it.

A heartbeat is a PING sent as a topic. Topics have no replies (REP-I0006), so heartbeats do not
affect the matching of replies to requests. The first heartbeat precedes the first point. The event
loop that does all other work sends the later heartbeats, so they stop if that loop stalls.

A driver that has stalled applies the same timeout to itself. It ends its goal or stream, even if
the arm has come to rest at its last point before the controller stopped it.
"""

import asyncio
import contextlib
from collections.abc import Callable

from epson_driver.link import Link, PendingRequest
from epson_driver.simple_message import GetVersion, Packet, Ping, ReplyCode

BEAT = 0.05  # period of the heartbeats as a fraction of the timeout

BUSY = 'this machine is too busy: '
REMEDY = ', end other programs or allow a higher priority (docs/troubleshooting.md)'
"""Remedy that follows the first reported stall, after BUSY and the time of the stall."""

FIRST_VERSION = (0, 2)  # first version of the controller program that supports heartbeats


class Heartbeat:
    """Sends heartbeats while the controller may have points of this driver (`has_points`).

    `timeout`: the controller's heartbeat timeout, s. 0 disables heartbeats. `on_stall(why)` is
    called if this driver has sent no heartbeat for longer than the timeout.
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
        self.longest_gap = 0.0  # longest time between two heartbeats during a motion, s

    def request_version(self) -> None:
        if self._timeout and self._request is None:
            with contextlib.suppress(ConnectionError):
                self._request = self._state.post(GetVersion(), self._on_version)

    def repeat_request(self) -> None:
        if self._request is not None and not self._supported:
            self._state.give_up(self._request)
            self._request = None
            self.request_version()

    def reset(self) -> None:
        self._request, self._supported = None, False

    def before_point(self) -> None:
        """Send a heartbeat before a motion. Raises ConnectionError if this process has stalled."""
        if not self._supported:
            return
        if not self._has_points():
            self._send()
        elif (why := self.check_stall()) is not None:
            raise ConnectionError(why)

    async def run(self) -> None:
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
        """If the event loop has stalled, call `on_stall` and return the reason, else return None.

        `stopped`: the arm is at rest. The controller may have stopped it, so a stall of half the
        timeout is enough.
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
