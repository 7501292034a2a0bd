# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Heartbeats for a controller that stops the arm when its motion client stalls.

Heartbeats are sent only if the profile enables them and the controller's program supports them.
The driver requests the program's version on the state port, and repeats the request with each
enable until the version is known to support heartbeats. Other programs receive no new messages on
the motion port, whatever the profile: they would terminate the published program for EPSON's C3,
which does not read its state port.

A heartbeat is a PING sent as a topic. REP-I0006 defines no reply to a topic, so heartbeats do not
take part in matching replies to requests. The first heartbeat is sent before the first point. The
next ones follow every BEAT of the timeout. They are sent by the loop that does all other work, so
none is sent while the loop stalls.

A stalled driver applies the same timeout to itself. It abandons its goal or stream, even if the
arm came to rest at its last point before the controller would have stopped it.
"""

import asyncio
import contextlib
from collections.abc import Callable

from epson_driver.link import Link, PendingRequest
from epson_driver.simple_message import GetVersion, Packet, Ping, ReplyCode

BEAT = 0.05
"""Period of the heartbeats as a fraction of the timeout. The loop may stall for the rest of it."""

BUSY = 'this machine is too busy: '
REMEDY = ', end other programs or allow a higher priority (docs/troubleshooting.md)'
"""Text before and after the first report of a stall."""

FIRST_VERSION = (0, 2)
"""Version of the first program with a watchdog."""


class Heartbeat:
    """Sends heartbeats on the `motion` link while `wanted` returns True (points are pending).

    `timeout`: the controller's heartbeat timeout, s; 0 disables heartbeats. `on_hung` is called
    with a clause for the error text when no heartbeat was sent for longer than that.
    """

    def __init__(
        self,
        motion: Link,
        state: Link,
        timeout: float,
        wanted: Callable[[], bool],
        on_hung: Callable[[str], None],
    ) -> None:
        self._motion = motion
        self._state = state
        self._timeout = timeout
        self._wanted = wanted
        self._on_hung = on_hung
        self._asked: PendingRequest | None = None
        self._watched = False
        self._sent = 0.0
        self._reported = False
        self.longest_gap = 0.0
        """Longest time between two heartbeats during a motion, s."""

    def ask(self) -> None:
        """Request the version of the controller's program, once per state connection."""
        if self._timeout and self._asked is None:
            with contextlib.suppress(ConnectionError):
                self._asked = self._state.post(GetVersion(), self._on_version)

    def ask_again(self) -> None:
        """Repeat the request unless a watchdog is confirmed: the reply may have been corrupted."""
        if self._asked is not None and not self._watched:
            self._state.give_up(self._asked)
            self._asked = None
            self.ask()

    def forget(self) -> None:
        """Forget the version after the state link is lost: another controller may reply next."""
        self._asked, self._watched = None, False

    def before_point(self) -> None:
        """Send or check the heartbeat before a point. Raises ConnectionError after a stall."""
        if not self._watched:
            return
        if not self._wanted():
            self._send()
        elif (why := self.look()) is not None:
            raise ConnectionError(why)

    async def run(self) -> None:
        """Send heartbeats until cancelled."""
        while self._timeout:
            await asyncio.sleep(BEAT * self._timeout)
            if self._watched and self._wanted():
                self.look()
                self._send()

    def _on_version(self, packet: Packet, now: float) -> None:
        message = packet.message
        if packet.reply_code is ReplyCode.SUCCESS and isinstance(message, GetVersion):
            self._watched = message.version >= FIRST_VERSION
            self._sent = now

    def _send(self) -> None:
        self._sent = _now()
        with contextlib.suppress(ConnectionError):  # without a link the controller stops anyway
            self._motion.send_topic(Ping())

    def look(self, *, stopped: bool = False) -> str | None:
        """Return a clause and end the motion if the loop stalled since the last heartbeat.

        Returns None if it did not, or if no heartbeats are needed now.
        `stopped`: the controller reports that its watchdog expired. Half the timeout is then
        enough to show that the loop was the cause.
        """
        if not (self._watched and self._wanted()):
            return None
        hung = _now() - self._sent
        self.longest_gap = max(self.longest_gap, hung)
        if hung <= self._timeout * (0.5 if stopped else 1.0):
            return None
        why = f'this driver was stalled for {hung:.3g} s, the controller waits {self._timeout:g} s'
        if not self._reported:
            self._reported, why = True, f'{BUSY}{why}{REMEDY}'
        self._sent = _now()
        self._on_hung(why)
        return why


def _now() -> float:
    return asyncio.get_running_loop().time()
