# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Restart interlock of streams (ISO 14118): a stopped stream may restart only after a release.

A stream is released when none of its setpoints has requested motion for RELEASE_S. The release is
required after each stop, after each event that closes the arm gate, and after a refusal of the
stream. Each topic counts as one stream, because ROS does not identify the publisher of a message.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from epson_driver.driver.servo.setpoint import SAME_POSITION, Setpoint
from epson_driver.motion import Array

RELEASE_S = 1.0  # time without a request for motion after which a stream counts as released, s


@dataclass(slots=True, eq=False)
class _Topic:
    """Record of the messages on a topic. Times are the event loop's, s."""

    last_message: float = -np.inf  # time of the last message
    last_request: float = -np.inf  # time of the last message that requested motion
    position: Array | None = None  # last position, shape (n,)
    released: bool = False  # whether the stream may move the arm, until it is stopped or refused

    def requests_motion(self, setpoint: Setpoint, arrival: float) -> bool:
        """Return whether a setpoint requests motion. Repeating the last position does not."""
        if setpoint.positions is None:
            return not setpoint.at_rest
        before = None if arrival - self.last_message >= RELEASE_S else self.position
        self.position = setpoint.positions
        if before is None or not setpoint.holds:
            return True
        if float(np.abs(setpoint.positions - before).max()) > SAME_POSITION:
            return True
        self.position = before  # otherwise small steps could add up unnoticed
        return False


class RestartInterlock:
    def __init__(self) -> None:
        self._topics: dict[str, _Topic] = {}
        self._last_trip = -np.inf

    def trip(self, now: float) -> None:
        self._last_trip = now
        for topic in self._topics.values():
            topic.released = False

    def block(self, source: str) -> None:
        self._topics[source].released = False

    def receive(
        self, source: str, setpoint: Setpoint | None, arrival: float, *, missed: bool
    ) -> bool:
        """Record a message, and return whether it requests motion.

        `setpoint`: None for an invalid message, which counts as a request. `missed`: whether
        earlier messages were lost, which may have requested motion.
        """
        topic = self._topics.setdefault(source, _Topic())
        requests_motion = setpoint is None or topic.requests_motion(setpoint, arrival)
        if requests_motion or missed:
            quiet = arrival - max(topic.last_request, self._last_trip)
            topic.released |= quiet >= RELEASE_S and not missed
            topic.last_request = max(arrival, topic.last_request)
        topic.last_message = max(arrival, topic.last_message)
        return requests_motion

    def permits(self, source: str) -> bool:
        return self._topics[source].released

    def waiting(self, now: float) -> Iterator[tuple[str, float]]:
        """Yield each blocked topic with recent messages, and the time until its release, s."""
        for source, topic in self._topics.items():
            quiet = now - max(topic.last_request, self._last_trip)
            sends = topic.last_message >= self._last_trip
            if sends and not topic.released and quiet < RELEASE_S:
                yield source, RELEASE_S - quiet
