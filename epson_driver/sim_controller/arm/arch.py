# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Arch motions of SPEL+'s `Jump` and `Jump3`: up, across and down, overlapping at the corners."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np

from epson_driver.motion import Array, JointLimits, LineMotion
from epson_driver.motion.overlap import JointMoves, Part
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
"""Largest displacement over a leg, rad or m, at which a joint counts as stationary."""

ON_IT = 1e-6
"""Largest distance from a leg, rad or m, at which the arm counts as on it."""

UP, ACROSS = 0.2, 0.8
"""Fractions of the low-power tool speed for a move up or down, and for the move across.

Two overlapping moves together reach at most the low-power tool speed.
"""

CHECKS = 50
"""Samples per leg for the joint-range check."""


class Leg(Protocol):
    """One leg of an arch, between two joint positions, shape (n,), rad."""

    begin: Array
    end: Array
    curve: Curve

    def asked(self, low_power: bool, share: float) -> tuple[JointLimits, CurveSpeed]:
        """Return the joint limits, and the limits of the speed along this leg.

        share: permitted fraction of the low-power tool speed.
        """

    def from_rest(self, start: Array, low_power: bool) -> LineMotion | CurveMotion:
        """Return the motion of this leg alone, starting at rest at `start`."""


class Arch:
    """Motion up, across and down. Each move starts before the previous one ends.

    The move across starts at the fraction `leave` of the move up and ends at the fraction `join`
    of the move down. If a joint takes part in two overlapping moves, the move up or down uses at
    most half of its limits, and the move across the rest. After a pause the remaining legs run one
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
        """Return the motion from rest at `start`, shape (n,), rad."""
        if np.array_equal(start, self._legs[0].begin):
            parts = self._overlapping(low_power)
        else:
            parts = self._one_by_one(start, low_power)
        return JointMoves(start, parts)

    def across(self, time: float) -> float:
        """Return the completed fraction of the move across at `time`, or -1 before its start."""
        part = self._across
        if part is None or time >= part.end:
            return 1.0
        if time <= part.start:
            return -1.0
        gone, whole = part.move.at(time - part.start)[0] - part.origin, part.move.end - part.origin
        return float(np.linalg.norm(gone) / np.linalg.norm(whole))

    def _one_by_one(self, start: Array, low_power: bool) -> list[Part]:
        rise, span, *falls = self._legs
        left = list(self._legs) if on(rise, start) else [span, *falls]
        if falls and on(falls[0], start):
            left = falls
        parts: list[Part] = []
        for leg in left:
            origin, first = (parts[-1].move.end, parts[-1].end) if parts else (start, 0.0)
            parts.append(Part(first, origin, leg.from_rest(origin, low_power)))
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
        up, *downs = (go_along(half, *item) for item in beside)
        self._across = Part(up.when(self._leave), rise.end, across)
        parts = [Part(0.0, rise.begin, up), self._across]
        for down in downs:
            start = max(self._across.end - down.when(self._join), up.duration)
            parts.append(Part(start, span.end, down))
        return parts

    def check(self) -> None:
        """Raise ValueError if a joint could leave its range while two legs overlap."""
        rise, span, *falls = self._legs
        corners = [
            (rise, self._leave, 1.0, rise.end),
            *((fall, 0.0, self._join, span.end) for fall in falls),
        ]
        for leg, first, last, corner in corners:
            shares = np.linspace(first, last, CHECKS).tolist()
            ways = np.array([leg.curve.at(fraction)[0] for fraction in shares]), span.curve.samples
            away = [way - corner for way in ways]  # each is 0 at the corner
            minimum = corner + sum(np.min(item, axis=0) for item in away)
            maximum = corner + sum(np.max(item, axis=0) for item in away)
            check_range(self._limits, np.array([minimum, maximum]))


def on(leg: Leg, position: Array) -> bool:
    """Return whether a joint position, shape (n,), rad, is on a leg."""
    nearest, *_ = leg.curve.at(leg.curve.nearest(position))
    return np.allclose(nearest, position, rtol=0.0, atol=ON_IT)


def changed(limits: JointLimits, by: Callable[[str, Array], Array]) -> JointLimits:
    """Return limits with `by` applied to velocity, acceleration and jerk."""
    velocity, acceleration, jerk = (by(kind, getattr(limits, kind)) for kind in _KINDS)
    return replace(limits, velocity=velocity, acceleration=acceleration, jerk=jerk)
