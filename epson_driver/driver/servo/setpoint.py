# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A setpoint of a stream, and the settings that hold for all of them."""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from epson_driver.motion import Array, JointLimits


class Mode(StrEnum):
    """What a stream gives."""

    POSITION = 'position'
    VELOCITY = 'velocity'


@dataclass(frozen=True, slots=True)
class ServoSettings:
    """How streams are followed; what changes holds for the next stream, `timeout` at once.

    share: of the limits of velocity, acceleration and jerk, (0, 1]. timeout: silence after which
    the arm brakes, s. start_tolerance: how far from the arm the first position may be, rad or m.
    reply_timeout: patience for a reply while the arm does not move, s. period: time between two
    points at least, s.
    """

    share: float = 0.25
    timeout: float = 0.1
    start_tolerance: float = 0.1
    reply_timeout: float = 5.0
    period: float = 0.02


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

    def problem(self, limits: JointLimits) -> str | None:
        """Return why nobody can follow it, as a sentence; None: it can be followed."""
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
        return None if self.window is None else self._window_problem(self.window, limits)

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
        return None

    def beyond(self, limits: JointLimits, fastest: Array) -> str | None:
        """Return which joint it wants farther or faster than can be, as a clause; None: none.

        `fastest`: of velocities that are wanted, shape (n,).
        """
        if self.positions is not None:
            values, low, high, what = (
                self.positions,
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
