# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Notices streams of single points, as for servoing and jogging: they are not what goals are for.

A trajectory of one point is a goal like any other: it replaces the running one after the arm has
come to rest. So a stream of them makes the arm twitch and stop, and the points run away from it
until they start too far from it. Whoever sends one should be told so, once.
"""

MAX_GAP_S = 0.3
"""Points of a stream follow one another within this time, s."""

MIN_POINTS = 3
"""How many single points in a row are a stream."""

WARNING = (
    'single points come in a stream: each is a goal of its own, which replaces the one before '
    'when the arm has come to rest, or is refused where it begins too far from the arm; this '
    'driver does no servoing: send trajectories'
)


class PointStreams:
    """Counts single points that follow one another. Times (`now`) are monotonic, s."""

    def __init__(self) -> None:
        self._last = float('-inf')
        self._count = 0

    def noticed(self, points: int, now: float) -> str | None:
        """Take a trajectory with so many points; return the sentence, once for each stream."""
        single = points == 1
        follows = single and now - self._last < MAX_GAP_S
        self._count = self._count + 1 if follows else int(single)
        if single:
            self._last = now
        return WARNING if self._count == MIN_POINTS else None
