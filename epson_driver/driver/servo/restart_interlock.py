# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Restart interlock of streams (ISO 14118): what was stopped begins again only when let go of.

A topic is one source, whoever sends on it: ROS does not tell publishers apart. After a stop, and
after whatever closed the arm gate, nothing on it moves the arm until a whole second has passed in
which nothing came, or only setpoints that ask for no motion. One that asks for motion begins that
second anew. The same holds for a stream that came while it could not be followed.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from epson_driver.driver.servo.setpoint import SAME_POSITION, Setpoint
from epson_driver.motion import Array

RELEASE_S = 1.0
"""How long a topic must ask for no motion before its next setpoint begins a new stream, s."""


@dataclass(slots=True, eq=False)
class _Topic:
    """What came on a topic. Times are the loop's, s.

    heard: the last message. asked: the last one that asked for motion. held: the last positions.
    released: nothing has stopped or refused its stream since that began.
    """

    heard: float = -np.inf
    asked: float = -np.inf
    held: Array | None = None
    released: bool = False

    def asks(self, setpoint: Setpoint, came: float) -> bool:
        """Return whether a setpoint asks for motion: one that holds a position does not."""
        if setpoint.positions is None:
            return not setpoint.at_rest
        before = None if came - self.heard >= RELEASE_S else self.held
        self.held = setpoint.positions
        if before is None or not setpoint.holds:
            return True
        if float(np.abs(setpoint.positions - before).max()) > SAME_POSITION:
            return True
        self.held = before  # or it could creep
        return False


class RestartInterlock:
    """Decides for each topic whether its stream may move the arm."""

    def __init__(self) -> None:
        self._topics: dict[str, _Topic] = {}
        self._tripped = -np.inf

    def trip(self, now: float) -> None:
        """Block every stream that goes on, on any topic: the arm was stopped."""
        self._tripped = now
        for topic in self._topics.values():
            topic.released = False

    def block(self, source: str) -> None:
        """Block the stream that goes on, on one topic: it came when it could not be followed."""
        self._topics[source].released = False

    def hear(self, source: str, setpoint: Setpoint | None, came: float, *, missed: bool) -> bool:
        """Record a message, and return whether it asks for motion.

        `setpoint`: None if the message is invalid, which asks for motion. `missed`: others came
        before it that nobody has seen, which may have asked for motion.
        """
        topic = self._topics.setdefault(source, _Topic())
        asks = setpoint is None or topic.asks(setpoint, came)
        if asks or missed:
            quiet = came - max(topic.asked, self._tripped)
            topic.released |= quiet >= RELEASE_S and not missed
            topic.asked = max(came, topic.asked)
        topic.heard = max(came, topic.heard)
        return asks

    def permits(self, source: str) -> bool:
        """Return whether the stream on a topic may move the arm."""
        return self._topics[source].released

    def waiting(self, now: float) -> Iterator[tuple[str, float]]:
        """Yield the topics that send and are blocked, and in how many s they are released."""
        for source, topic in self._topics.items():
            since = max(topic.asked, self._tripped)
            if not topic.released and topic.heard >= self._tripped and now - since < RELEASE_S:
                yield source, RELEASE_S - (now - since)
