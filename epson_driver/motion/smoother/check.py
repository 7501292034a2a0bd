# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The judge of every plan: whether a law on a path stays within the limits of all joints."""

from dataclasses import dataclass

import numpy as np

from epson_driver.motion.limits import Array, JointLimits
from epson_driver.motion.smoother.law import Law
from epson_driver.motion.smoother.path import Path

INTERVAL = 1e-3
"""Time between the samples that are checked, s. The breakpoints of law and path come on top."""

MOST_SAMPLES = 4000
"""A law that takes longer is slow: it changes less from sample to sample."""

SEAM = 2e-5
"""Jerk jumps where pieces of law or path meet: both sides are checked, this far away, s."""

BACKWARD = 1e-9
"""u̇ below this negative is a way back."""

ROUNDING = 1e-7
"""Relative excess of a limit that is taken for rounding."""

POSITION_ROUNDING = 1e-9
"""The same for positions, rad: less than a message (float32) can tell."""


@dataclass(frozen=True, slots=True, eq=False)
class Loads:
    """How much of the limits a law on a path uses: the worst joint at each of m samples.

    positions: u, shape (m,). velocity, acceleration, jerk: multiples of the limits, shape (m,).
    inside: whether every joint stays within its position limits, and the law never turns back.
    """

    positions: Array
    velocity: Array
    acceleration: Array
    jerk: Array
    inside: bool

    @property
    def allowed(self) -> bool:
        """Whether nothing exceeds a limit."""
        return self.inside and bool(
            max(self.velocity.max(), self.acceleration.max(), self.jerk.max()) <= 1.0 + ROUNDING
        )


def loads(path: Path, law: Law, limits: JointLimits) -> Loads:
    """Return what a law on a path asks of the joints, from the law's start to its end."""
    knots = path.knots.u
    knots = knots[(knots > law.positions[0]) & (knots < law.end)]
    seams = np.concatenate([law.times, np.interp(knots, law.positions, law.times)])
    count = min(int(law.duration / INTERVAL) + 2, MOST_SAMPLES)
    times = np.concatenate([np.linspace(0.0, law.duration, count), seams - SEAM, seams + SEAM])
    u, v, a, j = law.sample(np.clip(times, 0.0, law.duration))
    forward = bool(min(v.min(), law.velocities.min()) >= -BACKWARD)
    q, first, second, third = path.sample(u)
    v, a, j = v[:, None], a[:, None], j[:, None]
    slack = POSITION_ROUNDING
    inside = (q >= limits.position_min - slack) & (q <= limits.position_max + slack)
    return Loads(
        u,
        np.max(np.abs(first * v) / limits.velocity, axis=1),
        np.max(np.abs(first * a + second * v**2) / limits.acceleration, axis=1),
        np.max(np.abs(first * j + 3.0 * second * v * a + third * v**3) / limits.jerk, axis=1),
        forward and bool(inside.all()),
    )
