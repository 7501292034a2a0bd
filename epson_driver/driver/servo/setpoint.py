# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Setpoints of a stream, detection of lost setpoints, and the settings for all streams."""

import time
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from epson_driver.motion import Array, JointLimits

MAX_SPEED_FACTOR = 1.1  # maximum speed of a setpoint, as a multiple of the joint's velocity limit
WINDOW_BEHIND_S = 0.04  # maximum delay of positions to the integral of velocities
SLACK = 1e-3  # additional tolerance of `contradiction` for rounding and noise, rad or m


SAME_POSITION = 1e-6  # maximum difference between positions that count as equal, rad or m
MAX_REST_VELOCITY = 1e-4  # counts as zero, rad/s or m/s: filters leave a residue


class Mode(StrEnum):
    POSITION = 'position'
    VELOCITY = 'velocity'


@dataclass(frozen=True, slots=True)
class ServoSettings:
    """Settings for following streams. A change of `scale` applies to the next stream."""

    scale: float = 0.25  # fraction of the velocity, acceleration and jerk limits, (0, 1]
    timeout: float = 0.1  # time without setpoints after which the arm stops, s
    start_tolerance: float = 0.1  # maximum distance of the first position from the arm, rad or m
    reply_timeout: float = 5.0  # maximum wait for a reply while the arm does not move, s
    period: float = 0.02  # minimum time between two points, s
    catch_up: float = (
        1.5  # maximum speed of an arm behind the stream, ≥ 1, as a multiple of its speed
    )


@dataclass(frozen=True, slots=True, eq=False)
class Window:
    """Several upcoming points of a stream (k ≥ 2), which arrived in one message."""

    times: Array  # since the arrival of the message, strictly increasing, shape (k,), s
    positions: Array  # shape (k, n), rad or m
    velocities: Array | None = None  # shape (k, n), rad/s or m/s


NO_STATE_YET = 'its sender has no state yet: all values are NaN'
"""Error text for a message of only NaN. ros2_control sends it if no controller is active."""


@dataclass(frozen=True, slots=True, eq=False)
class Setpoint:
    """One setpoint from the topic `source`, with joints in the controller's order."""

    source: str
    positions: Array | None = None  # shape (n,), rad or m, or None for a velocity setpoint
    velocities: Array | None = None  # shape (n,), rad/s or m/s; optional for a position setpoint
    window: Window | None = None  # all points, if several: the other fields describe the last

    @property
    def mode(self) -> Mode:
        return Mode.VELOCITY if self.positions is None else Mode.POSITION

    @property
    def at_rest(self) -> bool:
        """Whether this is a velocity setpoint of only zeros, as from a released joystick."""
        return self.positions is None and not np.any(self.velocities)

    @property
    def holds(self) -> bool:
        """Whether this is a setpoint that asks the arm to stay at one position.

        Its velocities are zero, and all its upcoming positions (`window`) are equal.
        """
        if self.positions is None:
            return False
        if self.velocities is not None and np.abs(self.velocities).max() > MAX_REST_VELOCITY:
            return False
        return self.window is None or np.ptp(self.window.positions, axis=0).max() <= SAME_POSITION

    def problem(self, limits: JointLimits) -> str | None:
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
        """Return a text with the first joint whose target exceeds its range or `fastest`."""
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

    `moved`: displacements since the first position. `integral`: integrals of the velocities over
    the same times. Both have the shape (k, n), rad or m. `max_delay`: maximum delay of the
    displacements relative to the integrals, s.
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
    """Return a text with the first joint above MAX_SPEED_FACTOR times its limit, or None."""
    too_fast = np.argwhere(np.abs(velocities) > MAX_SPEED_FACTOR * limits.velocity)
    if not too_fast.size:
        return None
    joint, value = int(too_fast[0, -1]), velocities[tuple(too_fast[0])]
    return (
        f'{limits.names[joint]}: {what} {value:.6g} {limits.units[joint]}/s is above the joint '
        f'limit, {limits.velocity[joint]:.6g} {limits.units[joint]}/s'
    )


GAP_S = 0.2  # messages lost after a shorter gap were lost by the network
LONGEST_WAIT_S = 10.0  # a message waiting longer means that the system clock was set
DISCOVERY_S = 10.0  # a new publisher may have sent setpoints to an earlier driver
MAX_PUBLISHERS = 32  # maximum number of publishers per topic that are tracked


class ArrivalMonitor:
    """Distinguishes silence on a topic from messages that were lost while this process stalled.

    In the short queue of a subscription, newer messages replace older ones. Such losses show in
    the sequence numbers. Each publisher numbers its messages separately, and ROS does not identify
    the publisher of a message. `started`: monotonic time at which this process started to
    receive, s.
    """

    def __init__(self, started: float) -> None:
        self._started = started
        self._newest: list[int] = []  # last sequence number of each publisher
        self._last_arrival = 0.0

    def missed(self, number: int | None, arrival: float) -> bool:
        """Return whether messages were lost between the previous message and this one.

        `number`: the message's publication_sequence_number, or None if it is unknown.
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
    """Return the monotonic time at which a message arrived in its queue, s.

    `received`: system time of its arrival, ns. If this is implausible, the result is the current
    time.
    """
    waited = time.time() - received * 1e-9 if received else 0.0
    return time.monotonic() - (waited if 0.0 <= waited <= LONGEST_WAIT_S else 0.0)
