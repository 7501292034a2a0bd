# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Sends the state of the chosen robot to one browser window of the panel.

The state consists of named parts, such as joints or lamps. A part is sent when it has changed. On
a slow connection a newer version replaces the queued one, so each part is queued once at most.
"""

import asyncio
import contextlib
import itertools
import json
import threading
from collections import deque
from collections.abc import Awaitable, Callable
from typing import Any

MAX_NOTES = 10
"""Maximum notes queued for a window. The oldest are dropped."""

MAX_LATE_S = 0.15
"""Maximum delay of jog and step requests, s. A message delayed longer in transit would move the
arm after the button was released."""

HELD_S = 0.07
"""Time after the last request of a pressed button until the arm brakes, s. The page sends one
every 25 ms (hand.js). Otherwise the arm would brake after the driver's `servo.timeout`."""

MAX_MESSAGES_PER_S = 100.0
"""The page sends 44 during a jog."""

MAX_BURST_S = 10.0
"""Period whose messages a slow line may deliver together, s."""

_numbers = itertools.count(1)


class BadMessageError(ValueError):
    """A window has sent a message that the page never sends."""


def text_of(value: object) -> str:
    """Return the JSON text of a part."""
    return json.dumps(value, allow_nan=False, separators=(',', ':'))


class Window:
    """A page in a browser. `loop`: the web server's event loop.

    `offer` and `say` may be called in any thread.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self.number = next(_numbers)
        self.robot = ''
        """The name of the chosen robot. Empty until one is chosen."""
        self._loop = loop
        self._lock = threading.Lock()
        self._waiting: dict[str, str] = {}
        self._sent: dict[str, str] = {}
        self._notes: deque[str] = deque(maxlen=MAX_NOTES)
        self._news = asyncio.Event()
        self._paid_until = 0.0
        self._quickest: float | None = None
        self._silence: asyncio.TimerHandle | None = None

    def choose(self, robot: str) -> None:
        """Switch to another robot and send all of its parts."""
        with self._lock:
            self.robot = robot
            self._waiting.clear()
            self._sent.clear()

    def offer(self, robot: str, parts: dict[str, str]) -> None:
        """Send the parts that have changed, as made by `text_of`, to a window of a robot."""
        with self._lock:
            if robot != self.robot:
                return
            news = {key: text for key, text in parts.items() if self._sent.get(key) != text}
            self._waiting |= news
            self._sent |= news
        if news:
            self._wake()

    def say(self, text: str) -> None:
        """Show a note to the user, once."""
        with self._lock:
            self._notes.append(text)
        self._wake()

    def count(self, now: float) -> None:
        """Count a frame. Raises BadMessageError at more frames than a page sends. now: s."""
        self._paid_until = max(self._paid_until, now) + 1.0 / MAX_MESSAGES_PER_S
        if self._paid_until > now + MAX_BURST_S:
            raise BadMessageError(f'more than {MAX_MESSAGES_PER_S:g} messages per second')

    def late(self, sent: float, now: float) -> bool:
        """Return whether a message took MAX_LATE_S longer than the quickest one.

        sent: time by the window's clock, s. now: time by the panel's clock, s.
        """
        taken = now - sent
        if self._quickest is None or taken < self._quickest:
            self._quickest = taken
        return taken - self._quickest > MAX_LATE_S

    def after_silence(self, do: Callable[[], object]) -> None:
        """Call `do` when this was not called again for HELD_S. In the loop's thread."""
        if self._silence is not None:
            self._silence.cancel()
        self._silence = self._loop.call_later(HELD_S, do)

    async def write(self, send: Callable[[str], Awaitable[Any]]) -> None:
        """Send the queued parts and notes until the task is canceled."""
        while True:
            await self._news.wait()
            self._news.clear()
            with self._lock:
                parts, self._waiting = self._waiting, {}
                notes = list(self._notes)
                self._notes.clear()
                robot = self.robot
            if notes:
                parts['notes'] = text_of(notes)
            if parts:
                parts['robot'] = text_of(robot)
                await send('{' + ','.join(f'"{key}":{text}' for key, text in parts.items()) + '}')

    def _wake(self) -> None:
        with contextlib.suppress(RuntimeError):  # the loop is closed: the server has ended
            self._loop.call_soon_threadsafe(self._news.set)
