# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Arming: the permission for one browser at a time to move a robot.

Arming ends when the user disarms, or when the displayed data is stale. Arming also ends when the
page is closed, disconnected or unresponsive, because its user could then not press STOP. The
motion that the browser has started ends together with the arming.
"""

import contextlib
import math
import threading
from collections.abc import Callable, Iterator

from epson_driver.panel.robot_state import RequestError

ALIVE_WITHIN_S = 1.5
"""Maximum time between two signs of life of a responsive page, s. A visible page sends a sign of
life every 0.3 s (panel.js). Pings are no sign of life, because a browser answers them even for a
page that hangs."""


class NotArmedError(RequestError):
    """The browser may not move the robot. The text is the reason and the remedy."""


class Arming:
    """The arming of one robot, thread-safe. A browser is identified by its window number.

    * forbidden: returns why arming is not allowed now, or None.
    * on_end: called with the reason when arming ends, before another browser can be armed.
    * clock: returns the monotonic time, s.
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
        return self._holder

    def connect(self, browser: int) -> None:
        with self._lock:
            self._connected.add(browser)

    def alive(self, browser: int) -> None:
        with self._lock:
            if browser in self._connected:
                self._alive[browser] = self._clock()

    def disconnect(self, browser: int) -> None:
        with self._lock:
            self._connected.discard(browser)
            self._alive.pop(browser, None)
            self.disarm('the armed window of the panel was closed', browser)

    def arm(self, browser: int) -> None:
        """Permit a browser to move the robot. Raises NotArmedError if this is not possible."""
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
        """Withdraw the permission from `browser`, or from any browser (None).

        Return whether a permission was withdrawn.
        """
        with self._lock:
            if self._holder is None or browser not in (None, self._holder):
                return False
            self._holder = None
            self._on_end(why)
            return True

    def watch(self) -> None:
        """Disarm if arming is not allowed any more, or if the armed page is unresponsive."""
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
        """Run the block if the browser is armed. Other threads cannot disarm it during the block.

        The block must not wait for anything. Raises NotArmedError if the browser is not armed.
        """
        with self._lock:
            if self._holder != browser:
                raise NotArmedError('not armed: press Arm first')
            why = self._forbidden()
            if why is not None:
                self.disarm(why)
                raise NotArmedError(why)
            yield
