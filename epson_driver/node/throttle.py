# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Thins out samples to a set rate."""


class Throttle:
    """Lets `rate` samples a second through, or all if there are fewer. Times are monotonic, s."""

    def __init__(self) -> None:
        self._next = 0.0

    def passes(self, time: float, rate: float) -> bool:
        """Return whether to pass on the sample of this time: the first one in each 1/`rate` s.

        Periods follow each other whenever the samples come, so that the mean rate is right.
        """
        if time < self._next:
            return False
        following = self._next + 1.0 / rate
        self._next = following if following > time else time + 1.0 / rate
        return True
