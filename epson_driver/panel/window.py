# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Sends the state of the selected robot to one browser window.

The state consists of named parts, such as joints or lamps. A part is sent when it has changed. On
a slow connection, a newer version replaces the queued one.
"""

import asyncio
import contextlib
import itertools
import json
import threading
from collections import deque
from collections.abc import Awaitable, Callable
from typing import Any

MAX_NOTES = 10  # maximum number of queued notes: the oldest are dropped
MAX_LATE_S = 0.15
"""Maximum delay of jog and step requests, s. A later request is dropped, because it could move the
arm after the button was released."""

HELD_S = 0.07
"""Time after the last jog request until the arm brakes, s. The page sends a request every 25 ms
while a button is pressed (hand.js)."""

MAX_MESSAGES_PER_S = 100.0  # mean rate of a window's messages: 44 per second during a jog
MAX_BURST_S = 10.0  # time for which a slow connection may delay messages, s
_numbers = itertools.count(1)


class BadMessageError(ValueError):
    """A window sent a message that the panel's page never sends."""


def text_of(value: object) -> str:
    return json.dumps(value, allow_nan=False, separators=(',', ':'))


class Window:
    """The page in one browser window. `offer` and `say` may be called in any thread."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self.number = next(_numbers)
        self.robot = ''  # the name of the selected robot, or '' before the selection
        self._loop = loop
        self._lock = threading.Lock()
        self._waiting: dict[str, str] = {}
        self._sent: dict[str, str] = {}
        self._notes: deque[str] = deque(maxlen=MAX_NOTES)
        self._news = asyncio.Event()
        self._paid_until = 0.0
        self._smallest_offset: float | None = None
        """Smallest difference between the arrival time and the sending time of a message, s.

        The arrival is on the panel's clock, and the sending is on the window's clock.
        """
        self._silence: asyncio.TimerHandle | None = None

    def choose(self, robot: str) -> None:
        """Select a robot. All of its parts are sent again."""
        with self._lock:
            self.robot = robot
            self._waiting.clear()
            self._sent.clear()

    def offer(self, robot: str, parts: dict[str, str]) -> None:
        """Queue the changed parts of a robot's displayed state, if this robot is selected.

        `parts`: name of each part → JSON.
        """
        with self._lock:
            if robot != self.robot:
                return
            news = {key: text for key, text in parts.items() if self._sent.get(key) != text}
            self._waiting |= news
            self._sent |= news
        if news:
            self._wake()

    def say(self, text: str) -> None:
        with self._lock:
            self._notes.append(text)
        self._wake()

    def count(self, now: float) -> None:
        """Count a frame received at `now`, s. Raises BadMessageError if the rate is too high."""
        self._paid_until = max(self._paid_until, now) + 1.0 / MAX_MESSAGES_PER_S
        if self._paid_until > now + MAX_BURST_S:
            raise BadMessageError(f'more than {MAX_MESSAGES_PER_S:g} messages per second')

    def late(self, sent: float, now: float) -> bool:
        """Return whether a message was delayed by more than MAX_LATE_S.

        The delay is relative to the fastest message. `sent` is on the window's clock, and `now` on
        the panel's clock, s.
        """
        offset = now - sent
        if self._smallest_offset is None or offset < self._smallest_offset:
            self._smallest_offset = offset
        return offset - self._smallest_offset > MAX_LATE_S

    def after_silence(self, do: Callable[[], object]) -> None:
        """Call `do` after HELD_S in the event loop, unless this method is called again before."""
        if self._silence is not None:
            self._silence.cancel()
        self._silence = self._loop.call_later(HELD_S, do)

    async def write(self, send: Callable[[str], Awaitable[Any]]) -> None:
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
