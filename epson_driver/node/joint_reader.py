# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Joint states by name, from a topic that only the driver should publish.

rclpy does not report the publisher of a message. Two publishers with different positions are
detected, because a joint then seems to move faster than its limit between two messages.
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from builtin_interfaces.msg import Time

from epson_driver.driver.state.plausibility import DEFAULT_MARGINS, MIN_JUMP
from epson_driver.driver.state.robot_state import DISTRUST_TIME_S
from epson_driver.motion import Array
from epson_driver.node.trajectory_messages import duration_in_s, invalid_goal

MIN_ELAPSED_S = 0.001
MAX_POSITION = 1e6
"""Maximum absolute position, rad or m. A larger position counts as invalid, like NaN."""


class Joint(NamedTuple):
    """State of a joint. `received`: monotonic time of arrival, s. `stamp`: message's stamp, s."""

    received: float
    stamp: float
    position: float
    velocity: float


class JointReader:
    def __init__(self, topic: str) -> None:
        self.topic = topic
        self._joints: dict[str, Joint] = {}
        self._fastest: dict[str, float] = {}
        self._fastest_before: dict[str, float] = {}
        """Highest speed of each joint before `_since`, per s. `_fastest` has the highest speed
        after it."""
        self._since = 0.0

    def __bool__(self) -> bool:
        return bool(self._joints)

    def take(
        self,
        names: Sequence[str],
        positions: Sequence[float],
        velocities: Sequence[float],
        stamp: Time,
        now: float,
    ) -> bool:
        valid = len(positions) == len(names) == len(set(names))
        if not valid or not np.all(np.abs(positions) < MAX_POSITION):
            return False
        if now - self._since > DISTRUST_TIME_S:
            self._fastest_before, self._fastest, self._since = self._fastest, {}, now
        sent = duration_in_s(stamp)
        for index, (name, position) in enumerate(zip(names, positions, strict=True)):
            before = self._joints.get(name) or Joint(now, sent, position, 0.0)
            moved, later = position - before.position, sent - before.stamp
            elapsed = max(now - before.received, MIN_ELAPSED_S)
            if elapsed < later < DISTRUST_TIME_S:
                elapsed = later  # messages that were delayed arrive together
            speed = (abs(moved) - MIN_JUMP) / elapsed
            self._fastest[name] = max(self._fastest.get(name, 0.0), speed)
            velocity = moved / later if later > 0.0 else before.velocity
            if len(velocities) == len(names):
                velocity = velocities[index]
            self._joints[name] = Joint(now, sent, position, velocity)
        return True

    def of(
        self, names: Iterable[str], limits: Iterable[float], oldest: float, now: float
    ) -> tuple[Array, Array]:
        """Return positions and velocities of joints, shapes (n,).

        `limits`: maximum velocities, per s. `oldest`: maximum age, s. Raises GoalRejectedError if
        the state of a joint is missing or too old, or if its position jumps.
        """
        result = []
        for name, limit in zip(names, limits, strict=True):
            joint = self._joints.get(name)
            if joint is None or now - joint.received > oldest:
                raise invalid_goal(
                    f'no position of {name} on {self.topic} in the last {oldest:g} s'
                )
            speed = max(self._fastest.get(name, 0.0), self._fastest_before.get(name, 0.0))
            if speed > DEFAULT_MARGINS.velocity * limit:
                raise invalid_goal(
                    f'{name} jumps on {self.topic}, at {speed:.3g} /s where its limit is '
                    f'{limit:.3g} /s: two publishers disagree. Stop all except the driver'
                )
            result.append((joint.position, joint.velocity))
        positions, velocities = np.array(result, dtype=float).reshape(-1, 2).T
        return positions, velocities
