# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What the controller reported last, how old it is, and how fast the joints move."""

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from epson_driver.client.joint_mapping import JointMapping, unmapped
from epson_driver.client.pause import PauseWatch
from epson_driver.error_texts import ErrorTexts, load_error_texts
from epson_driver.motion import Array
from epson_driver.simple_message import Status, TriState

VELOCITY_WINDOW = 0.04
"""Time over which the velocity is fitted, s: single differences of positions that come every
5 ms would show the network's jitter rather than the arm."""

KEPT_ARRIVALS = 2048
"""Arrival times that are kept for diagnostics: two seconds at 1 kHz."""


@dataclass(frozen=True, slots=True, eq=False)
class JointSample:
    """Measured joints. positions, velocities: shape (n,), rad and rad/s. time: monotonic, s."""

    time: float
    positions: Array
    velocities: Array


class RobotState:
    """The newest joints and status, for `joints` joints. Times are the event loop's, s.

    Emptied when the link is lost: nothing stale can be taken for fresh (docs/invariants.md, 6).
    `errors` says what the controller's error numbers mean; EPSON's, unless it is given.
    What comes in is counted as the controller does, `sample` as ROS does, by `mapping`.
    """

    def __init__(
        self,
        joints: int,
        errors: ErrorTexts | None = None,
        mapping: JointMapping | None = None,
    ) -> None:
        self._joints = joints
        self._mapping = unmapped(joints) if mapping is None else mapping
        self.errors = load_error_texts() if errors is None else errors
        self._history: deque[tuple[float, tuple[float, ...]]] = deque()
        self.sample: JointSample | None = None
        self.status: Status | None = None
        self.status_time = 0.0
        self._pause = PauseWatch()
        self.arrivals: deque[float] = deque(maxlen=KEPT_ARRIVALS)
        """When joints came, the newest last; only since the link was established."""

    def clear(self) -> None:
        """Forget everything: the link is gone."""
        self._history.clear()
        self.arrivals.clear()
        self.sample = None
        self.status = None
        self._pause = PauseWatch()

    def on_joints(
        self, data: tuple[float, ...], now: float, velocities: tuple[float, ...] | None = None
    ) -> JointSample:
        """Take the ten joint values of a message, and velocities if it measured them.

        Raises ValueError that names the joint if a value is not finite.
        """
        values = data[: self._joints]
        positions = _finite('position', values)
        measured = None
        if velocities is not None:
            measured = _finite('velocity', velocities[: self._joints])
        history = self._history
        history.append((now, values))
        self.arrivals.append(now)
        while history[0][0] < now - VELOCITY_WINDOW and len(history) > 2:
            history.popleft()
        rates = self._slope() if measured is None else measured
        mapping = self._mapping
        self.sample = JointSample(
            now, mapping.positions_to_ros(positions), mapping.velocities_to_ros(rates)
        )
        return self.sample

    def on_status(self, status: Status, now: float) -> None:
        """Take a STATUS message."""
        self.status = status
        self.status_time = now
        self._pause.see(status)

    def enabled(self) -> None:
        """Somebody enabled the arm: what the controller allowed before that says nothing now."""
        self._pause = PauseWatch()
        if self.status is not None:
            self._pause.see(self.status)

    @property
    def paused(self) -> bool:
        """The controller denies motion, which it allowed since the arm was enabled; no error."""
        return self._pause.interrupted

    @property
    def in_motion(self) -> int:
        """`TriState`: does the controller say that the arm moves? UNKNOWN without a status."""
        return TriState.UNKNOWN if self.status is None else self.status.in_motion

    def _slope(self) -> Array:
        """Return the slope of a straight line through the samples of the window, rad/s."""
        first, last = self._history[0], self._history[-1]
        if last[0] - first[0] < VELOCITY_WINDOW / 4 or last[1] == first[1]:  # most of the time
            return np.zeros(self._joints)
        times = np.array([time for time, _ in self._history])
        times -= times.mean()
        positions = np.array([values for _, values in self._history])
        positions -= positions[0]
        slope: Array = times @ positions / (times @ times)
        return slope


def _finite(quantity: str, data: tuple[float, ...]) -> Array:
    if not math.isfinite(sum(data)):
        for joint, value in enumerate(data, 1):
            if not math.isfinite(value):
                raise ValueError(f'joint {joint}: {quantity} {value} is not finite')
    return np.array(data)
