# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Restart interlock of streams (ISO 14118): a stopped stream may restart only after a release.

A topic counts as one source, because ROS does not identify the publisher of a message. After a
stop, and after any event that closed the arm gate, no message on the topic moves the arm until a
whole second has passed with no messages, or only with setpoints that request no motion. A setpoint
that requests motion restarts this second. The same applies to a stream that arrived while it could
not be followed.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from epson_driver.driver.servo.setpoint import SAME_POSITION, Setpoint
from epson_driver.motion import Array

RELEASE_S = 1.0
"""Time without a request for motion after which a topic may start a new stream, s."""


@dataclass(slots=True, eq=False)
class _Topic:
    """Messages received on a topic. Times are the loop's, s.

    heard: last message. asked: last message that requested motion. held: last positions.
    released: the stream has not been stopped or refused since it started.
    """

    heard: float = -np.inf
    asked: float = -np.inf
    held: Array | None = None
    released: bool = False

    def asks(self, setpoint: Setpoint, came: float) -> bool:
        """Return whether a setpoint requests motion. Holding a position does not."""
        if setpoint.positions is None:
            return not setpoint.at_rest
        before = None if came - self.heard >= RELEASE_S else self.held
        self.held = setpoint.positions
        if before is None or not setpoint.holds:
            return True
        if float(np.abs(setpoint.positions - before).max()) > SAME_POSITION:
            return True
        self.held = before  # otherwise the position could creep
        return False


class RestartInterlock:
    """Decides for each topic whether its stream may move the arm."""

    def __init__(self) -> None:
        self._topics: dict[str, _Topic] = {}
        self._tripped = -np.inf

    def trip(self, now: float) -> None:
        """Block the current streams on all topics because the arm was stopped."""
        self._tripped = now
        for topic in self._topics.values():
            topic.released = False

    def block(self, source: str) -> None:
        """Block the current stream on one topic because it could not be followed."""
        self._topics[source].released = False

    def receive(
        self, source: str, setpoint: Setpoint | None, came: float, *, missed: bool
    ) -> bool:
        """Record a message, and return whether it requests motion.

        `setpoint`: None for an invalid message, which counts as a request for motion. `missed`:
        earlier messages were lost, which may have requested motion.
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
        """Yield the topics that send and are blocked, and their remaining time, s."""
        for source, topic in self._topics.items():
            since = max(topic.asked, self._tripped)
            if not topic.released and topic.heard >= self._tripped and now - since < RELEASE_S:
                yield source, RELEASE_S - (now - since)
