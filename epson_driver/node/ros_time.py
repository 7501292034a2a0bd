# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Converts times of the event loop's clock, including past ones, to ROS times."""

from collections.abc import Callable

from builtin_interfaces.msg import Time as TimeMessage
from rclpy.clock import Clock

MAX_READING_NS = 100_000
"""Maximum time for reading both clocks, ns. A longer reading was interrupted."""

MIN_JUMP_NS = 1_000_000
"""Difference beyond which ROS's clock was set or stopped, ns. A smaller one is drift."""

DRIFT_FILTER_DIVISOR = 256
"""Divisor of the drift correction per reading. It filters the time that the reading takes."""

MIN_SPACING_NS = 1_000
"""Minimum spacing of stamps, ns. tf ignores a repeated stamp."""

NS_PER_S = 1_000_000_000

MIN_STEP_BACK_NS = 100_000_000
"""Step back of ROS's clock beyond which stamps also step back, ns."""


class RosTimeStamps:
    """Creates increasing stamps from times of `monotonic`, s. `clock`: an rclpy clock."""

    def __init__(self, clock: Clock, monotonic: Callable[[], float]) -> None:
        self._clock = clock
        self._monotonic = monotonic
        self._ahead: int | None = None
        self._last = 0
        self._message = TimeMessage()

    def stamp(self, moment: float) -> TimeMessage:
        """Return a time as builtin_interfaces/Time, valid until the next call."""
        before = self._monotonic()
        ros = self._clock.now().nanoseconds
        after = self._monotonic()
        ahead = ros - _nanoseconds(before)
        if self._ahead is None:
            self._ahead = ahead
        elif after - before < MAX_READING_NS * 1e-9:
            drift = ahead - self._ahead
            self._ahead += drift if abs(drift) > MIN_JUMP_NS else drift // DRIFT_FILTER_DIVISOR
        stamp = max(_nanoseconds(moment) + self._ahead, 0)
        if stamp < self._last + MIN_SPACING_NS and stamp > self._last - MIN_STEP_BACK_NS:
            stamp = self._last + MIN_SPACING_NS
        self._last = stamp
        self._message.sec, self._message.nanosec = divmod(stamp, NS_PER_S)
        return self._message


def _nanoseconds(seconds: float) -> int:
    return round(seconds * 1e9)
