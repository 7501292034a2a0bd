# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Joint velocities, estimated from joint positions and the sender's clock."""

from collections import deque
from collections.abc import Sequence

VELOCITY_WINDOW_S = 0.04
"""Time over which a velocity is averaged, s. The estimate lags by half this time. In an average
over a single message period, the jitter of the sender's program would dominate."""

Values = Sequence[float]


class JointVelocity:
    """Estimates joint velocities from the positions of the last VELOCITY_WINDOW_S."""

    def __init__(self) -> None:
        self._history: deque[tuple[float, Values]] = deque()
        self._velocities: Values | None = None

    def measured(self, time: float, positions: Values, velocities: Values) -> None:
        self._add(time, positions)
        self._velocities = velocities

    def shift(self, since: float, shift: float) -> bool:
        """Add `shift` to the times of all samples since `since`. Return whether any exist."""
        moved = []
        while self._history and self._history[-1][0] >= since:
            time, positions = self._history.pop()
            moved.append((time + shift, positions))
        self._history.extend(reversed(moved))
        return bool(moved)

    def fitted(
        self, time: float, positions: Values, gap: float | None, elapsed: float
    ) -> Values | None:
        """Add joint positions, and return the estimated velocities, or None for the first sample.

        `time`, `gap`: as in SenderClock, s. `elapsed`: maximum time since the previous sample, s.
        """
        history = self._history
        self._add(time, positions)
        if len(history) < 2:
            return None
        whole = _slope(history[0], history[-1])
        if gap is None:
            self._velocities = whole
        elif (since := self._first_since(gap)) is not history[-1]:
            self._velocities = self._closer_to_last(_slope(since, history[-1]), whole)
        else:
            before = history[-2][1]
            minimum = [(new - old) / elapsed for new, old in zip(positions, before, strict=True)]
            self._velocities = self._closer_to_last(minimum, whole)
        return self._velocities

    def in_window(self) -> list[Values]:
        return [positions for _, positions in self._history]

    def _add(self, time: float, positions: Values) -> None:
        history = self._history
        history.append((time, positions))
        oldest = time - VELOCITY_WINDOW_S
        while len(history) > 2 and history[0][0] < oldest:
            history.popleft()

    def _first_since(self, gap: float) -> tuple[float, Values]:
        return next(entry for entry in self._history if entry[0] >= gap)

    def _closer_to_last(self, after_pause: Values, delayed: Values) -> Values:
        previous = self._velocities
        if previous is None:
            return after_pause
        differences = (
            sum(abs(new - old) for new, old in zip(estimate, previous, strict=True))
            for estimate in (after_pause, delayed)
        )
        return after_pause if next(differences) <= next(differences) else delayed


def _slope(first: tuple[float, Values], last: tuple[float, Values]) -> Values:
    span = last[0] - first[0]
    return [(new - old) / span for new, old in zip(last[1], first[1], strict=True)]
