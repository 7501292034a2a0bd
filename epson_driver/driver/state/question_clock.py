# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""When the controller measured what it was asked for: between the question and the answer."""


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
