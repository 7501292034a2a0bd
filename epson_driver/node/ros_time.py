# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""ROS times of moments of the event loop's clock, also of past ones."""

from collections.abc import Callable

from builtin_interfaces.msg import Time as TimeMessage
from rclpy.clock import Clock

MAX_READING_NS = 100_000
"""Both clocks were read at once if it took less than this, ns; else it was interrupted."""

MIN_JUMP_NS = 1_000_000
"""ROS's clock was set, or stopped, if it is off by more than this, ns; else it only drifts."""

DRIFT_FILTER_DIVISOR = 256
"""Of a drift, one part in so many is followed at a time: reading clocks takes its time, too."""

MIN_SPACING_NS = 1_000
"""Between two stamps, ns: tf ignores what has the same one again."""

NS_PER_S = 1_000_000_000

MIN_STEP_BACK_NS = 100_000_000
"""If ROS's clock is set back by more than this, ns, stamps go back as well."""


class RosTimeStamps:
    """Makes stamps that increase, from times of `monotonic`, s. `clock`: an rclpy clock."""

    def __init__(self, clock: Clock, monotonic: Callable[[], float]) -> None:
        self._clock = clock
        self._monotonic = monotonic
        self._ahead: int | None = None
        self._last = 0
        self._message = TimeMessage()

    def stamp(self, moment: float) -> TimeMessage:
        """Return the builtin_interfaces/Time of that moment, valid until the next call."""
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
