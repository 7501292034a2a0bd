# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Arming: permission for one browser at a time to move the robot.

Everything that the armed browser has started ends when the arming ends. An arming ends when the
browser disarms, when its connection is lost or its page is unresponsive (its user could not press
stop), and when the data shown by the panel is out of date.
"""

import contextlib
import math
import threading
from collections.abc import Callable, Iterator

from epson_driver.panel.robot_state import RequestError

ALIVE_WITHIN_S = 1.5
"""Time without a sign of life after which a page counts as frozen, hidden, asleep or cut off, s. A
visible page sends one every 0.3 s (panel.js). The websocket's pings do not prove that the page
runs, because the browser answers them even for a hung page."""


class NotArmedError(RequestError):
    """The browser may not move the robot, with the reason and the remedy as text."""


class Arming:
    """The armed browser, by the number of its connection, or None. Thread-safe.

    `forbidden` returns why arming is not allowed now, or None. `on_end` is called with the reason
    whenever an arming ends, before another browser can be armed. `clock`: monotonic, s.
    """

    def __init__(
        self,
        forbidden: Callable[[], str | None],
        on_end: Callable[[str], object],
        clock: Callable[[], float],
    ) -> None:
        self._forbidden = forbidden
        self._on_end = on_end
        self._clock = clock
        self._alive: dict[int, float] = {}
        self._lock = threading.RLock()
        self._holder: int | None = None
        self._connected: set[int] = set()

    @property
    def holder(self) -> int | None:
        """The armed browser, or None."""
        return self._holder

    def connect(self, browser: int) -> None:
        """Register a browser, which may then request arming."""
        with self._lock:
            self._connected.add(browser)

    def alive(self, browser: int) -> None:
        """Record a sign of life from the page of a browser."""
        with self._lock:
            if browser in self._connected:
                self._alive[browser] = self._clock()

    def disconnect(self, browser: int) -> None:
        """Remove a browser. Its later clicks have no effect."""
        with self._lock:
            self._connected.discard(browser)
            self._alive.pop(browser, None)
            self.disarm('the armed window of the panel was closed', browser)

    def arm(self, browser: int) -> None:
        """Arm a browser. Raises NotArmedError if it cannot be armed, with the reason."""
        with self._lock:
            if browser not in self._connected:
                raise NotArmedError('this window is disconnected')
            why = self._forbidden()
            if why is not None:
                raise NotArmedError(why)
            if self._holder not in (None, browser):
                raise NotArmedError(
                    'another window of the panel is armed: disarm it there, or close it'
                )
            if not self._is_alive(browser):
                raise NotArmedError('this window does not respond: reload the page')
            self._holder = browser

    def disarm(self, why: str, browser: int | None = None) -> bool:
        """End the arming of one browser, or of any. Returns whether a browser was armed."""
        with self._lock:
            if self._holder is None or browser not in (None, self._holder):
                return False
            self._holder = None
            self._on_end(why)
            return True

    def watch(self) -> None:
        """End the arming if it is not allowed any more, or if the armed window is not visible."""
        with self._lock:
            if self._holder is None:
                return
            why = self._forbidden()
            if why is None and not self._is_alive(self._holder):
                why = 'the armed window is frozen, hidden or disconnected'
            if why is not None:
                self.disarm(why)

    def _is_alive(self, browser: int) -> bool:
        return self._clock() - self._alive.get(browser, -math.inf) <= ALIVE_WITHIN_S

    @contextlib.contextmanager
    def held(self, browser: int) -> Iterator[None]:
        """Keep the arming from ending while the block runs, which only the armed browser may do.

        Raises NotArmedError. The block must not wait for anything.
        """
        with self._lock:
            if self._holder != browser:
                raise NotArmedError('not armed: press Arm first')
            why = self._forbidden()
            if why is not None:
                self.disarm(why)
                raise NotArmedError(why)
            yield
