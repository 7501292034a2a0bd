# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The controller's clock, as seen through a network that delays its messages.

A controller sends its state by its own clock, a message a slot. The network, the kernel and this
process only ever add to the time of arrival, and TCP neither loses nor reorders. So the slots are
counted, and the clock lies on the lower envelope of the arrivals: the messages that were delayed
least. How far a message lies above it is how long it was on its way beyond the shortest way.

What can be known by that: the time between messages, to about a period in the two seconds that
are looked at (0.25 % at 200 Hz), and the age of a message to two periods, but for the network's
least delay, which nothing shows. In the first second the period is the one that was given, as far
as the arrivals allow it.
"""

from collections import deque

BLOCK_TIME_S = 0.25
FIRST_BLOCK_TIME_S = 0.05
MIN_BLOCK_MESSAGES = 8
MAX_BLOCKS = 8
"""The envelope is made of the least delayed message of each block, s and messages at least; the
newest blocks are kept. The first ones are shorter: the given period may be far off."""

MIN_LINE_POINTS = 3
"""How many points of the envelope show whether they lie on one line."""

MIN_ENVELOPE_S = 0.75
"""An envelope of that length, s, says what the period is; a shorter one, what it cannot be."""

SAME_PERIOD_FRACTION = 0.05
PERIOD_FILTER_DIVISOR = 4
MIN_DOUBTS = 8
"""A controller has one period. One that was seen and is this part of itself off is followed by one
part in so many at a time; another one must be seen so many times in a row, which is 2 s: a program
that is held up shows many."""

LATE_SLOTS = 3
"""A message that comes later than this, in slots, was held up, or the sender paused."""

DECISION_SLOTS = 4
"""So many slots after a late message it is seen whether the next ones hurry."""

MAX_PAUSES = 4
"""So many pauses between which there was no time for a line are none: the period is wrong."""

MIN_SPACING_S = 1e-6
"""Least time between two messages, s: stamps of ROS must differ."""

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
        self._gap_came = 0.0
        self._arrival: float | None = None
        self._slots = 0.0
        self._offset = 0.0
        self._least_late = 0.0
        self._envelope: deque[Point] = deque(maxlen=MAX_BLOCKS)
        self._least: Point = (0.0, 0.0, 0.0)
        self._block_began = 0.0
        self._block_size = 0
        self._settled = self._proven = False
        self._doubts = 0
        self._pauses = 0
        self._first_pause = (0.0, 0.0)

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
        self._arrival = arrival
        passed = self.period if told is None else told
        self._slots += passed / self.period
        self.time += passed
        tolerance = LATE_SLOTS * self.period
        much_too_late = told is None and spacing > passed + tolerance
        shift = 0.0
        if self.gap is not None:
            shift = self._after_gap(arrival, tolerance, much_too_late)
        late = arrival - self._offset - self.time
        if much_too_late and late > tolerance and self.gap is None:
            self.gap, self._gap_came, self._least_late = self.time, arrival, late
            self._count_pause(arrival)
        if late < 0.0:
            self._offset += late
        self._take(arrival)
        self.measured = min(arrival, max(self.measured + MIN_SPACING_S, self._offset + self.time))
        return shift

    def _after_gap(self, arrival: float, tolerance: float, again: bool) -> float:
        """Judge a late message, and return how long the sender paused before it.

        `again`: this one is as late, too: then it was not held up with the other.
        """
        late = arrival - self._offset - self.time
        since = self.time - (self.gap or 0.0)
        others = since > 1.5 * self.period
        if late <= tolerance or (again and others):
            # All that was held up has come. If it is still late the period is wrong, or the
            # sender paused, too: that shows in the envelope.
            self.gap = None
            return 0.0
        if again or (
            since >= (DECISION_SLOTS - 0.5) * self.period and arrival - self._gap_came > since / 2
        ):
            paused = self._least_late
            self.time += paused
            self.gap = None
            self._envelope.clear()
            self._begin_block(arrival)
            return paused
        self._least_late = min(self._least_late, late)
        return 0.0

    def _count_pause(self, arrival: float) -> None:
        """Count a pause, and take another period after too many in a row."""
        if self._proven or len(self._envelope) >= MIN_LINE_POINTS:
            self._pauses = 0
        if not self._pauses:
            self._first_pause = self._slots, arrival
        self._pauses += 1
        if self._pauses > MAX_PAUSES:
            slots, since = self._first_pause
            self.period = (arrival - since) / (self._slots - slots)
            self._pauses = 0

    def _begin_block(self, arrival: float) -> None:
        self._least = (self._slots, arrival, arrival - self.time)
        self._block_began = arrival
        self._block_size = 0

    def _take(self, arrival: float) -> None:
        """Add the message to the envelope."""
        self._block_size += 1
        lies = arrival - self.time
        if lies <= self._least[2]:
            self._least = (self._slots, arrival, lies)
        enough = BLOCK_TIME_S if self._settled else FIRST_BLOCK_TIME_S
        if self._block_size >= MIN_BLOCK_MESSAGES and arrival - self._block_began >= enough:
            self._envelope.append(self._least)
            self._follow()
            self._begin_block(arrival)

    def _follow(self) -> None:
        """Follow the envelope: its slope is the period, its height the offset."""
        envelope = self._envelope
        size = len(envelope)
        length = envelope[-1][1] - envelope[0][1]
        self._settled = length >= BLOCK_TIME_S
        slots = sum(point[0] for point in envelope) / size
        arrival = sum(point[1] for point in envelope) / size
        spread = sum((point[0] - slots) ** 2 for point in envelope)
        if size >= MIN_LINE_POINTS:
            slope = sum((p[0] - slots) * (p[1] - arrival) for p in envelope) / spread
            off = max(abs(p[1] - arrival - slope * (p[0] - slots)) for p in envelope)
            if slope <= 0.0 or off > 2.0 * slope:  # not one line: the way became another one
                newest = envelope[-1]
                envelope.clear()
                envelope.append(newest)
            elif length >= MIN_ENVELOPE_S:
                self._set_period(slope)
            elif not self._proven:
                slack = slope / (envelope[-1][0] - envelope[0][0])
                self.period = min(max(self.period, slope - slack), slope + slack)
        now = self._slots * self.period - self.time
        self._offset = now + min(point[1] - point[0] * self.period for point in envelope)

    def _set_period(self, period: float) -> None:
        """Follow the period that a whole envelope shows."""
        change = period - self.period
        if not self._proven:
            self.period = period
        elif abs(change) <= SAME_PERIOD_FRACTION * self.period:
            self.period += change / PERIOD_FILTER_DIVISOR
        else:
            self._doubts += 1
            if self._doubts < MIN_DOUBTS:
                return
            self.period = period
        self._proven = True
        self._doubts = 0


class QuestionClock:
    """In the place of a SenderClock where every message answers a question.

    Nothing waits anywhere for long, and nothing comes by itself: a message was measured when it
    came, but for the way of question and answer. `period`: s, the usual one, or the last if that
    was longer.
    """

    gap: float | None = None

    def __init__(self, period: float) -> None:
        self.period = period
        self.time = 0.0
        self.measured = 0.0
        self._usual = period

    def step(self, arrival: float, _told: float | None = None) -> float:
        """Take the next message. Returns 0: no earlier one was sent later than it seemed."""
        spacing = arrival - self.measured
        if self.measured and spacing > self._usual / 2.0:  # not two answers to one question
            self.period = max(self._usual, spacing)
        self.time = self.measured = arrival
        return 0.0
