# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Setpoints of a stream, detection of lost setpoints, and the settings for all streams."""

import time
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from epson_driver.motion import Array, JointLimits

MAX_SPEED_FACTOR = 1.1
"""Maximum speed of a setpoint, as a multiple of the joint's velocity limit."""

WINDOW_BEHIND_S = 0.04
"""Maximum delay of positions in a Window relative to the integral of their velocities, s."""

SLACK = 1e-3
"""Additional tolerance of `contradiction` for rounding and noise, rad or m."""


SAME_POSITION = 1e-6
"""Maximum difference between positions that count as equal, rad or m."""

MAX_REST_VELOCITY = 1e-4
"""Maximum velocity that counts as zero, rad/s or m/s. Filters may leave a small residue."""


class Mode(StrEnum):
    """Type of a stream's setpoints."""

    POSITION = 'position'
    VELOCITY = 'velocity'


@dataclass(frozen=True, slots=True)
class ServoSettings:
    """Settings for following streams. A change of `scale` applies to the next stream.

    * `scale`: fraction of the velocity, acceleration and jerk limits, (0, 1].
    * `timeout`: time without setpoints after which the arm stops, s.
    * `start_tolerance`: maximum distance of the first position from the arm, rad or m.
    * `reply_timeout`: maximum wait for a reply while the arm does not move, s.
    * `period`: minimum time between two points, s.
    * `catch_up`: maximum speed of an arm that is behind the stream, as a multiple of the stream's
      speed, ≥ 1.
    """

    scale: float = 0.25
    timeout: float = 0.1
    start_tolerance: float = 0.1
    reply_timeout: float = 5.0
    period: float = 0.02
    catch_up: float = 1.5


@dataclass(frozen=True, slots=True, eq=False)
class Window:
    """The next k ≥ 2 points of a stream, from one message.

    * `times`: since the arrival of the message, strictly increasing, shape (k,), s.
    * `positions`: shape (k, n), rad or m. `velocities`: shape (k, n), rad/s or m/s, or None.
    """

    times: Array
    positions: Array
    velocities: Array | None = None


NO_STATE_YET = 'its sender has no state yet: all values are NaN'
"""Why a message of only NaN is invalid. ros2_control sends these without an active controller."""


@dataclass(frozen=True, slots=True, eq=False)
class Setpoint:
    """One setpoint from the topic `source`, with joints in the controller's order.

    * `positions`: shape (n,), rad or m, or None for a velocity setpoint.
    * `velocities`: shape (n,), rad/s or m/s; optional for a position setpoint.
    * `window`: all points, if there are several. The other fields then describe the last one.
    """

    source: str
    positions: Array | None = None
    velocities: Array | None = None
    window: Window | None = None

    @property
    def mode(self) -> Mode:
        """Whether the setpoint is a position or a velocity."""
        return Mode.VELOCITY if self.positions is None else Mode.POSITION

    @property
    def at_rest(self) -> bool:
        """Whether this is a velocity setpoint of zero, as from a released joystick."""
        return self.positions is None and not np.any(self.velocities)

    @property
    def holds(self) -> bool:
        """Whether this is a position setpoint with zero velocities and a constant window."""
        if self.positions is None:
            return False
        if self.velocities is not None and np.abs(self.velocities).max() > MAX_REST_VELOCITY:
            return False
        return self.window is None or np.ptp(self.window.positions, axis=0).max() <= SAME_POSITION

    def problem(self, limits: JointLimits) -> str | None:
        """Return why the setpoint is invalid, or None if it is valid."""
        if self.positions is None and self.velocities is None:
            return 'it has neither positions nor velocities'
        for name, values in (('positions', self.positions), ('velocities', self.velocities)):
            if values is None:
                continue
            if values.shape != (len(limits.names),):
                return f'{values.size} {name} for {len(limits.names)} joints'
            if np.isnan(values).all():
                return NO_STATE_YET
            for joint, value in zip(limits.names, values.tolist(), strict=True):
                if not np.isfinite(value):
                    return f'{joint}: {name} = {value} is not finite'
        if self.window is not None and (why := self._window_problem(self.window, limits)):
            return why
        if self.positions is not None and self.velocities is not None:
            return _too_fast(self.velocities, limits, 'velocity')
        return None

    def _window_problem(self, window: Window, limits: JointLimits) -> str | None:
        for name, values in (('positions', window.positions), ('velocities', window.velocities)):
            if values is None:
                continue
            if values.shape != (len(window.times), len(limits.names)):
                return f'{name} of shape {values.shape} for {len(limits.names)} joints'
            invalid = np.argwhere(~np.isfinite(values))
            if invalid.size:
                point, joint = invalid[0].tolist()
                value = values[point, joint]
                return f'{limits.names[joint]}: {name} = {value} is not finite, in point {point}'
        spans = np.diff(window.times)[:, None]
        steps = np.diff(window.positions, axis=0)
        if why := _too_fast(steps / spans, limits, 'mean velocity between two points'):
            return why
        if window.velocities is None:
            return None
        if (why := _too_fast(window.velocities, limits, 'velocity')) is not None:
            return why
        means = (window.velocities[:-1] + window.velocities[1:]) / 2.0
        return contradiction(
            np.cumsum(steps, axis=0),
            np.cumsum(spans * means, axis=0),
            window.velocities,
            limits,
            WINDOW_BEHIND_S,
        )

    def beyond(self, limits: JointLimits, fastest: Array) -> str | None:
        """Return a text with the first joint whose target exceeds its range or speed, or None.

        `fastest`: maximum velocities for velocity setpoints, shape (n,), rad/s or m/s.
        """
        if self.positions is not None:
            values, low, high, what = (
                limits.settled(self.positions),
                limits.position_min,
                limits.position_max,
                'position',
            )
        elif self.velocities is not None:
            values, low, high, what = self.velocities, -fastest, fastest, 'velocity'
        else:
            return None
        for joint, value in enumerate(values.tolist()):
            if not low[joint] <= value <= high[joint]:
                unit = limits.units[joint] + ('' if what == 'position' else '/s')
                return (
                    f'{limits.names[joint]}: {what} {value:.6g} {unit} is outside '
                    f'{low[joint]:.6g} … {high[joint]:.6g} {unit}'
                )
        return None


def contradiction(
    moved: Array, integral: Array, velocities: Array, limits: JointLimits, max_delay: float
) -> str | None:
    """Return a text with the first joint whose velocities contradict its positions, or None.

    `moved`: displacement since the first position, shape (k, n), rad or m. `integral`: integral of
    the velocities over the same time, shape (k, n), rad or m. `velocities`: velocities of all
    points, shape (m, n), rad/s or m/s. `max_delay`: maximum delay of the positions relative to the
    integral, s.
    """
    behind = np.abs(integral) - np.maximum(moved * np.sign(integral), 0.0)
    contradicting = np.argwhere(behind > max_delay * np.abs(velocities).max(axis=0) + SLACK)
    if not contradicting.size:
        return None
    row, joint = contradicting[0].tolist()
    unit = limits.units[joint]
    return (
        f'{limits.names[joint]}: its velocities add up to {integral[row, joint]:.3g} {unit}, but '
        f'its positions move by {moved[row, joint]:.3g} {unit}'
    )


def _too_fast(velocities: Array, limits: JointLimits, what: str) -> str | None:
    """Return a text with the first joint that is faster than MAX_SPEED_FACTOR, or None.

    `what`: name of the velocities.
    """
    too_fast = np.argwhere(np.abs(velocities) > MAX_SPEED_FACTOR * limits.velocity)
    if not too_fast.size:
        return None
    joint, value = int(too_fast[0, -1]), velocities[tuple(too_fast[0])]
    return (
        f'{limits.names[joint]}: {what} {value:.6g} {limits.units[joint]}/s is above the joint '
        f'limit, {limits.velocity[joint]:.6g} {limits.units[joint]}/s'
    )


GAP_S = 0.2
"""Minimum gap between two messages, s, after which lost messages are attributed to a stall of this
process. Losses without a gap are attributed to the network."""

LONGEST_WAIT_S = 10.0
"""Maximum plausible time of a message in the queue, s. A longer time means that the system clock
was set."""

DISCOVERY_S = 10.0
"""Time after the start of this process, s, in which a new publisher may already have sent
setpoints to an earlier instance of the driver."""

MAX_PUBLISHERS = 32
"""Maximum number of publishers per topic that are tracked."""


class ArrivalMonitor:
    """Distinguishes silence on a topic from messages lost while this process was stalled.

    Newer messages replace older ones in the short queue of a subscription. Lost messages are
    therefore detected by their sequence numbers. Each publisher numbers its messages separately,
    and ROS does not identify the publisher of a message. `started`: monotonic time at which this
    process started to receive, s.
    """

    def __init__(self, started: float) -> None:
        self._started = started
        self._newest: list[int] = []
        """Last sequence number of each publisher."""
        self._last_arrival = 0.0

    def missed(self, number: int | None, arrival: float) -> bool:
        """Return whether messages were lost between the previous message and this one.

        `number`: publication_sequence_number of the message; None if the middleware has none.
        `arrival`: monotonic time of arrival, s.
        """
        gap, self._last_arrival = arrival - self._last_arrival, arrival
        if number is None:
            return False
        before = max((item for item in self._newest if item < number), default=0)
        if before:
            self._newest.remove(before)
        self._newest = [*self._newest[-(MAX_PUBLISHERS - 1) :], number]
        if not before:  # a new publisher, whose earlier messages this process may have missed
            return number > 1 and arrival - self._started < DISCOVERY_S
        return number - before > 1 and gap > GAP_S


def came_at(received: int | None) -> float:
    """Return the monotonic time at which a message arrived, s, before it waited in the queue.

    `received`: system time at which the middleware received the message, ns. If it is None, 0 or
    implausible, the current time is returned.
    """
    waited = time.time() - received * 1e-9 if received else 0.0
    return time.monotonic() - (waited if 0.0 <= waited <= LONGEST_WAIT_S else 0.0)
