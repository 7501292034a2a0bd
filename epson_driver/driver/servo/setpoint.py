# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A setpoint of a stream, and the settings that hold for all of them."""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from epson_driver.motion import Array, JointLimits

POSSIBLE_SHARE = 1.1
"""Of a joint's velocity limit: what positions and their velocities may claim. More is an error."""

WINDOW_BEHIND_S = 0.04
"""How far the positions of a window may be behind where its velocities lead, as time, s."""

SLACK = 1e-3
"""And how much farther, rad or m: rounding and noise."""


SAME_POSITION = 1e-6
"""Positions that differ by less, rad or m, are one position that is held."""

STILL = 1e-4
"""Velocities beside them that are no motion, rad/s or m/s: what a filter leaves of one."""


class Mode(StrEnum):
    """What a stream gives."""

    POSITION = 'position'
    VELOCITY = 'velocity'


@dataclass(frozen=True, slots=True)
class ServoSettings:
    """How streams are followed: a change holds for the next stream, `timeout` at once.

    share: of the limits of velocity, acceleration and jerk, (0, 1]. timeout: silence that ends
    a stream, s. start_tolerance: how far from the arm the first position may be, rad or m.
    reply_timeout: patience for a reply while the arm does not move, s. period: time between two
    points at least, s. catch_up: speed of an arm that is behind positions, of their own, ≥ 1.
    """

    share: float = 0.25
    timeout: float = 0.1
    start_tolerance: float = 0.1
    reply_timeout: float = 5.0
    period: float = 0.02
    catch_up: float = 1.5


@dataclass(frozen=True, slots=True, eq=False)
class Window:
    """Points of a stream's near future, k ≥ 2 of them.

    times: strictly increasing, shape (k,), s since the message came. positions: shape (k, n), rad
    or m. velocities: the same shape, per s, or None.
    """

    times: Array
    positions: Array
    velocities: Array | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Setpoint:
    """One of them, from the topic `source`, joints in the controller's order.

    With `positions` (shape (n,), rad or m) `velocities` (the same shape, per s) say how these
    move on; without, they are what is wanted. One of the two must be there. Positions and
    velocities of a `window` are those of its last point.
    """

    source: str
    positions: Array | None = None
    velocities: Array | None = None
    window: Window | None = None

    @property
    def mode(self) -> Mode:
        """What it gives."""
        return Mode.VELOCITY if self.positions is None else Mode.POSITION

    @property
    def at_rest(self) -> bool:
        """Whether it asks for nothing but standing still: a stick that was let go."""
        return self.positions is None and not np.any(self.velocities)

    @property
    def holds(self) -> bool:
        """Whether it asks for one position, and for no motion there."""
        if self.positions is None:
            return False
        if self.velocities is not None and np.abs(self.velocities).max() > STILL:
            return False
        return self.window is None or np.ptp(self.window.positions, axis=0).max() <= SAME_POSITION

    def problem(self, limits: JointLimits) -> str | None:
        """Return why nobody can follow it, as a sentence, or None if it can be followed."""
        if self.positions is None and self.velocities is None:
            return 'it has neither positions nor velocities'
        for name, values in (('positions', self.positions), ('velocities', self.velocities)):
            if values is None:
                continue
            if values.shape != (len(limits.names),):
                return f'{values.size} {name} for {len(limits.names)} joints'
            for joint, value in zip(limits.names, values.tolist(), strict=True):
                if not np.isfinite(value):
                    return f'{joint}: {name} = {value} is not finite'
        if self.window is not None and (why := self._window_problem(self.window, limits)):
            return why
        if self.positions is not None and self.velocities is not None:
            return _too_fast(self.velocities, limits, 'velocity')
        return None

    def _window_problem(self, window: Window, limits: JointLimits) -> str | None:
        """Return what is wrong with a point before the last one, or None."""
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
        """Return which joint it wants farther or faster than can be, as a clause, or None.

        `fastest`: of velocities that are wanted, shape (n,).
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
    """Return which joint's velocities lead beyond its positions, as a clause, or None.

    `moved`: how far the positions went since the first one; `led`: how far the velocities lead in
    that time; shapes (k, n), rad or m. `velocities`: those of all points, shape (m, n). `within`:
    the positions may be behind by what the fastest of them goes in so long, s.
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
    """Return which joint is faster than it can be, as a clause, or None."""
    wrong = np.argwhere(np.abs(velocities) > POSSIBLE_SHARE * limits.velocity)
    if not wrong.size:
        return None
    joint = int(wrong[0, -1])
    return (
        f'{limits.names[joint]}: {what} {velocities[tuple(wrong[0])]:.6g} {limits.units[joint]}/s '
        f'is beyond what the joint can do, {limits.velocity[joint]:.6g} {limits.units[joint]}/s'
    )
