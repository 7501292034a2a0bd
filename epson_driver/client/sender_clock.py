# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""When the controller sent what came: its own clock, seen through a network that delays.

A controller sends its state by its own clock, a message a slot. The network, the kernel and this
process only ever add to the time of arrival, and TCP neither loses nor reorders. So the slots are
counted, and the clock lies on the lower envelope of the arrivals: the messages that were delayed
least. How far a message lies above it is how long it was on its way beyond the shortest way.

What can be known by that: times between messages, to about a period in the two seconds that are
looked at (0.25 % at 200 Hz); the age of a message, but for the network's least delay, which
nothing shows. Until half a second of messages has come, the period is the one that was given.
"""

from collections import deque

BLOCK_TIME = 0.25
BLOCK_MESSAGES = 8
BLOCKS = 8
"""The envelope is made of the least delayed message of each block; the newest blocks are kept."""

LATE_SLOTS = 3
"""A message that comes later than this, in slots, was held up, or the sender paused."""

FORGET_PERIOD_AFTER = 8
"""So many pauses one after the other are no pauses: the period is another one."""

NEVER_AT_ONCE = 1e-6
"""Between two messages, s: stamps of ROS must differ."""

Point = tuple[float, float, float]
"""Of the envelope: slots counted, arrival, arrival less the sender's time."""


class SenderClock:
    """The clock of one stream of messages. `step` for each message, in order. Times in s.

    `time` is the sender's time of the newest message, on an axis of its own; `measured` the same
    on the receiver's clock, never later than the arrival.

    A message that comes much too late was held up on its way, or the sender paused before it:
    the next ones tell. Those that were held up with it come at once; after a pause they come one
    period after the other. Until that is known, `gap` is the sender's time of the late message,
    as if there had been no pause.
    """

    def __init__(self, period: float) -> None:
        self.period = period
        self.time = 0.0
        self.measured = 0.0
        self.gap: float | None = None
        self._arrival: float | None = None
        self._slots = 0.0
        self._offset = 0.0
        self._late = 0.0
        self._envelope: deque[Point] = deque(maxlen=BLOCKS)
        self._least: Point = (0.0, 0.0, 0.0)
        self._block_began = 0.0
        self._block_size = 0
        self._pauses = 0
        self._paused_since = (0.0, 0.0)

    def step(self, arrival: float, told: float | None = None) -> float:
        """Take the next message. `told`: time since the one before, if the sender said that.

        Returns by how much the messages since `gap` were sent later than they seemed to be:
        0, unless it has become clear that the sender paused.
        """
        if self._arrival is None:
            self._arrival = self.measured = self._offset = arrival
            self._begin_block(arrival)
            return 0.0
        spacing = arrival - self._arrival
        passed = self.period if told is None else told
        self._arrival = arrival
        self._slots += passed / self.period
        self.time += passed
        much_too_late = told is None and spacing > passed + LATE_SLOTS * self.period
        late = arrival - self._offset - self.time
        shift = 0.0
        if self.gap is not None:
            if late <= LATE_SLOTS * self.period:  # all that was held up has come
                self.gap = None
            elif spacing > passed / 2:  # it does not hurry: the sender paused
                shift = self._late
                late = self._pause(shift, arrival)
        if much_too_late and late > LATE_SLOTS * self.period:
            self.gap = self.time
            self._count_pauses(arrival)
        elif self.gap is None and not shift:
            self._pauses = 0
        self._late = late
        if late < 0.0:
            self._offset += late
        self._take(arrival)
        self.measured = min(arrival, max(self.measured + NEVER_AT_ONCE, self._offset + self.time))
        return shift

    def _pause(self, length: float, arrival: float) -> float:
        """The sender paused before `gap`. Returns how late the message is beyond that."""
        self.time += length
        self.gap = None
        self._envelope.clear()
        self._begin_block(arrival)
        return arrival - self._offset - self.time

    def _count_pauses(self, arrival: float) -> None:
        """Take another period if there is nothing but pauses."""
        if not self._pauses:
            self._paused_since = (self._slots, arrival)
        elif self._pauses == FORGET_PERIOD_AFTER:
            slots, since = self._paused_since
            self.period *= (arrival - since) / ((self._slots - slots) * self.period)
            self._slots = 0.0
            self._pauses = -1
            self._envelope.clear()
            self._begin_block(arrival)
        self._pauses += 1

    def _begin_block(self, arrival: float) -> None:
        self._least = (self._slots, arrival, arrival - self.time)
        self._block_began = arrival
        self._block_size = 0

    def _take(self, arrival: float) -> None:
        """Let the message count for the envelope."""
        self._block_size += 1
        lies = arrival - self.time
        if lies <= self._least[2]:
            self._least = (self._slots, arrival, lies)
        if self._block_size >= BLOCK_MESSAGES and arrival - self._block_began >= BLOCK_TIME:
            self._envelope.append(self._least)
            self._follow()
            self._begin_block(arrival)

    def _follow(self) -> None:
        """Follow the envelope: its slope is the period, its height the offset.

        A point of it is at most a slot above the true one, so the period is kept while that
        allows, and otherwise changed by as little as the arrivals prove.
        """
        slots, arrival, _ = self._envelope[0]
        last_slots, last_arrival, _ = self._envelope[-1]
        count, length = last_slots - slots, last_arrival - arrival
        if count >= BLOCK_MESSAGES and length > 0.0:
            slack = min(self.period, length / count)
            lowest, highest = (length - slack) / count, (length + slack) / count
            self.period = min(max(self.period, lowest), highest)
        at = self._slots * self.period - self.time
        self._offset = at + min(
            arrival - slots * self.period for slots, arrival, _ in self._envelope
        )
