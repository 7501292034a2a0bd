# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Arch motions of SPEL+'s `Jump` and `Jump3`: up, across and down, overlapping at the corners."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np

from epson_driver.motion import Array, JointLimits, LineMotion
from epson_driver.sim_controller.arm.low_power import LOW_POWER
from epson_driver.sim_controller.arm.overlap import JointMoves, Part
from epson_driver.tool_motion.curve_motion import (
    Curve,
    CurveMotion,
    CurveSpeed,
    check_range,
    go_along,
    joint_use,
    reduced,
)

_KINDS = 'velocity', 'acceleration', 'jerk'

STATIONARY = 1e-9  # maximum motion of a stationary joint along a leg, rad or m
ON_LEG = 1e-6  # maximum distance of an arm that is on a leg, rad or m

UP, ACROSS = 0.2, 0.8
"""Maximum tool speed of a move up or down, and of the move across.

Both are fractions of the low-power tool speed. Two overlapping moves together reach at most the
low-power tool speed.
"""

CHECKS = 50


class Leg(Protocol):
    """One leg of an arch, between two joint positions, shape (n,), rad."""

    start: Array
    end: Array
    curve: Curve

    def limits_and_speed(self, low_power: bool, fraction: float) -> tuple[JointLimits, CurveSpeed]:
        """Return the joint limits of this leg, and the limits of its motion along the curve.

        `fraction`: the part of the low-power tool speed that this leg may use.
        """

    def from_rest(self, start: Array, low_power: bool) -> LineMotion | CurveMotion: ...


class Arch:
    """Motion up, across and down. Each move starts before the previous one ends.

    The move across starts when the fraction `leave` of the move up is completed. The move down
    starts early enough that its fraction `join` is completed when the move across ends. If a joint
    takes part in two overlapping moves, the move up or down uses at most half of its limits, and
    the move across the rest. After a pause the remaining moves are executed one after the other.
    """

    def __init__(
        self, limits: JointLimits, legs: Sequence[Leg], leave: float, join: float
    ) -> None:
        self._limits = limits
        self._legs = legs
        self._leave, self._join = leave, join
        self._across: Part | None = None

    def __call__(self, start: Array, low_power: bool) -> JointMoves:
        if np.array_equal(start, self._legs[0].start):
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
        passed, whole = (
            part.move.at(time - part.start)[0] - part.origin,
            part.move.end - part.origin,
        )
        return float(np.linalg.norm(passed) / np.linalg.norm(whole))

    def _one_by_one(self, start: Array, low_power: bool) -> list[Part]:
        rise, span, *falls = self._legs
        remaining = list(self._legs) if is_on_leg(rise, start) else [span, *falls]
        if falls and is_on_leg(falls[0], start):
            remaining = falls
        parts: list[Part] = []
        for leg in remaining:
            origin, first = (parts[-1].move.end, parts[-1].end) if parts else (start, 0.0)
            parts.append(Part(first, origin, leg.from_rest(origin, low_power)))
        self._across = parts[remaining.index(span)] if span in remaining else None
        return parts

    def _overlapping(self, low_power: bool) -> list[Part]:
        rise, span, *falls = self._legs
        shared = span.curve.derivative_bounds[0] > STATIONARY
        limits = self._limits
        if low_power:
            limits = changed(limits, lambda _, limit: LOW_POWER * limit)
        half = changed(limits, lambda _, limit: np.where(shared, limit / 2.0, limit))
        span_limits, speed = span.limits_and_speed(low_power, ACROSS)
        vertical = [(leg.curve, leg.limits_and_speed(low_power, UP)[1]) for leg in (rise, *falls)]
        uses = [joint_use(curve, *reduced(half, curve, speed)) for curve, speed in vertical]
        used = dict(zip(_KINDS, np.max(uses, axis=0), strict=True))
        rest = changed(
            limits,
            lambda kind, limit: np.minimum(
                getattr(span_limits, kind), np.where(shared, limit - used[kind], limit)
            ),
        )
        across = go_along(rest, span.curve, speed)
        up, *downs = (go_along(half, *item) for item in vertical)
        self._across = Part(up.when(self._leave), rise.end, across)
        parts = [Part(0.0, rise.start, up), self._across]
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
            fractions = np.linspace(first, last, CHECKS).tolist()
            paths = (
                np.array([leg.curve.at(fraction)[0] for fraction in fractions]),
                span.curve.samples,
            )
            deviations = [path - corner for path in paths]  # each deviation is 0 at the corner
            minimum = corner + sum(np.min(item, axis=0) for item in deviations)
            maximum = corner + sum(np.max(item, axis=0) for item in deviations)
            check_range(self._limits, np.array([minimum, maximum]))


def is_on_leg(leg: Leg, position: Array) -> bool:
    nearest, *_ = leg.curve.at(leg.curve.nearest(position))
    return np.allclose(nearest, position, rtol=0.0, atol=ON_LEG)


def changed(limits: JointLimits, by: Callable[[str, Array], Array]) -> JointLimits:
    velocity, acceleration, jerk = (by(kind, getattr(limits, kind)) for kind in _KINDS)
    return replace(limits, velocity=velocity, acceleration=acceleration, jerk=jerk)
