# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What ros2_control's joint_trajectory_controller does: one spline in time per joint and segment.

Cubic where the points carry velocities, quintic where they carry accelerations as well. It keeps
the time whatever the limits say. Plans without derivatives get them from finite differences here.
"""

from dataclasses import dataclass

import numpy as np

from epson_driver.motion import Array, JointLimits

RATE = 1000.0
"""Samples per second; the jerk is the difference of their accelerations."""


@dataclass(frozen=True)
class SplineUse:
    """Time in s, and the largest velocity, acceleration and jerk as shares of the limits."""

    duration: float
    velocity: float
    acceleration: float
    jerk: float


def joint_spline(
    positions: Array, durations: Array, limits: JointLimits, quintic: bool
) -> SplineUse:
    """Return what the spline through points (n, joints), rad, demands; durations (n,), s."""
    knots = np.cumsum(durations)
    velocities = _differences(knots, positions)
    accelerations = _differences(knots, velocities) if quintic else None
    times = np.arange(0.0, knots[-1], 1.0 / RATE)
    v, a = _sampled(knots, positions, velocities, accelerations, times)
    jerk = np.diff(a, axis=0) * RATE
    return SplineUse(
        float(knots[-1]),
        float(np.max(np.abs(v) / limits.velocity)),
        float(np.max(np.abs(a) / limits.acceleration)),
        float(np.max(np.abs(jerk) / limits.jerk)),
    )


def _differences(knots: Array, values: Array) -> Array:
    """Return central differences at the knots; rest at both ends."""
    result = np.zeros_like(values)
    result[1:-1] = (values[2:] - values[:-2]) / (knots[2:] - knots[:-2])[:, None]
    return result


def _sampled(
    knots: Array, q: Array, v: Array, a: Array | None, times: Array
) -> tuple[Array, Array]:
    """Return velocities and accelerations at times (k,), shapes (k, joints)."""
    i = np.clip(np.searchsorted(knots, times, 'right') - 1, 0, len(knots) - 2)
    h = (knots[i + 1] - knots[i])[:, None]
    s = (times - knots[i])[:, None]
    d = q[i + 1] - q[i]
    if a is None:
        c2 = 3.0 * d / h**2 - (2.0 * v[i] + v[i + 1]) / h
        c3 = -2.0 * d / h**3 + (v[i] + v[i + 1]) / h**2
        return v[i] + (2.0 * c2 + 3.0 * c3 * s) * s, 2.0 * c2 + 6.0 * c3 * s
    c2 = a[i] / 2.0
    # what is left for the three highest powers to do by the end of the segment
    dq = d - (v[i] + c2 * h) * h
    dv = (v[i + 1] - v[i] - a[i] * h) * h
    da = (a[i + 1] - a[i]) * h**2
    c3 = (10.0 * dq - 4.0 * dv + 0.5 * da) / h**3
    c4 = (-15.0 * dq + 7.0 * dv - da) / h**4
    c5 = (6.0 * dq - 3.0 * dv + 0.5 * da) / h**5
    velocity = v[i] + (2.0 * c2 + (3.0 * c3 + (4.0 * c4 + 5.0 * c5 * s) * s) * s) * s
    return velocity, 2.0 * c2 + (6.0 * c3 + (12.0 * c4 + 20.0 * c5 * s) * s) * s
