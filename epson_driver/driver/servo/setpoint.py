# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A setpoint of a stream, its arrival, and the settings for all streams."""

import time
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from epson_driver.motion import Array, JointLimits

POSSIBLE_SHARE = 1.1
"""Fraction of a joint's velocity limit above which claimed motion is an error."""

WINDOW_BEHIND_S = 0.04
"""Maximum delay of a window's positions relative to the integral of its velocities, s."""

SLACK = 1e-3
"""Additional tolerance for rounding and noise, rad or m."""


SAME_POSITION = 1e-6
"""Maximum difference between positions that count as the same held position, rad or m."""

STILL = 1e-4
"""Velocity of a held position that counts as zero, rad/s or m/s: the residue of a filter."""


class Mode(StrEnum):
    """Type of a stream's setpoints."""

    POSITION = 'position'
    VELOCITY = 'velocity'


@dataclass(frozen=True, slots=True)
class ServoSettings:
    """Settings for following streams. Changes apply to the next stream, `timeout` immediately.

    share: fraction of the velocity, acceleration and jerk limits, (0, 1]. timeout: silence that
    ends a stream, s. start_tolerance: maximum distance of the first position from the arm, rad or
    m. reply_timeout: maximum wait for a reply while the arm does not move, s. period: minimum time
    between two points, s. catch_up: speed of an arm that is behind positions, as a multiple of
    their speed, ≥ 1.
    """

    share: float = 0.25
    timeout: float = 0.1
    start_tolerance: float = 0.1
    reply_timeout: float = 5.0
    period: float = 0.02
    catch_up: float = 1.5


@dataclass(frozen=True, slots=True, eq=False)
class Window:
    """Points of a stream's near future, k ≥ 2.

    times: strictly increasing, shape (k,), s since the message arrived. positions: shape (k, n),
    rad or m. velocities: the same shape, per s, or None.
    """

    times: Array
    positions: Array
    velocities: Array | None = None


NO_STATE_YET = 'its sender has no state yet: all values are NaN'
"""Problem of a ros2_control hardware component without an active controller."""


@dataclass(frozen=True, slots=True, eq=False)
class Setpoint:
    """One setpoint from the topic `source`, with joints in the controller's order.

    `positions` have shape (n,), rad or m, and `velocities` the same shape, per s. With
    positions, the velocities describe how these continue. Otherwise the velocities are the target.
    At least one must be present. For a `window`, positions and velocities are from its last point.
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
        """Whether all velocities are zero, as from a released joystick."""
        return self.positions is None and not np.any(self.velocities)

    @property
    def holds(self) -> bool:
        """Whether the setpoint holds one position without motion."""
        if self.positions is None:
            return False
        if self.velocities is not None and np.abs(self.velocities).max() > STILL:
            return False
        return self.window is None or np.ptp(self.window.positions, axis=0).max() <= SAME_POSITION

    def problem(self, limits: JointLimits) -> str | None:
        """Return why the setpoint cannot be followed, as a sentence, or None if it can."""
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
        """Return the problem of a point before the last one, or None."""
        for name, values in (('positions', window.positions), ('velocities', window.velocities)):
            if values is None:
                continue
            if values.shape != (len(window.times), len(limits.names)):
                return f'{name} of shape {values.shape} for {len(limits.names)} joints'
            wrong = np.argwhere(~np.isfinite(values))
            if wrong.size:
                point, joint = wrong[0].tolist()
                value = values[point, joint]
                return f'{limits.names[joint]}: {name} = {value} is not finite, in point {point}'
        spans = np.diff(window.times)[:, None]
        steps = np.diff(window.positions, axis=0)
        if why := _too_fast(steps / spans, limits, 'the way between two points as velocity'):
            return why
        if window.velocities is None:
            return None
        if (why := _too_fast(window.velocities, limits, 'velocity')) is not None:
            return why
        led = np.cumsum(spans * (window.velocities[:-1] + window.velocities[1:]) / 2.0, axis=0)
        return contradiction(
            np.cumsum(steps, axis=0), led, window.velocities, limits, WINDOW_BEHIND_S
        )

    def beyond(self, limits: JointLimits, fastest: Array) -> str | None:
        """Return the joint whose target exceeds its range or speed, as a clause, or None.

        `fastest`: maximum velocities for velocity setpoints, shape (n,).
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
    moved: Array, led: Array, velocities: Array, limits: JointLimits, within: float
) -> str | None:
    """Return the joint whose velocities contradict its positions, as a clause, or None.

    `moved`: displacement since the first position. `led`: integral of the velocities over the same
    time. Both have shape (k, n), rad or m. `velocities`: velocities of all points, shape (m, n).
    `within`: permitted delay of the positions at the highest of these velocities, s.
    """
    behind = np.abs(led) - np.maximum(moved * np.sign(led), 0.0)
    wrong = np.argwhere(behind > within * np.abs(velocities).max(axis=0) + SLACK)
    if not wrong.size:
        return None
    row, joint = wrong[0].tolist()
    unit = limits.units[joint]
    return (
        f'{limits.names[joint]}: its velocities lead by {led[row, joint]:.3g} {unit}, where its '
        f'positions move by {moved[row, joint]:.3g} {unit}'
    )


def _too_fast(velocities: Array, limits: JointLimits, what: str) -> str | None:
    """Return the joint that exceeds its possible speed, as a clause, or None."""
    wrong = np.argwhere(np.abs(velocities) > POSSIBLE_SHARE * limits.velocity)
    if not wrong.size:
        return None
    joint = int(wrong[0, -1])
    return (
        f'{limits.names[joint]}: {what} {velocities[tuple(wrong[0])]:.6g} {limits.units[joint]}/s '
        f'is above the joint limit, {limits.velocity[joint]:.6g} {limits.units[joint]}/s'
    )


GAP_S = 0.2
"""Gap in a topic, s, above which lost messages are attributed to a stall of this process, in which
newer messages replaced them. Losses in a shorter gap are attributed to the network."""

LONGEST_WAIT_S = 10.0
"""Maximum plausible wait of a message, s. A longer one means that the system clock was set."""

DISCOVERY_S = 10.0
"""Time after the start of this process, s, within which a newly discovered publisher may have been
sending before, to an earlier instance of the driver."""

MAX_PUBLISHERS = 32
"""Maximum number of publishers tracked per topic. The latest ones are stored."""


class ArrivalMonitor:
    """Distinguishes silence on a topic from messages lost while this process was stalled.

    The queue is short, so a process that stalled for a second may not have seen a second of
    silence. Each publisher numbers its messages, but ROS does not identify the publisher of a
    message. `started`: when this process started to receive, monotonic time, s.
    """

    def __init__(self, started: float) -> None:
        self._started = started
        self._newest: list[int] = []
        self._came = 0.0

    def missed(self, number: int | None, came: float) -> bool:
        """Return whether messages were lost between the previous message and this one.

        `number`: publication_sequence_number of the message; None if the middleware has none.
        `came`: monotonic time, s.
        """
        gap, self._came = came - self._came, came
        if number is None:
            return False
        before = max((item for item in self._newest if item < number), default=0)
        if before:
            self._newest.remove(before)
        self._newest = [*self._newest[-(MAX_PUBLISHERS - 1) :], number]
        if not before:  # a new publisher: later on, its earlier messages were not for this process
            return number > 1 and came - self._started < DISCOVERY_S
        return number - before > 1 and gap > GAP_S


def came_at(received: int | None) -> float:
    """Return the arrival time of a message, monotonic, s. It may have waited for its callback.

    `received`: when the middleware received it, ns of the system clock; None or 0 if unknown.
    """
    waited = time.time() - received * 1e-9 if received else 0.0
    return time.monotonic() - (waited if 0.0 <= waited <= LONGEST_WAIT_S else 0.0)
