# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Up, across and down, as SPEL+'s `Jump` and `Jump3`: legs that overlap in time at the corners."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np

from epson_driver.motion import Array, JointLimits, LineMotion
from epson_driver.motion.joint_moves import JointMoves, Part
from epson_driver.sim_controller.arm.low_power import LOW_POWER
from epson_driver.tool_motion.curve_motion import (
    Curve,
    CurveMotion,
    CurveSpeed,
    check_range,
    go_along,
    joint_use,
    kept,
)

_KINDS = 'velocity', 'acceleration', 'jerk'

STANDS = 1e-9
"""A joint that moves by less of a leg, rad or m, stands."""

ON_IT = 1e-6
"""An arm that is no farther away, rad or m, is on a leg."""

UP, ACROSS = 0.2, 0.8
"""Of the tool's speed at low power, what each has where they overlap: a line never has more."""

CHECKS = 50
"""So often a leg is looked at for its joints' ranges."""


class Leg(Protocol):
    """A part of the way, from one place, shape (n,), rad, to another."""

    begin: Array
    end: Array
    curve: Curve

    def asked(self, low_power: bool, share: float) -> tuple[JointLimits, CurveSpeed]:
        """Return what it may have of the joints' limits, and how fast it is to be.

        share: of the tool's speed at low power.
        """

    def from_rest(self, start: Array, low_power: bool) -> LineMotion | CurveMotion:
        """Return its motion alone, from where the arm is."""


class Arch:
    """Up, across and down, where the next one begins before the one before it ends.

    The way across begins at the share `leave` of the way up, and is over at the share `join` of
    the way down. Joints that both would move share their limits: the way up or down has half of
    them at most, the way across what that leaves. After a pause what is left of them comes one
    after the other.
    """

    def __init__(
        self, limits: JointLimits, legs: Sequence[Leg], leave: float, join: float
    ) -> None:
        self._limits = limits
        self._legs = legs
        self._leave, self._join = leave, join
        self._across: Part | None = None

    def __call__(self, start: Array, low_power: bool) -> JointMoves:
        """Return the motion from where the arm is."""
        if np.array_equal(start, self._legs[0].begin):
            parts = self._overlapping(low_power)
        else:
            parts = self._one_by_one(start, low_power)
        return JointMoves(start, parts)

    def across(self, time: float) -> float:
        """Return how much of the way across is done after so much of the motion, -1 before it."""
        part = self._across
        if part is None or time >= part.end:
            return 1.0
        if time <= part.begin:
            return -1.0
        gone, whole = part.move.at(time - part.begin)[0] - part.origin, part.move.end - part.origin
        return float(np.linalg.norm(gone) / np.linalg.norm(whole))

    def _one_by_one(self, start: Array, low_power: bool) -> list[Part]:
        rise, span, *falls = self._legs
        left = list(self._legs) if on(rise, start) else [span, *falls]
        if falls and on(falls[0], start):
            left = falls
        parts: list[Part] = []
        for leg in left:
            origin, begin = (parts[-1].move.end, parts[-1].end) if parts else (start, 0.0)
            parts.append(Part(begin, origin, leg.from_rest(origin, low_power)))
        self._across = parts[left.index(span)] if span in left else None
        return parts

    def _overlapping(self, low_power: bool) -> list[Part]:
        rise, span, *falls = self._legs
        both = span.curve.most[0] > STANDS
        limits = self._limits
        if low_power:
            limits = changed(limits, lambda _, most: LOW_POWER * most)
        half = changed(limits, lambda _, most: np.where(both, most / 2.0, most))
        asked, speed = span.asked(low_power, ACROSS)
        beside = [(leg.curve, leg.asked(low_power, UP)[1]) for leg in (rise, *falls)]
        uses = [joint_use(curve, *kept(half, curve, speed)) for curve, speed in beside]
        used = dict(zip(_KINDS, np.max(uses, axis=0), strict=True))
        left = changed(
            limits,
            lambda kind, most: np.minimum(
                getattr(asked, kind), np.where(both, most - used[kind], most)
            ),
        )
        across = go_along(left, span.curve, speed)
        up, *downs = (go_along(half, *each) for each in beside)
        self._across = Part(up.when(self._leave), rise.end, across)
        parts = [Part(0.0, rise.begin, up), self._across]
        for down in downs:
            begin = max(self._across.end - down.when(self._join), up.duration)
            parts.append(Part(begin, span.end, down))
        return parts

    def check(self) -> None:
        """Raise ValueError if a joint might leave its range where two legs are under way."""
        rise, span, *falls = self._legs
        corners = [
            (rise, self._leave, 1.0, rise.end),
            *((each, 0.0, self._join, span.end) for each in falls),
        ]
        for leg, first, last, corner in corners:
            shares = np.linspace(first, last, CHECKS).tolist()
            ways = np.array([leg.curve.at(share)[0] for share in shares]), span.curve.samples
            away = [way - corner for way in ways]  # each of them 0 at the corner
            least = corner + sum(np.min(each, axis=0) for each in away)
            most = corner + sum(np.max(each, axis=0) for each in away)
            check_range(self._limits, np.array([least, most]))


def on(leg: Leg, position: Array) -> bool:
    """Return whether a position, shape (n,), rad, is on a leg."""
    nearest, *_ = leg.curve.at(leg.curve.nearest(position))
    return np.allclose(nearest, position, rtol=0.0, atol=ON_IT)


def changed(limits: JointLimits, by: Callable[[str, Array], Array]) -> JointLimits:
    """Return limits whose velocity, acceleration and jerk `by` has changed."""
    velocity, acceleration, jerk = (by(kind, getattr(limits, kind)) for kind in _KINDS)
    return replace(limits, velocity=velocity, acceleration=acceleration, jerk=jerk)
