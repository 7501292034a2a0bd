# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Arrival times of a stream's messages, and detection of messages lost during a stall."""

import time

GAP_S = 0.2
"""Gap in a topic, s, above which lost messages are attributed to a stall of this process, in which
newer messages replaced them. Losses in a shorter gap are attributed to the network."""

LONGEST_WAIT_S = 10.0
"""Maximum plausible wait of a message, s. A longer one means that the system clock was set."""

DISCOVERY_S = 10.0
"""Time after the start of this process, s, within which a newly discovered publisher may have been
sending before, to an earlier instance of the driver."""

MAX_PUBLISHERS = 32
"""Maximum number of publishers tracked per topic. The latest ones are stored."""


class Arrivals:
    """Distinguishes silence on a topic from messages lost while this process was stalled.

    The queue is short, so a process that stalled for a second may not have seen a second of
    silence. Each publisher numbers its messages, but ROS does not identify the publisher of a
    message. `started`: when this process started to receive, monotonic time, s.
    """

    def __init__(self, started: float) -> None:
        self._started = started
        self._newest: list[int] = []
        self._came = 0.0

    def missed(self, number: int | None, came: float) -> bool:
        """Return whether messages were lost between the previous message and this one.

        `number`: publication_sequence_number of the message; None if the middleware has none.
        `came`: monotonic time, s.
        """
        gap, self._came = came - self._came, came
        if number is None:
            return False
        before = max((each for each in self._newest if each < number), default=0)
        if before:
            self._newest.remove(before)
        self._newest = [*self._newest[-(MAX_PUBLISHERS - 1) :], number]
        if not before:  # a new publisher: later on, its earlier messages were not for this process
            return number > 1 and came - self._started < DISCOVERY_S
        return number - before > 1 and gap > GAP_S


def came_at(received: int | None) -> float:
    """Return the arrival time of a message, monotonic, s. It may have waited for its callback.

    `received`: when the middleware received it, ns of the system clock; None or 0 if unknown.
    """
    waited = time.time() - received * 1e-9 if received else 0.0
    return time.monotonic() - (waited if 0.0 <= waited <= LONGEST_WAIT_S else 0.0)
