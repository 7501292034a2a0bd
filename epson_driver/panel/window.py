# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""One window of the panel: what it shows is a set of named parts, of which only news are sent.

However slow its line is, no more waits for it than the newest of each part.
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
"""Sentences that wait for a window; of more the latest."""

MAX_LATE_S = 0.15
"""What asks for motion by itself, as jogging does, counts for so long, s: a message that a line
has held up for longer would move the arm after the finger has left."""

HELD_S = 0.07
"""So long after the last request of a held button the arm brakes, s: the page asks each 25 ms
(hand.js). Without this it would after the driver's `servo.timeout`."""

MAX_MESSAGES_PER_S = 100.0
"""The page sends 44 during a jog."""

MAX_BURST_S = 10.0
"""A slow line may deliver the messages of this time, s, together."""

_numbers = itertools.count(1)


class BadMessageError(ValueError):
    """A window has sent what the page never sends."""


def text_of(value: object) -> str:
    """Return what is sent for a part."""
    return json.dumps(value, allow_nan=False, separators=(',', ':'))


class Window:
    """A page in a browser. `loop`: that of the web server.

    `offer` and `say` may be called in any thread.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self.number = next(_numbers)
        self.robot = ''
        """The name of the robot that it has chosen, '' before."""
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
        """Show another robot from now on: all of it is sent."""
        with self._lock:
            self.robot = robot
            self._waiting.clear()
            self._sent.clear()

    def offer(self, robot: str, parts: dict[str, str]) -> None:
        """Send parts of the page, as `text_of` has them, that are news to a window of a robot."""
        with self._lock:
            if robot != self.robot:
                return
            news = {key: text for key, text in parts.items() if self._sent.get(key) != text}
            self._waiting |= news
            self._sent |= news
        if news:
            self._wake()

    def say(self, text: str) -> None:
        """Tell the person something, once."""
        with self._lock:
            self._notes.append(text)
        self._wake()

    def count(self, now: float) -> None:
        """Count a frame. Raises BadMessageError for more than a page sends. now: s."""
        self._paid_until = max(self._paid_until, now) + 1.0 / MAX_MESSAGES_PER_S
        if self._paid_until > now + MAX_BURST_S:
            raise BadMessageError(f'more than {MAX_MESSAGES_PER_S:g} messages per second')

    def late(self, sent: float, now: float) -> bool:
        """Return whether a message took MAX_LATE_S longer than the quickest one.

        sent: by the clock of the window, s; now: by that of the panel.
        """
        taken = now - sent
        if self._quickest is None or taken < self._quickest:
            self._quickest = taken
        return taken - self._quickest > MAX_LATE_S

    def after_silence(self, do: Callable[[], object]) -> None:
        """Have something done once this was not called for HELD_S. In the loop's thread."""
        if self._silence is not None:
            self._silence.cancel()
        self._silence = self._loop.call_later(HELD_S, do)

    async def write(self, send: Callable[[str], Awaitable[Any]]) -> None:
        """Send what there is, again and again, until the task is canceled."""
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
