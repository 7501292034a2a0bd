# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Heartbeats for a controller that stops the arm when its motion client hangs.

Only for one whose profile says so, and whose program does too: its version is asked for on the
state port, and by each enable until it has said so. Other programs get nothing new on the motion
port, whatever the profile: the published one for EPSON's C3 would end there. It does not read its
state port.

A heartbeat is a PING as a topic: REP-I0006 has nobody answer that, so it takes part in no matching
of replies. The first one goes before the first point; then one follows every BEAT of the time-out,
from the loop that does all the rest, so that none is sent while the loop hangs.

A driver that hung goes by the same time-out: what it was doing is over, even where the arm stood
by itself, at the last point that it had, before the controller would have stopped it.
"""

import asyncio
import contextlib
from collections.abc import Callable

from epson_driver.link import Link, PendingRequest
from epson_driver.simple_message import GetVersion, Packet, Ping, ReplyCode

BEAT = 0.05
"""Period of the heartbeats as a share of the time-out. The loop may stall for the rest of it."""

BUSY = 'this machine is too busy: '
REMEDY = ', end other programs or allow a higher priority (docs/troubleshooting.md)'
"""Around the first report."""

FIRST_VERSION = (0, 2)
"""Of a program that has a watchdog."""


class Heartbeat:
    """Sends heartbeats on the `motion` link while `wanted` says that there are points.

    `timeout`: how long the controller waits for one, s; 0: it wants none, and gets none. `on_hung`
    is called, with a clause that says so, when none was sent for longer.
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
        """The longest time between two heartbeats during a motion, s."""

    def ask(self) -> None:
        """Ask the controller, once on each state connection, whether it has a watchdog."""
        if self._timeout and self._asked is None:
            with contextlib.suppress(ConnectionError):
                self._asked = self._state.post(GetVersion(), self._on_version)

    def ask_again(self) -> None:
        """Ask once more if it has not answered that it has one: bits may have been changed."""
        if self._asked is not None and not self._watched:
            self._state.give_up(self._asked)
            self._asked = None
            self.ask()

    def forget(self) -> None:
        """Take note that the state link is gone: another controller may answer next."""
        self._asked, self._watched = None, False

    def before_point(self) -> None:
        """Make sure that a point may be sent. Raises ConnectionError if the loop hung before."""
        if not self._watched:
            return
        if not self._wanted():
            self._send()
        elif (why := self.look()) is not None:
            raise ConnectionError(why)

    async def run(self) -> None:
        """Send them until cancelled."""
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
        with contextlib.suppress(ConnectionError):  # without a link the controller stops itself
            self._motion.tell(Ping())

    def look(self, *, stopped: bool = False) -> str | None:
        """End the motion if the loop hung since the last heartbeat, and return a clause.

        `stopped`: the controller reports that it heard nothing. Half the time-out shows then that
        the loop was the cause.
        """
        if not (self._watched and self._wanted()):
            return None
        hung = _now() - self._sent
        self.longest_gap = max(self.longest_gap, hung)
        if hung <= self._timeout * (0.5 if stopped else 1.0):
            return None
        why = f'this driver hung for {hung:.3g} s: the controller waits {self._timeout:g} s for it'
        if not self._reported:
            self._reported, why = True, f'{BUSY}{why}{REMEDY}'
        self._sent = _now()
        self._on_hung(why)
        return why


def _now() -> float:
    return asyncio.get_running_loop().time()
