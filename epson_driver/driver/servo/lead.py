# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""How far the arm is behind the setpoints that were sent to the controller, in time."""

from collections import deque
from itertools import islice

import numpy as np

from epson_driver.driver.state.robot_state import JointSample
from epson_driver.motion import Array

NEAR = 1e-3
"""An arm so near to the last setpoint, rad or m, is there."""

MAX_SENT = 256
"""Setpoints that are remembered: five seconds of them."""

BEHIND_FILTER_S = 0.2
"""Time constant of how far the arm is taken to be behind, s."""

NEXT = 25
"""So many are compared with where the arm is, from the last that was nearest on."""


class Lead:
    """Compares where the arm is with where it was sent. Times are the loop's, s."""

    def __init__(self) -> None:
        self.lag = 0.0
        """How long before the newest sample was measured the arm's place was sent, s; 0: it is
        where it was last sent."""
        self.behind = 0.0
        """The same, smoothed over the samples on the way. An arm that is where it was last sent
        tells nothing: one that goes from point to point is there whenever it gets the next."""
        self._seen = 0.0
        self._sent: deque[tuple[float, Array]] = deque(maxlen=MAX_SENT)

    def sent(self, time: float, position: Array) -> None:
        """Take note of what was sent, shape (n,)."""
        self._sent.append((time, position))

    def see(self, sample: JointSample) -> None:
        """Look where the arm is."""
        sent = self._sent
        if not sent:
            return
        if float(np.abs(sent[-1][1] - sample.positions).max()) <= NEAR:
            passed, self.lag = len(sent) - 1, 0.0
        else:
            near = np.array([position for _, position in islice(sent, NEXT)])
            passed = int(np.argmin(np.abs(near - sample.positions).max(axis=1)))
            self.lag = max(sample.measured - sent[passed][0], 0.0)
            share = min((sample.measured - self._seen) / BEHIND_FILTER_S, 1.0)
            self.behind += share * (self.lag - self.behind)
        self._seen = sample.measured
        for _ in range(passed):
            sent.popleft()
