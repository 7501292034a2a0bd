# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""When the messages of a stream came, and which of them this process was too late to see."""

import time

GAP_S = 0.2
"""Messages lost in a shorter gap of a topic are the network's; in a longer one, this process was
held up, and newer messages took their places."""

LONGEST_WAIT_S = 10.0
"""A message that seems to have waited longer came when the system clock was set."""

DISCOVERY_S = 10.0
"""After the start of this process, s: a publisher that is discovered so late may have been sending
before, to the driver that was here then."""

MAX_PUBLISHERS = 32
"""Of a topic, whose messages are counted; of more the latest."""


class Arrivals:
    """Tells a topic's silence from messages that this process was too late to see.

    Few messages wait, so who is held up for a second may not have seen a second of silence.
    A publisher numbers its messages; which of them sent one, ROS does not say. `started`: when
    this process began to listen, monotonic time, s.
    """

    def __init__(self, started: float) -> None:
        self._started = started
        self._newest: list[int] = []
        self._came = 0.0

    def missed(self, number: int | None, came: float) -> bool:
        """Return whether others came before a message and since the one before it.

        `number`: publication_sequence_number of the message; None where the middleware has none.
        `came`: monotonic time, s.
        """
        gap, self._came = came - self._came, came
        if number is None:
            return False
        before = max((each for each in self._newest if each < number), default=0)
        if before:
            self._newest.remove(before)
        self._newest = [*self._newest[-(MAX_PUBLISHERS - 1) :], number]
        if not before:  # new here: later, what it sent so far was not for us
            return number > 1 and came - self._started < DISCOVERY_S
        return number - before > 1 and gap > GAP_S


def came_at(received: int | None) -> float:
    """Return when a message came, monotonic time in s: it may have waited for its callback.

    `received`: when the middleware took it from the network, ns of the system clock; none or 0
    where it does not say.
    """
    waited = time.time() - received * 1e-9 if received else 0.0
    return time.monotonic() - (waited if 0.0 <= waited <= LONGEST_WAIT_S else 0.0)
