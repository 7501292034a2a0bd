# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The control cycle of a controller, measured from the times of its replies.

A controller with a full buffer replies to a target when it takes one, so once per cycle. Otherwise
it replies immediately, so the replies show the rate of the driver. A cycle that is shorter than
assumed would move the arm faster than planned.
"""

import logging

import numpy as np

SAMPLES = 25  # answers of a measurement
RESOLUTION_S = 5e-4
"""The cycle is a multiple of this time, s. A measurement is rounded down, with a tolerance of 10 %
of this time, because a controller with a shorter cycle moves the arm faster than planned."""

MAX_SPREAD = 0.1  # maximum spread of a measurement, relative to its result
MIN_CYCLE_S, MAX_CYCLE_S = 5e-4, 0.1

MAX_FILLING = 100
"""Maximum number of replies that report free space in the buffer, before the measurement. After
these, the measured cycle must be shorter than the expected cycle, or is ignored."""

PACE_SHARE, PACE_TARGETS = 1.05, 10
"""If targets are taken faster than in the cycle, the time may differ by this factor, plus the time
of this number of targets (the controller's buffer)."""

_log = logging.getLogger(__name__)


class CycleMeter:
    """Measures the cycle of one controller. `expected`: cycle before a measurement, s."""

    def __init__(self, expected: float) -> None:
        self.cycle = expected
        self._measured = False
        self._times: list[float] = []
        self.restart()

    def restart(self) -> None:
        """Prepare for the replies of the next motion, which starts with an empty buffer."""
        self._filling, self._count = MAX_FILLING, 0
        self._times.clear()

    def add(self, time: float, *, full: bool) -> None:
        """Add a reply. `full`: whether the buffer was full, so that the reply shows the cycle.

        Raises ValueError if the measured cycle is unusable, or the actual one shorter than
        `cycle`.
        """
        if not (full or self.ready):
            self._filling -= 1
            if self._filling > 0:
                self._times.clear()
                return
        self._count = self._count + 1 if self._times else 1
        if len(self._times) < SAMPLES:
            self._times.append(time)
            if len(self._times) == SAMPLES and not self._measured:
                self._measure()
        elapsed = time - self._times[0]
        most = PACE_SHARE * elapsed + PACE_TARGETS * self.cycle
        if self.ready and (self._count - 1) * self.cycle > most:
            mean = elapsed / (self._count - 1)
            self._measured = False
            self.restart()
            raise ValueError(
                f'the controller takes a target each {mean * 1e3:.3g} ms, but its cycle was '
                f'{self.cycle * 1e3:g} ms: try again'
            )

    @property
    def ready(self) -> bool:
        """Whether the buffer is full, and the cycle is measured as well as possible."""
        return bool(self._times) and (self._measured or len(self._times) == SAMPLES)

    def _measure(self) -> None:
        """Measure the cycle. Keep the expected cycle if the replies are too irregular.

        Also keep it if the buffer never became full, unless the measured cycle is shorter.
        """
        times, half = np.array(self._times), SAMPLES // 2
        slopes = np.sort(times[half:] - times[:-half]) / half
        low, cycle, high = slopes[[len(slopes) // 5, len(slopes) // 2, -len(slopes) // 5]].tolist()
        if high - low <= MAX_SPREAD * cycle:
            rounded = int(cycle / RESOLUTION_S + 0.1) * RESOLUTION_S
            if not MIN_CYCLE_S <= rounded <= MAX_CYCLE_S:
                raise ValueError(f'the controller takes a target each {cycle * 1e3:.3g} ms')
            if self._filling > 0 or rounded < self.cycle:
                self.cycle, self._measured = rounded, True
                _log.info('real-time motion: the control cycle is %g ms', rounded * 1e3)
