# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Who may move the robot from the panel: one browser at a time, from when it arms until it ends.

Whatever the armed browser has started ends with its arming: when it disarms, when its connection
is gone or its page does nothing any more (nobody there could press stop), and when what the panel
shows is no longer true.
"""

import contextlib
import math
import threading
from collections.abc import Callable, Iterator

from epson_driver.panel.robot_state import RequestError

ALIVE_WITHIN_S = 1.5
"""A page that has given no sign of life for so long is frozen, hidden, asleep or cut off, s. It
gives one each 0.3 s while somebody can see it (panel.js). The websocket's own pings tell nothing:
the browser answers them for a page that hangs."""


class NotArmedError(RequestError):
    """The browser may not move the robot, with the reason and the remedy as text."""


class Arming:
    """Which browser is armed, by the number of its connection, or None. For any thread.

    `forbidden` returns why nobody may be armed now, or None. `on_end` is called with the reason
    whenever an arming ends, before anybody else can be armed. `clock`: monotonic, s.
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
        """The browser that is armed."""
        return self._holder

    def connect(self, browser: int) -> None:
        """Let a browser be armed, once it asks for it."""
        with self._lock:
            self._connected.add(browser)

    def alive(self, browser: int) -> None:
        """Take note that the page of a browser has given a sign of life."""
        with self._lock:
            if browser in self._connected:
                self._alive[browser] = self._clock()

    def disconnect(self, browser: int) -> None:
        """Take note that a browser is gone: clicks of it that come later do nothing."""
        with self._lock:
            self._connected.discard(browser)
            self._alive.pop(browser, None)
            self.disarm('the armed window of the panel is gone', browser)

    def arm(self, browser: int) -> None:
        """Arm a browser. Raises NotArmedError that says why it cannot be."""
        with self._lock:
            if browser not in self._connected:
                raise NotArmedError('this window is not connected any more')
            why = self._forbidden()
            if why is not None:
                raise NotArmedError(why)
            if self._holder not in (None, browser):
                raise NotArmedError(
                    'another window of the panel is armed: disarm it there, or close it'
                )
            if not self._is_alive(browser):
                raise NotArmedError('this window gives no sign of life: reload the page')
            self._holder = browser

    def disarm(self, why: str, browser: int | None = None) -> bool:
        """End the arming, of one browser or of whoever has it. Returns whether there was one."""
        with self._lock:
            if self._holder is None or browser not in (None, self._holder):
                return False
            self._holder = None
            self._on_end(why)
            return True

    def watch(self) -> None:
        """End the arming if nobody may be armed any more, or nobody sees the armed window."""
        with self._lock:
            if self._holder is None:
                return
            why = self._forbidden()
            if why is None and not self._is_alive(self._holder):
                why = 'the armed window is frozen, hidden or cut off'
            if why is not None:
                self.disarm(why)

    def _is_alive(self, browser: int) -> bool:
        return self._clock() - self._alive.get(browser, -math.inf) <= ALIVE_WITHIN_S

    @contextlib.contextmanager
    def held(self, browser: int) -> Iterator[None]:
        """Do something that only the armed browser may do: the arming does not end meanwhile.

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
