# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Notices streams of single points and of windows that come where goals are expected.

A trajectory of one point, or a short one that has begun already, is a goal like any other: it
replaces the running one after the arm has come to rest. So a stream of them makes the arm twitch
and stop, and the points run away from it. One of them by itself cannot be told from a goal, and
when the next comes the arm is on its way; so they are not followed here, and whoever sends them is
told so, once.
"""

MAX_GAP_S = 0.3
"""Points of a stream follow one another within this time, s."""

MIN_POINTS = 3
"""How many in a row are a stream."""

MAX_WINDOW_S = 0.5
"""A trajectory that takes no longer may be the window of a stream, s."""

WARNING = (
    'single points or short windows come in a stream: here each is a goal of its own, which '
    'replaces the one before when the arm has come to rest, or is refused where it begins too far '
    'from the arm; send streams to ~/servo'
)


class PointStreams:
    """Counts what may belong to a stream and follows one another. Times are monotonic, s."""

    def __init__(self) -> None:
        self._last = float('-inf')
        self._count = 0

    def noticed(self, points: int, duration: float, now: float) -> str | None:
        """Take a trajectory with so many points that takes so long, s.

        Return the sentence, once for each stream.
        """
        short = points == 1 or duration <= MAX_WINDOW_S
        follows = short and now - self._last < MAX_GAP_S
        self._count = self._count + 1 if follows else int(short)
        if short:
            self._last = now
        return WARNING if self._count == MIN_POINTS else None
