# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Estimates when the controller sent each state message, despite network delays.

The controller sends one message in each period of its clock (a slot). Messages arrive late by a
varying network, kernel and scheduling delay. TCP neither loses nor reorders them, so slots can be
counted. The delay is never negative, so the lower envelope of the arrivals, through the least
delayed messages, is the sender's clock plus the minimum delay. The distance of a message from the
envelope is its delay beyond the minimum. The envelope is fitted instead of the average, because
one burst would shift an average by its whole length.

The minimum delay itself cannot be observed. Apart from it, the age of a message is accurate to two
periods. The estimated period is accurate to about 0.25 % at 200 Hz, one period in the 2 s that are
evaluated. In the first second the configured period is used, unless the arrivals contradict it.
"""

from collections import deque

BLOCK_TIME_S = 0.25
FIRST_BLOCK_TIME_S = 0.05
MIN_BLOCK_MESSAGES = 8
MAX_BLOCKS = 8
"""Maximum number of blocks of messages in an envelope, which contains the least delayed message of
each block. A block has at least MIN_BLOCK_MESSAGES messages in at least BLOCK_TIME_S. The first
blocks take at least FIRST_BLOCK_TIME_S, because the configured period may be far off."""

MIN_LINE_POINTS = 3  # minimum number of envelope points to which a line is fitted
MIN_ENVELOPE_S = 0.75  # minimum envelope for a period, s. A shorter one only gives bounds

SAME_PERIOD_FRACTION = 0.05
PERIOD_FILTER_DIVISOR = 4
MIN_DOUBTS = 8
"""Number of successive estimates that must differ from a confirmed period before the period is
replaced. This takes 2 s, because a stalled program causes many wrong estimates. An estimate that
differs by at most SAME_PERIOD_FRACTION only corrects the period, by 1/PERIOD_FILTER_DIVISOR of the
difference."""

LATE_SLOTS = 3  # delay above which a message counts as late, in slots (message periods)
DECISION_SLOTS = 4  # slots from a late message to the next evaluated spacing

MAX_PAUSES = 4
"""Maximum number of pauses before the envelope has MIN_LINE_POINTS points. After more pauses, the
assumed period is wrong, and a new period is estimated."""

MIN_SPACING_S = 1e-6  # minimum time between two messages, s, because ROS time stamps must differ

Point = tuple[float, float, float]
"""Envelope point: counted slots, arrival, and arrival minus the sender's time."""


class SenderClock:
    """Clock of the sender of one message stream. Times are in s.

    Call `step` for each message, in order. `time` is the time at which the newest message was
    sent, on the sender's clock, whose origin is arbitrary. `measured` is the same time on the
    receiver's clock. It is never later than the arrival.

    A late message was either delayed on the network, or sent late because the sender paused. The
    following messages show which of the two happened: after a network delay they arrive in a
    burst, and after a pause they arrive one period apart. Until this is known, `gap` is the time
    on the sender's clock at which the late message was sent, assuming no pause.
    """

    def __init__(self, period: float) -> None:
        self.period = period
        self.time = 0.0
        self.measured = 0.0
        self.gap: float | None = None
        self._gap_arrival = 0.0
        self._arrival: float | None = None
        self._slots = 0.0
        self._offset = 0.0
        self._least_late = 0.0
        self._envelope: deque[Point] = deque(maxlen=MAX_BLOCKS)
        self._least: Point = (0.0, 0.0, 0.0)
        self._block_start = 0.0
        self._block_size = 0
        self._warmed_up = self._proven = False
        self._doubts = 0
        self._pauses = 0
        self._first_pause = (0.0, 0.0)

    def step(self, arrival: float, reported: float | None = None) -> float:
        """Process a message. Return the duration of a pause that it reveals, s, or 0.

        `reported`: time since the last message by the sender's time stamps, s. After a pause, the
        messages since `gap` were sent later than first assumed, by the duration of the pause.
        """
        if self._arrival is None:
            self._arrival = self.measured = self._offset = arrival
            self._start_block(arrival)
            return 0.0
        spacing = arrival - self._arrival
        self._arrival = arrival
        passed = self.period if reported is None else reported
        self._slots += passed / self.period
        self.time += passed
        tolerance = LATE_SLOTS * self.period
        much_too_late = reported is None and spacing > passed + tolerance
        shift = 0.0
        if self.gap is not None:
            shift = self._after_gap(arrival, tolerance, much_too_late)
        late = arrival - self._offset - self.time
        if much_too_late and late > tolerance and self.gap is None:
            self.gap, self._gap_arrival, self._least_late = self.time, arrival, late
            self._count_pause(arrival)
        if late < 0.0:
            self._offset += late
        self._add_to_block(arrival)
        self.measured = min(arrival, max(self.measured + MIN_SPACING_S, self._offset + self.time))
        return shift

    def _after_gap(self, arrival: float, tolerance: float, again: bool) -> float:
        """Determine, from the next messages after a late one, whether the sender paused.

        Returns the duration of the pause, s, or 0 if the sender did not pause or this is still
        unknown. `again`: the time since the previous message is also too long. A network delay
        would have ended with a burst instead.
        """
        late = arrival - self._offset - self.time
        since = self.time - (self.gap or 0.0)
        others = since > 1.5 * self.period
        if late <= tolerance or (again and others):
            # All delayed messages have arrived. If this one is still late, the period is wrong or
            # the sender also paused. The envelope will show which.
            self.gap = None
            return 0.0
        if again or (
            since >= (DECISION_SLOTS - 0.5) * self.period
            and arrival - self._gap_arrival > since / 2
        ):
            paused = self._least_late
            self.time += paused
            self.gap = None
            self._envelope.clear()
            self._start_block(arrival)
            return paused
        self._least_late = min(self._least_late, late)
        return 0.0

    def _count_pause(self, arrival: float) -> None:
        if self._proven or len(self._envelope) >= MIN_LINE_POINTS:
            self._pauses = 0
        if not self._pauses:
            self._first_pause = self._slots, arrival
        self._pauses += 1
        if self._pauses > MAX_PAUSES:
            slots, since = self._first_pause
            self.period = (arrival - since) / (self._slots - slots)
            self._pauses = 0

    def _start_block(self, arrival: float) -> None:
        self._least = (self._slots, arrival, arrival - self.time)
        self._block_start = arrival
        self._block_size = 0

    def _add_to_block(self, arrival: float) -> None:
        self._block_size += 1
        offset = arrival - self.time
        if offset <= self._least[2]:
            self._least = (self._slots, arrival, offset)
        duration = BLOCK_TIME_S if self._warmed_up else FIRST_BLOCK_TIME_S
        if self._block_size >= MIN_BLOCK_MESSAGES and arrival - self._block_start >= duration:
            self._envelope.append(self._least)
            self._fit_envelope()
            self._start_block(arrival)

    def _fit_envelope(self) -> None:
        """Fit a line to the envelope. Its slope is the period, and its height is the offset."""
        envelope = self._envelope
        size = len(envelope)
        length = envelope[-1][1] - envelope[0][1]
        self._warmed_up = length >= BLOCK_TIME_S
        slots = sum(point[0] for point in envelope) / size
        arrival = sum(point[1] for point in envelope) / size
        spread = sum((point[0] - slots) ** 2 for point in envelope)
        if size >= MIN_LINE_POINTS:
            slope = sum((p[0] - slots) * (p[1] - arrival) for p in envelope) / spread
            residual = max(abs(p[1] - arrival - slope * (p[0] - slots)) for p in envelope)
            if slope <= 0.0 or residual > 2.0 * slope:  # no line: the network path has changed
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


class RequestClock:
    """Clock of state messages sent on request only. They count as measured when they arrive."""

    gap: float | None = None

    def __init__(self, period: float) -> None:
        self.period = period
        self.time = 0.0
        self.measured = 0.0
        self._usual = period

    def step(self, arrival: float, _reported: float | None = None) -> float:
        """Process a message. Returns 0, because no pause of the sender is ever detected."""
        spacing = arrival - self.measured
        if self.measured and spacing > self._usual / 2.0:  # less: two replies to one request
            self.period = max(self._usual, spacing)
        self.time = self.measured = arrival
        return 0.0
