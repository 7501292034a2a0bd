# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The ranges that one I/O client subscribed to, and their publication."""

import math
from collections.abc import Callable

from epson_driver.sim_controller.clock import Clock, Timer
from epson_driver.sim_controller.io.io_points import IoError, IoPoints
from epson_driver.simple_message import IoAddress, IoPublish, IoResult, IoSpan, IoValues

MAX_CATCH_UP_PUBLICATIONS = 3
"""Maximum missed publications to catch up on after a scheduling delay, besides the newest."""

MAX_RANGES = 64
MAX_VALUES = 4096
"""Limits of one client's subscriptions: ranges, and the total number of values."""

TIMESTAMP_MASK = 2**31 - 1


def timestamp(clock: Clock) -> int:
    """Return the controller's time in ms, modulo 24.8 days."""
    return int(clock.now * 1000.0) & TIMESTAMP_MASK


class IoStream:
    """Calls `publish` every `publish_period`, and soon after a change.

    A change is published when the clock next advances, together with all other changes of that
    moment, but at the earliest `publish_interval` after the previous publication. Publication
    stops while `paused()`.
    """

    def __init__(
        self,
        points: IoPoints,
        clock: Clock,
        publish: Callable[[IoPublish], None],
        paused: Callable[[], bool],
    ) -> None:
        self._points = points
        self._clock = clock
        self._publish = publish
        self._paused = paused
        self._ranges: dict[tuple[int, int], int] = {}
        self._sent: tuple[IoValues, ...] = ()
        self._sent_at = -math.inf
        self._timer: Timer | None = None
        self._change: Timer | None = None
        self._stop_listening = points.listen(self._changed)

    def subscribe(self, span: IoSpan) -> None:
        """Add a range, or replace the range with the same start. Raises IoError."""
        self._points.check_range(span.io_type, span.start, span.count)
        key = (span.io_type, span.start)
        ranges = {**self._ranges, key: span.count}
        values = sum(ranges.values())
        if len(ranges) > MAX_RANGES or values > MAX_VALUES:
            raise IoError(
                IoResult.TOO_MUCH,
                f'{len(ranges)} ranges with {values} values: at most {MAX_RANGES} with '
                f'{MAX_VALUES} in all',
            )
        self._ranges = ranges
        self._sent = ()
        self._changed()
        if self._timer is None:
            self._wait()

    def unsubscribe(self, address: IoAddress) -> None:
        """Drop the range with this start. Raises IoError without one."""
        key = (address.io_type, address.index)
        if key not in self._ranges:
            self._points.check_range(*key, 1)
            text = f'type {key[0]}, start {key[1]}: no subscription begins there'
            raise IoError(IoResult.NO_SUBSCRIPTION, text)
        del self._ranges[key]
        if not self._ranges:
            self._cancel()

    def close(self) -> None:
        """Stop publishing."""
        self._stop_listening()
        self._ranges = {}
        self._cancel()

    def _cancel(self) -> None:
        for timer in (self._timer, self._change):
            if timer is not None:
                timer.cancel()
        self._timer = self._change = None

    def _wait(self) -> None:
        period = self._points.profile.publish_period
        self._timer = self._clock.every(
            period, self._due, first=period, catch_up=MAX_CATCH_UP_PUBLICATIONS
        )

    def _due(self) -> None:
        self._send(self._values())

    def _changed(self) -> None:
        if not self._ranges or self._change is not None:
            return
        earliest = self._sent_at + self._points.profile.publish_interval
        delay = max(earliest - self._clock.now, 0.0)
        self._change = self._clock.after(delay, self._send_change)

    def _send_change(self) -> None:
        self._change = None
        values = self._values()
        if values != self._sent:
            self._send(values)

    def _values(self) -> tuple[IoValues, ...]:
        return tuple(
            IoValues(io_type, start, self._points.read_range(io_type, start, count))
            for (io_type, start), count in self._ranges.items()
        )

    def _send(self, values: tuple[IoValues, ...]) -> None:
        if self._paused():
            return
        self._sent = values
        self._sent_at = self._clock.now
        self._publish(IoPublish(timestamp(self._clock), values))
